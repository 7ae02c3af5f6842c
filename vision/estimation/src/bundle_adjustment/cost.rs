//! The robust cost, without derivatives.

use std::ops::Range;

use super::layout::Layout;
use super::lens::fma;
use super::state::State;

/// Squared error, pixels², that stands for a point behind the camera: as far off as the image is
/// wide and high. Bounded, so that a point may cross over when the others gain by it.
pub(super) fn squared_error_behind(camera: &volery_geometry::Camera) -> f64 {
    (f64::from(camera.width) + f64::from(camera.height)).powi(2)
}

/// `Σ ρ(s)` of Cauchy's loss `ρ(s) = c² ln(1 + s/c²)`, or of `ρ(s) = s` without a scale.
///
/// The logarithm of a product is the sum of the logarithms: one is taken where the product would
/// soon overflow, not one for each term.
struct LossSum {
    scale_inv2: f64,
    sum: f64,
    product: f64,
}

/// Leaves room for any believable factor.
const MAX_PRODUCT: f64 = 1e150;

impl LossSum {
    fn new(scale_inv2: f64) -> Self {
        Self { scale_inv2, sum: 0.0, product: 1.0 }
    }

    #[inline(always)]
    fn add(&mut self, squared: f64) {
        if self.scale_inv2 == 0.0 {
            self.sum += squared;
            return;
        }
        self.product *= 1.0 + squared * self.scale_inv2;
        if self.product > MAX_PRODUCT {
            self.sum += self.product.ln();
            self.product = 1.0;
        }
    }

    fn total(&self) -> f64 {
        if self.scale_inv2 == 0.0 {
            self.sum
        } else {
            (self.sum + self.product.ln()) / self.scale_inv2
        }
    }
}

/// `½ Σ ρ(‖r‖²)` over the observations of a chunk of points.
#[inline(always)]
pub(super) fn chunk_cost<const FMA: bool>(
    layout: &Layout,
    state: &State,
    loss_scale_inv2: f64,
    points: Range<usize>,
) -> f64 {
    let mut sum = LossSum::new(loss_scale_inv2);
    for point in points {
        for observation in layout.point_starts[point]..layout.point_starts[point + 1] {
            let pose = &state.poses[layout.observation_poses[observation] as usize];
            let in_cam = pose.transform::<FMA>(&state.points[point]);
            let squared = match state.lenses[pose.camera as usize].project::<FMA>(&in_cam) {
                Some(pixel) => {
                    let measured = &layout.observation_pixels[observation];
                    let (dx, dy) = (pixel[0] - measured[0], pixel[1] - measured[1]);
                    fma::<FMA>(dx, dx, dy * dy)
                }
                None => squared_error_behind(&state.cameras[pose.camera as usize]),
            };
            sum.add(squared);
        }
    }
    0.5 * sum.total()
}
