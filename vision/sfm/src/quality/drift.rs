//! How far a map may have drifted: the errors of its keypoints, carried into its poses.
//!
//! A bootstrap to first order. Moving every keypoint by an error e moves the adjusted poses by
//!
//! ```text
//! δ = S⁻¹ J_cᵀ (I − Q Qᵀ) e,   S = J_cᵀ (I − Q Qᵀ) J_c
//! ```
//!
//! with the Jacobians of bundle adjustment by the poses (c) and by the points, of which Q is an
//! orthonormal basis; rows and errors are weighed by the square roots of its robust loss' weights. One factorization of S serves all draws of e. What the free
//! similarity of a reconstruction can take up is no error and is projected out.
//!
//! Keypoints do not err independently. Seen from ever new sides, a keypoint wanders over the
//! surface, and what follows it from image to image drifts with it. So the error of a draw is a
//! random walk along each track: it hardly hurts where images far apart in the sequence share
//! points, and adds up along a chain that never comes back. With independent errors the drift of
//! chains comes out several times too small.
//!
//! Source of the reduced system: Triggs et al., "Bundle Adjustment — A Modern Synthesis", 2000,
//! sections 6 and 9.

mod equations;

use nalgebra::{DMatrix, DVector, Vector2, Vector3};
use volery_geometry::{Rng, median};
use volery_scene::SparseModel;

use equations::{Equations, POSE_DIM};

/// Draws of the errors: where a single mode rules, the root mean square is known to a tenth.
const NUM_DRAWS: usize = 64;
/// Seed of the draws: a verdict is a function of its model.
const SEED: u64 = 0x64_72_69_66_74;
/// Step of a keypoint's walk per image of its track, in standard deviations of the residuals.
/// Kitchen and warehouse maps of known error, tied to 3, 6, 12 and all images, ask for 1.1 to 2.1.
const WALK_STEP: f64 = 2.0;
/// 95 % of the values of a few independent modes lie below so many root mean squares
/// (√(χ²₃ / 3) at 0.95).
const CONFIDENCE: f64 = 1.6;

/// Errors that a map stays below with 95 % confidence after the best alignment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Of positions, root mean square over the images, as a part of the median depth from which
    /// they see their points.
    pub position: f64,
    /// Of rotations, median over the images, radians.
    pub rotation: f64,
}

impl Drift {
    /// Nothing is known.
    const UNBOUNDED: Self = Self { position: f64::INFINITY, rotation: std::f64::consts::PI };

    /// The drift that `model` may have; unbounded if its points do not hold its poses together.
    pub fn of(model: &SparseModel) -> Self {
        Self::estimate(model).unwrap_or(Self::UNBOUNDED)
    }

    fn estimate(model: &SparseModel) -> Option<Self> {
        let equations = Equations::new(model)?;
        let step_px = WALK_STEP * equations.noise_px;
        let mut rng = Rng::new(SEED);
        let moves = equations.solve(NUM_DRAWS, |errors| {
            let mut error = Vector2::zeros();
            for chunk in errors.chunks_mut(32) {
                // Thousands of steps make a normal distribution; a bit is enough for each.
                let mut bits = rng.bits();
                for e in chunk {
                    let sign = |bit: u64| if bit & 1 == 0 { step_px } else { -step_px };
                    error += Vector2::new(sign(bits), sign(bits >> 1));
                    bits >>= 2;
                    *e = error;
                }
            }
        })?;
        let gauge = gauge(model, equations.depth);
        let num_images = model.images.len();
        let (mut position, mut rotations) = (0.0, vec![0.0; num_images]);
        for draw in moves.chunks_exact(gauge.nrows()) {
            let moved = world_moves(model, draw, equations.depth);
            let error = &moved - &gauge * gauge.tr_mul(&moved);
            for (rotation, of_image) in
                rotations.iter_mut().zip(error.as_slice().chunks_exact(POSE_DIM))
            {
                *rotation += of_image[..3].iter().map(|v| v * v).sum::<f64>();
                position += of_image[3..].iter().map(|v| v * v).sum::<f64>();
            }
        }
        let position = CONFIDENCE * (position / (NUM_DRAWS * num_images) as f64).sqrt();
        let rotation = CONFIDENCE * (median(&mut rotations)? / NUM_DRAWS as f64).sqrt();
        (position.is_finite() && rotation.is_finite()).then_some(Self { position, rotation })
    }
}

/// Per image the turn and the move of the center in the world that the twists (ω, τ) of
/// `cam_from_world` in `draw` mean; centers in units of `depth`.
fn world_moves(model: &SparseModel, draw: &[f64], depth: f64) -> DVector<f64> {
    let twists = draw.chunks_exact(POSE_DIM);
    DVector::from_iterator(
        draw.len(),
        model.images.values().zip(twists).flat_map(|(image, twist)| {
            let world_from_cam = image.cam_from_world.rotation.inverse();
            // C = −Rᵀ t moves by −Rᵀ τ.
            let turn = -(world_from_cam * Vector3::from_column_slice(&twist[..3]));
            let shift = -(world_from_cam * Vector3::from_column_slice(&twist[3..])) / depth;
            [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
        }),
    )
}

/// Orthonormal basis of the moves that a turn, a shift and a change of scale of the world make.
/// Turns of the cameras count as much as shifts by as many depths: both move what they see.
pub(super) fn gauge(model: &SparseModel, depth: f64) -> DMatrix<f64> {
    let mut basis = DMatrix::zeros(POSE_DIM * model.images.len(), 7);
    for (i, image) in model.images.values().enumerate() {
        let center = image.center().coords / depth;
        for axis in 0..3 {
            let unit = Vector3::ith(axis, 1.0);
            basis[(POSE_DIM * i + axis, axis)] = 1.0;
            basis.fixed_view_mut::<3, 1>(POSE_DIM * i + 3, axis).copy_from(&unit.cross(&center));
            basis[(POSE_DIM * i + 3 + axis, 3 + axis)] = 1.0;
            basis[(POSE_DIM * i + 3 + axis, 6)] = center[axis];
        }
    }
    basis.qr().q()
}
