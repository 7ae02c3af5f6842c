//! The normal equations of a map, points eliminated.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, Matrix2x3, Matrix6, SMatrix, Vector2, Vector3};
use volery_cholesky::SparseCholesky;
use volery_geometry::median;
use volery_scene::{ImageId, Observation, Point3d, SparseModel};

/// Unknowns of a pose: ω and τ of the left perturbation `x ↦ Exp(ω) (R x + t) + τ`.
pub(super) const POSE_DIM: usize = 6;
/// Relative damping that holds the gauge, in which nothing pulls.
const DAMPING: f64 = 1e-10;
/// A point nearer to a camera than this part of the median depth says nothing of its pose but rounding.
const MIN_DEPTH: f64 = 1e-3;

/// One observation, linearized.
struct Sighting {
    image: usize,
    depth: f64,
    residual: Vector2<f64>,
    /// Square root of the weight of the Cauchy loss with a scale of one pixel, the widest of the last
    /// adjustments.
    root_weight: f64,
    /// Of the residual times `root_weight`.
    j_pose: SMatrix<f64, 2, 6>,
    j_point: Matrix2x3<f64>,
}

/// Sightings of a map by point.
pub(super) struct Equations {
    num_images: usize,
    points: Vec<Vec<Sighting>>,
    /// Standard deviation of a keypoint per axis, from the residuals.
    pub(super) noise_px: f64,
    /// Median depth of the sightings.
    pub(super) depth: f64,
}

impl Equations {
    /// `None` if there are not more measurements than unknowns.
    pub(super) fn new(model: &SparseModel) -> Option<Self> {
        let index_of: BTreeMap<ImageId, usize> =
            model.images.keys().enumerate().map(|(index, &id)| (id, index)).collect();
        let linearized = |point: &Point3d| -> Vec<Sighting> {
            point.track.iter().filter_map(|o| linearize(model, &index_of, point, o)).collect()
        };
        let mut points: Vec<_> =
            model.points.values().map(linearized).filter(|list| list.len() >= 2).collect();
        let depth = median(&mut points.iter().flatten().map(|s| s.depth).collect::<Vec<_>>())?;
        points.retain(|sightings| sightings.iter().all(|s| s.depth > MIN_DEPTH * depth));
        let (mut num, mut squares, mut weights) = (0, 0.0, 0.0);
        for s in points.iter().flatten() {
            num += 1;
            squares += (s.residual * s.root_weight).norm_squared();
            weights += s.root_weight.powi(2);
        }
        let freedom = 2.0 * f64::from(num)
            - 3.0 * points.len() as f64
            - (POSE_DIM * model.images.len()) as f64;
        if freedom < 1.0 {
            return None;
        }
        Some(Self {
            num_images: model.images.len(),
            points,
            noise_px: (squares / weights * f64::from(num) / freedom).sqrt(),
            depth,
        })
    }

    /// Moves of the poses for `num_draws` draws of keypoint errors, one column of `POSE_DIM`
    /// per image after another. `draw` fills in the errors of one track, in the order of the track.
    pub(super) fn solve(
        &self,
        num_draws: usize,
        mut draw: impl FnMut(&mut [Vector2<f64>]),
    ) -> Option<Vec<f64>> {
        let n = POSE_DIM * self.num_images;
        let mut matrix = ReducedMatrix::new(self.num_images);
        let mut columns = vec![0.0; n * num_draws];
        let mut errors = Vec::new();
        for sightings in &self.points {
            let basis = range_of_point(sightings);
            for (s, q_s) in sightings.iter().zip(&basis) {
                matrix.add(s.image, s.image, &s.j_pose.tr_mul(&s.j_pose));
                let y_s = q_s.tr_mul(&s.j_pose);
                for (t, q_t) in sightings.iter().zip(&basis).filter(|(t, _)| t.image >= s.image) {
                    matrix.add(s.image, t.image, &-(q_t.tr_mul(&t.j_pose).tr_mul(&y_s)));
                }
            }
            errors.resize(sightings.len(), Vector2::zeros());
            for column in columns.chunks_exact_mut(n) {
                draw(&mut errors);
                for (e, s) in errors.iter_mut().zip(sightings) {
                    *e *= s.root_weight;
                }
                let taken: Vector3<f64> = errors.iter().zip(&basis).map(|(e, q)| q.tr_mul(e)).sum();
                for ((s, e), q) in sightings.iter().zip(&errors).zip(&basis) {
                    let pull = s.j_pose.tr_mul(&(e - q * taken));
                    for (sum, value) in column[POSE_DIM * s.image..].iter_mut().zip(pull.iter()) {
                        *sum += value;
                    }
                }
            }
        }
        matrix.solve_in_place(&mut columns).then_some(columns)
    }
}

/// Per sighting of a point its rows of an orthonormal basis Q of what a move of the point does to the
/// pixels. The projection `I − Q Qᵀ` keeps S positive where `I − J_p (J_pᵀ J_p)⁻¹ J_pᵀ` loses it to
/// rounding: near a camera's center a point has huge Jacobians.
fn range_of_point(sightings: &[Sighting]) -> Vec<Matrix2x3<f64>> {
    let mut j_point = DMatrix::zeros(2 * sightings.len(), 3);
    for (k, s) in sightings.iter().enumerate() {
        j_point.fixed_view_mut::<2, 3>(2 * k, 0).copy_from(&s.j_point);
    }
    let q = j_point.qr().q();
    (0..sightings.len()).map(|k| q.fixed_view::<2, 3>(2 * k, 0).into_owned()).collect()
}

fn linearize(
    model: &SparseModel,
    index_of: &BTreeMap<ImageId, usize>,
    point: &Point3d,
    observation: &Observation,
) -> Option<Sighting> {
    let image = model.images.get(&observation.image)?;
    let pixel = image.keypoints.get(observation.keypoint as usize)?;
    let in_cam = image.cam_from_world * point.position;
    let projection = model.cameras.get(&image.camera)?.project_with_jacobians(&in_cam)?;
    let residual = projection.pixel - pixel;
    let mut j_pose = SMatrix::<f64, 2, 6>::zeros();
    let root_weight = (1.0 / (1.0 + residual.norm_squared())).sqrt();
    let d_point = projection.d_point * root_weight;
    j_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&(d_point * -in_cam.coords.cross_matrix()));
    j_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&d_point);
    Some(Sighting {
        image: *index_of.get(&observation.image)?,
        depth: in_cam.z,
        residual,
        root_weight,
        j_pose,
        j_point: d_point * image.cam_from_world.rotation.to_rotation_matrix().matrix(),
    })
}

/// S by blocks of its lower triangle, `(column, row)`.
struct ReducedMatrix {
    num_images: usize,
    blocks: BTreeMap<(usize, usize), Matrix6<f64>>,
}

impl ReducedMatrix {
    fn new(num_images: usize) -> Self {
        let blocks = (0..num_images).map(|i| ((i, i), Matrix6::zeros())).collect();
        Self { num_images, blocks }
    }

    fn add(&mut self, column: usize, row: usize, block: &Matrix6<f64>) {
        *self.blocks.entry((column, row)).or_default() += block;
    }

    /// Solves for all columns of `right`; `false` if S is not positive definite or too large.
    fn solve_in_place(mut self, right: &mut [f64]) -> bool {
        for (_, block) in self.blocks.iter_mut().filter(|((column, row), _)| column == row) {
            for k in 0..POSE_DIM {
                block[(k, k)] *= 1.0 + DAMPING;
            }
        }
        let (starts, rows, values) = self.scalar_columns();
        let num_columns = right.len() / (POSE_DIM * self.num_images).max(1);
        SparseCholesky::new(starts, rows, num_columns)
            .is_some_and(|mut cholesky| cholesky.solve_in_place(&values, right))
    }

    /// Column starts, row indices and values of the lower triangle, scalar by scalar.
    fn scalar_columns(&self) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in 0..self.num_images {
            for c in 0..POSE_DIM {
                for (&(_, j), block) in self.blocks.range((i, 0)..(i + 1, 0)) {
                    let first = if i == j { c } else { 0 };
                    rows.extend((first..POSE_DIM).map(|r| POSE_DIM * j + r));
                    values.extend((first..POSE_DIM).map(|r| block[(r, c)]));
                }
                starts.push(rows.len());
            }
        }
        (starts, rows, values)
    }
}
