//! Features and two-view geometries as bytes, for the cache between stages.
//!
//! Little endian; eight bytes of kind and version first, then a 64-bit count, then records of
//! fixed layout. What is written is what is read, bit for bit.

use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion};
use volery_scene::{
    DESCRIPTOR_LEN, FeatureMatch, Features, ImageId, Keypoint, TwoViewGeometry, TwoViewKind,
};

use crate::bytes::{ByteReader, OutOfBytes};

const FEATURES_KIND: &[u8; 8] = b"VLRYFEA1";
const PAIRS_KIND: &[u8; 8] = b"VLRYTVG1";

/// x, y, scale, orientation.
const KEYPOINT_BYTES: usize = 16;
/// Two ids, kind and presence flags, count of putative matches, parallax, count of matches.
const MIN_PAIR_BYTES: usize = 4 + 4 + 1 + 1 + 8 + 8 + 8;
const MATCH_BYTES: usize = 8;

/// Why cached bytes were refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FeaturesFileError {
    /// Other bytes, or of another version.
    #[error("not a file of this kind and version")]
    WrongKind,
    /// Cut off or inconsistent.
    #[error("the file is damaged at byte {offset}")]
    Damaged {
        /// Where.
        offset: usize,
    },
}

impl From<OutOfBytes> for FeaturesFileError {
    fn from(error: OutOfBytes) -> Self {
        Self::Damaged { offset: error.offset }
    }
}

/// Bytes of the features of one image.
pub fn write_features(features: &Features) -> Vec<u8> {
    let record_bytes = KEYPOINT_BYTES + DESCRIPTOR_LEN;
    let mut bytes = Vec::with_capacity(16 + features.len() * record_bytes);
    bytes.extend(FEATURES_KIND);
    bytes.extend((features.len() as u64).to_le_bytes());
    for keypoint in &features.keypoints {
        for value in [keypoint.x, keypoint.y, keypoint.scale, keypoint.orientation] {
            bytes.extend(value.to_le_bytes());
        }
    }
    for descriptor in &features.descriptors {
        bytes.extend(descriptor);
    }
    bytes
}

/// The inverse of [`write_features`].
///
/// # Errors
///
/// [`FeaturesFileError`] for bytes of another kind or version, cut off or inconsistent.
pub fn read_features(bytes: &[u8]) -> Result<Features, FeaturesFileError> {
    let mut reader = open(bytes, FEATURES_KIND)?;
    let num_features = reader.count(KEYPOINT_BYTES + DESCRIPTOR_LEN)?;
    let mut features = Features {
        keypoints: Vec::with_capacity(num_features),
        descriptors: Vec::with_capacity(num_features),
    };
    for _ in 0..num_features {
        let offset = reader.offset();
        let [x, y, scale, orientation] =
            [reader.f32()?, reader.f32()?, reader.f32()?, reader.f32()?];
        if ![x, y, scale, orientation].iter().all(|value| value.is_finite()) {
            return Err(FeaturesFileError::Damaged { offset });
        }
        features.keypoints.push(Keypoint { x, y, scale, orientation });
    }
    for _ in 0..num_features {
        let descriptor = reader.take(DESCRIPTOR_LEN)?.try_into().expect("length was taken");
        features.descriptors.push(descriptor);
    }
    at_end(&reader)?;
    Ok(features)
}

/// Bytes of a list of verified pairs.
pub fn write_two_view_geometries(pairs: &[TwoViewGeometry]) -> Vec<u8> {
    let mut bytes = PAIRS_KIND.to_vec();
    bytes.extend((pairs.len() as u64).to_le_bytes());
    for pair in pairs {
        bytes.extend(pair.image1.0.to_le_bytes());
        bytes.extend(pair.image2.0.to_le_bytes());
        bytes.push(number_of_kind(pair.kind));
        let present =
            [pair.cam2_from_cam1.is_some(), pair.fundamental.is_some(), pair.homography.is_some()];
        bytes.push(present.iter().enumerate().map(|(bit, &is)| u8::from(is) << bit).sum());
        bytes.extend((pair.num_putative as u64).to_le_bytes());
        bytes.extend(pair.median_parallax.to_le_bytes());
        if let Some(pose) = &pair.cam2_from_cam1 {
            // nalgebra's order: x, y, z, w.
            let numbers = pose.rotation.coords.iter().chain(pose.translation.vector.iter());
            bytes.extend(numbers.flat_map(|v| v.to_le_bytes()));
        }
        for matrix in [&pair.fundamental, &pair.homography].into_iter().flatten() {
            bytes.extend(matrix.iter().flat_map(|v| v.to_le_bytes()));
        }
        bytes.extend((pair.matches.len() as u64).to_le_bytes());
        for m in &pair.matches {
            bytes.extend(m.feature1.to_le_bytes());
            bytes.extend(m.feature2.to_le_bytes());
        }
    }
    bytes
}

/// The inverse of [`write_two_view_geometries`]. Feature indices are not checked here: the
/// features are not at hand.
///
/// # Errors
///
/// [`FeaturesFileError`] for bytes of another kind or version, cut off or inconsistent.
pub fn read_two_view_geometries(bytes: &[u8]) -> Result<Vec<TwoViewGeometry>, FeaturesFileError> {
    let mut reader = open(bytes, PAIRS_KIND)?;
    let num_pairs = reader.count(MIN_PAIR_BYTES)?;
    let mut pairs = Vec::with_capacity(num_pairs);
    for _ in 0..num_pairs {
        pairs.push(read_pair(&mut reader)?);
    }
    at_end(&reader)?;
    Ok(pairs)
}

fn read_pair(reader: &mut ByteReader) -> Result<TwoViewGeometry, FeaturesFileError> {
    let offset = reader.offset();
    let damaged = FeaturesFileError::Damaged { offset };
    let (image1, image2) = (ImageId(reader.u32()?), ImageId(reader.u32()?));
    let kind = kind_of_number(reader.u8()?).ok_or(damaged.clone())?;
    let present = reader.u8()?;
    if image1 >= image2 || present >= 8 {
        return Err(damaged);
    }
    let num_putative = usize::try_from(reader.u64()?).map_err(|_| damaged.clone())?;
    let median_parallax = finite(reader)?;
    let cam2_from_cam1 = if present & 1 != 0 { Some(read_pose(reader)?) } else { None };
    let fundamental = if present & 2 != 0 { Some(read_matrix(reader)?) } else { None };
    let homography = if present & 4 != 0 { Some(read_matrix(reader)?) } else { None };
    let num_matches = reader.count(MATCH_BYTES)?;
    let mut matches = Vec::with_capacity(num_matches);
    for _ in 0..num_matches {
        matches.push(FeatureMatch { feature1: reader.u32()?, feature2: reader.u32()? });
    }
    Ok(TwoViewGeometry {
        image1,
        image2,
        kind,
        matches,
        num_putative,
        cam2_from_cam1,
        fundamental,
        homography,
        median_parallax,
    })
}

fn number_of_kind(kind: TwoViewKind) -> u8 {
    match kind {
        TwoViewKind::General => 0,
        TwoViewKind::Planar => 1,
        TwoViewKind::RotationOnly => 2,
        TwoViewKind::Uncalibrated => 3,
    }
}

fn kind_of_number(number: u8) -> Option<TwoViewKind> {
    match number {
        0 => Some(TwoViewKind::General),
        1 => Some(TwoViewKind::Planar),
        2 => Some(TwoViewKind::RotationOnly),
        3 => Some(TwoViewKind::Uncalibrated),
        _ => None,
    }
}

fn finite(reader: &mut ByteReader) -> Result<f64, FeaturesFileError> {
    let offset = reader.offset();
    let value = reader.f64()?;
    if value.is_finite() { Ok(value) } else { Err(FeaturesFileError::Damaged { offset }) }
}

fn read_pose(reader: &mut ByteReader) -> Result<Isometry3<f64>, FeaturesFileError> {
    let offset = reader.offset();
    let [x, y, z, w] = [finite(reader)?, finite(reader)?, finite(reader)?, finite(reader)?];
    let quaternion = Quaternion::new(w, x, y, z);
    // Kept as written if it is a rotation: normalizing again would change its last bits.
    if (quaternion.norm_squared() - 1.0).abs() > 1e-6 {
        return Err(FeaturesFileError::Damaged { offset });
    }
    let rotation = UnitQuaternion::new_unchecked(quaternion);
    let translation = Translation3::new(finite(reader)?, finite(reader)?, finite(reader)?);
    Ok(Isometry3::from_parts(translation, rotation))
}

fn read_matrix(reader: &mut ByteReader) -> Result<Matrix3<f64>, FeaturesFileError> {
    let mut matrix = Matrix3::zeros();
    for value in matrix.iter_mut() {
        *value = finite(reader)?;
    }
    Ok(matrix)
}

fn open<'a>(bytes: &'a [u8], kind: &[u8; 8]) -> Result<ByteReader<'a>, FeaturesFileError> {
    let mut reader = ByteReader::new(bytes);
    match reader.take(8) {
        Ok(found) if found == kind => Ok(reader),
        _ => Err(FeaturesFileError::WrongKind),
    }
}

fn at_end(reader: &ByteReader) -> Result<(), FeaturesFileError> {
    if reader.is_at_end() {
        Ok(())
    } else {
        Err(FeaturesFileError::Damaged { offset: reader.offset() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn features() -> Features {
        let keypoint = |i: usize| Keypoint {
            x: i as f32 + 0.1,
            y: 1e-8,
            scale: 1.6,
            orientation: -3.0 + i as f32,
        };
        Features {
            keypoints: (0..3).map(keypoint).collect(),
            descriptors: (0..3).map(|i| [i as u8 * 40; DESCRIPTOR_LEN]).collect(),
        }
    }

    fn pairs() -> Vec<TwoViewGeometry> {
        let pose = Isometry3::from_parts(
            Translation3::new(0.6, 0.0, -0.8),
            UnitQuaternion::from_euler_angles(0.1, -0.7, 2.0),
        );
        let general = TwoViewGeometry {
            image1: ImageId(1),
            image2: ImageId(9),
            kind: TwoViewKind::General,
            matches: vec![FeatureMatch { feature1: 0, feature2: 7 }],
            num_putative: 12,
            cam2_from_cam1: Some(pose),
            fundamental: Some(Matrix3::new(1., 2., 3., 4., 5., 6., 7., 8., 1e-300)),
            homography: None,
            median_parallax: 0.1,
        };
        let uncalibrated = TwoViewGeometry {
            kind: TwoViewKind::Uncalibrated,
            matches: Vec::new(),
            cam2_from_cam1: None,
            homography: Some(Matrix3::identity()),
            ..general.clone()
        };
        vec![general, uncalibrated]
    }

    #[test]
    fn round_trips_are_exact() {
        assert_eq!(read_features(&write_features(&features())), Ok(features()));
        let empty = Features::default();
        assert_eq!(read_features(&write_features(&empty)), Ok(empty));
        assert_eq!(read_two_view_geometries(&write_two_view_geometries(&pairs())), Ok(pairs()));
        assert_eq!(read_two_view_geometries(&write_two_view_geometries(&[])), Ok(Vec::new()));
    }

    #[test]
    fn every_truncation_is_an_error() {
        let (features, pairs) = (write_features(&features()), write_two_view_geometries(&pairs()));
        for end in 0..features.len() {
            assert!(read_features(&features[..end]).is_err(), "cut at {end}");
        }
        for end in 0..pairs.len() {
            assert!(read_two_view_geometries(&pairs[..end]).is_err(), "cut at {end}");
        }
    }

    #[test]
    fn damaged_bytes_never_panic() {
        let whole = write_two_view_geometries(&pairs());
        for at in 0..whole.len() {
            for value in [0, 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                if let Ok(read) = read_two_view_geometries(&damaged) {
                    assert!(read.iter().all(|pair| pair.median_parallax.is_finite()));
                }
            }
        }
    }

    #[test]
    fn other_kinds_are_refused() {
        assert_eq!(
            read_features(&write_two_view_geometries(&[])),
            Err(FeaturesFileError::WrongKind)
        );
    }
}
