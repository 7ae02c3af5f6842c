//! The ways of lenses, under COLMAP's names.

use serde::{Deserialize, Serialize};

/// How a direction in the camera frame becomes a pixel. Names and parameter order are COLMAP's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum CameraModel {
    /// `f, cx, cy`
    #[serde(rename = "SIMPLE_PINHOLE")]
    SimplePinhole,
    /// `fx, fy, cx, cy`
    #[serde(rename = "PINHOLE")]
    Pinhole,
    /// `f, cx, cy, k`
    #[serde(rename = "SIMPLE_RADIAL")]
    SimpleRadial,
    /// `f, cx, cy, k1, k2`
    #[serde(rename = "RADIAL")]
    Radial,
    /// `fx, fy, cx, cy, k1, k2, p1, p2`
    #[serde(rename = "OPENCV")]
    OpenCv,
    /// `fx, fy, cx, cy, k1, k2, k3, k4`
    #[serde(rename = "OPENCV_FISHEYE")]
    OpenCvFisheye,
    /// `fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6`
    #[serde(rename = "FULL_OPENCV")]
    FullOpenCv,
}

impl CameraModel {
    /// Every model.
    pub const ALL: [Self; 7] = [
        Self::SimplePinhole,
        Self::Pinhole,
        Self::SimpleRadial,
        Self::Radial,
        Self::OpenCv,
        Self::OpenCvFisheye,
        Self::FullOpenCv,
    ];

    /// COLMAP's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::OpenCv => "OPENCV",
            Self::OpenCvFisheye => "OPENCV_FISHEYE",
            Self::FullOpenCv => "FULL_OPENCV",
        }
    }

    /// The model of COLMAP's name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.name() == name)
    }

    /// COLMAP's number in binary files.
    pub fn colmap_id(self) -> i32 {
        match self {
            Self::SimplePinhole => 0,
            Self::Pinhole => 1,
            Self::SimpleRadial => 2,
            Self::Radial => 3,
            Self::OpenCv => 4,
            Self::OpenCvFisheye => 5,
            Self::FullOpenCv => 6,
        }
    }

    /// Number of parameters.
    pub fn num_params(self) -> usize {
        match self {
            Self::SimplePinhole => 3,
            Self::Pinhole | Self::SimpleRadial => 4,
            Self::Radial => 5,
            Self::OpenCv | Self::OpenCvFisheye => 8,
            Self::FullOpenCv => 12,
        }
    }

    /// Number of leading focal lengths: 1 (shared) or 2 (`fx`, `fy`).
    pub fn num_focals(self) -> usize {
        match self {
            Self::SimplePinhole | Self::SimpleRadial | Self::Radial => 1,
            _ => 2,
        }
    }

    /// Index of the first distortion parameter: focal lengths, then `cx, cy`, then distortion.
    pub fn distortion_start(self) -> usize {
        self.num_focals() + 2
    }
}
