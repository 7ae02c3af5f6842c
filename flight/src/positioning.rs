//! Where a vehicle is by radio, sound or light instead of its camera: the systems that vision is
//! compared with.

mod comparison;
mod fix;
mod range;

pub use comparison::{Figures, compare};
pub use fix::{Fix, FixError, HorizontalFix, trilaterate, with_height};
pub use range::{PathLoss, Range};
