//! Minimal and linear solvers. None of them rejects outliers or allocates.

mod five_point;
mod fundamental;
mod homography;
mod null_space;
mod p3p;
pub mod polynomial;
mod rotation;

pub use five_point::relpose_5pt;
pub use fundamental::{fundamental_7pt, fundamental_8pt};
pub use homography::{homography_4pt, homography_dlt};
pub use p3p::p3p;
pub use rotation::{rotation_2pt, rotation_from_bearings};

#[cfg(test)]
mod tests;
