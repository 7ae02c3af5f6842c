//! How long work tells how far it is and learns that it should stop.

use serde::{Deserialize, Serialize};

/// Stages of a job in the order of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Bytes to pixels and features; unit: images.
    Features,
    /// Choice of image pairs; unit: images.
    Pairs,
    /// Descriptor matching and two-view geometry; unit: pairs.
    Matching,
    /// Poses and points; unit: images.
    Mapping,
    /// Gravity, scale, origin; unit: steps.
    Align,
    /// Files of the sparse map; unit: files.
    Export,
    /// Depth of every pixel; unit: images, each counted twice (alone, and beside the others).
    DepthMaps,
    /// Depth maps to one cloud; unit: images.
    Fusion,
    /// Oriented points to a surface; unit: steps.
    Meshing,
    /// Photos to the texture of a surface; unit: images, each counted twice (seen, and painted).
    Texturing,
}

impl Stage {
    /// Every stage in order.
    pub const ALL: [Self; 10] = [
        Self::Features,
        Self::Pairs,
        Self::Matching,
        Self::Mapping,
        Self::Align,
        Self::Export,
        Self::DepthMaps,
        Self::Fusion,
        Self::Meshing,
        Self::Texturing,
    ];

    /// Its name in the API.
    pub fn name(self) -> &'static str {
        match self {
            Self::Features => "features",
            Self::Pairs => "pairs",
            Self::Matching => "matching",
            Self::Mapping => "mapping",
            Self::Align => "align",
            Self::Export => "export",
            Self::DepthMaps => "depth_maps",
            Self::Fusion => "fusion",
            Self::Meshing => "meshing",
            Self::Texturing => "texturing",
        }
    }

    /// What `done` and `total` count.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Features
            | Self::Pairs
            | Self::Mapping
            | Self::DepthMaps
            | Self::Fusion
            | Self::Texturing => "images",
            Self::Matching => "pairs",
            Self::Align | Self::Meshing => "steps",
            Self::Export => "files",
        }
    }
}

/// The work was asked to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// A listener to long work. Called between units, from any thread.
pub trait Progress: Sync {
    /// `done` of `total` units of `stage` are finished.
    fn report(&self, stage: Stage, done: usize, total: usize);

    /// Whether the work should stop at the next unit.
    fn is_cancelled(&self) -> bool {
        false
    }

    /// [`Cancelled`] if the work should stop.
    fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}

/// Nobody listens.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn report(&self, _stage: Stage, _done: usize, _total: usize) {}
}
