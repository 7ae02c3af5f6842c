//! Failures.

use nalgebra::Vector3;
use volery_geometry::AlignError;
use volery_scene::Cancelled;

/// A motion of the source that nothing in the overlap resists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FreeDirection {
    /// It slides along a unit vector of the target frame.
    Slide(Vector3<f64>),
    /// It turns about a unit vector of the target frame.
    Turn(Vector3<f64>),
    /// It grows and shrinks.
    Scale,
}

impl std::fmt::Display for FreeDirection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut along =
            |verb: &str, v: &Vector3<f64>| write!(f, "{verb} ({:.2} {:.2} {:.2})", v.x, v.y, v.z);
        match self {
            Self::Slide(direction) => along("slide along", direction),
            Self::Turn(axis) => along("turn about", axis),
            Self::Scale => f.write_str("scale"),
        }
    }
}

/// Why there is no transform.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RegistrationError {
    /// Asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A zone has too little surface.
    #[error("a zone needs at least {needed} points, got {got}")]
    TooFewPoints {
        /// What came.
        got: usize,
        /// What it takes.
        needed: usize,
    },
    /// A coordinate or a component of a normal that is no finite number.
    #[error("point {index}, its normal or a viewpoint is not finite")]
    NotFinite {
        /// Which one.
        index: usize,
    },
    /// An option out of range.
    #[error("{name} must not be {got}")]
    Option {
        /// Its name.
        name: &'static str,
        /// What came.
        got: f64,
    },
    /// Nothing speaks for a common part.
    #[error(
        "the zones do not overlap: {overlap:.2} of the smaller one agrees with the other, {contradiction:.2} of what both should see speaks against it"
    )]
    NoOverlap {
        /// Best share of the surface of the smaller zone that lies on the other, 0..1.
        overlap: f64,
        /// Share of it that the other zone saw through, 0..1.
        contradiction: f64,
    },
    /// The common part leaves motions free: a bare plane, a corridor.
    #[error("underconstrained: free to {}", list(.directions))]
    Underconstrained {
        /// Which.
        directions: Vec<FreeDirection>,
    },
    /// Two transforms explain the overlap about equally well.
    #[error(
        "ambiguous: two transforms that differ by {distance:.2} and {angle_deg:.0} degrees fit about equally well"
    )]
    Ambiguous {
        /// How far the second best moves the middle of the source.
        distance: f64,
        /// How far it turns the source.
        angle_deg: f64,
    },
    /// The shared points determine nothing.
    #[error(transparent)]
    Degenerate(#[from] AlignError),
}

impl RegistrationError {
    /// The stable code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Cancelled(_) => "cancelled",
            Self::TooFewPoints { .. } => "too_few_points",
            Self::NotFinite { .. } | Self::Option { .. } => "invalid",
            Self::NoOverlap { .. } => "no_overlap",
            Self::Underconstrained { .. } | Self::Degenerate(_) => "underconstrained",
            Self::Ambiguous { .. } => "ambiguous",
        }
    }
}

fn list(directions: &[FreeDirection]) -> String {
    directions.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}
