//! Normal equations of the observations, points eliminated.
//!
//! With `H = [U W; Wᵀ V]` over (poses and intrinsics, points), each damped 3×3 block of `V` is
//! factored as `L Lᵀ` and `Y = W L⁻ᵀ` is kept, so that the Schur complement is `U − Y Yᵀ`.

use std::ops::Range;

use super::layout::{LANES, Layout, NONE, POSE_DIM};
use super::lens::{ParamJacobian, fma};
use super::point_chart::PointChart;
use super::state::State;

/// Diagonal entries of a point below this part of the greatest are damped as if they had it.
const MIN_RELATIVE_DIAGONAL: f64 = 1e-9;

/// One block's row of `W` or `Y`: `[column of the point][lane of the block]`.
pub(super) type Factor = [[f64; LANES]; 3];

/// A block of the Hessian, rows by lanes.
pub(super) type Block = [[f64; LANES]; LANES];

/// What back substitution needs of an eliminated point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PointTerms {
    /// `1/l₀₀, l₁₀, 1/l₁₁, l₂₀, l₂₁, 1/l₂₂`; zero for a point that cannot move.
    lower: [f64; 6],
    /// `L⁻¹ g`.
    z: [f64; 3],
    gradient: [f64; 3],
    /// Diagonal that the damping scales.
    diagonal: [f64; 3],
}

/// Sums over observations that belong to one block.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BlockTerms {
    pub(super) hessian: Block,
    pub(super) gradient: [f64; LANES],
    /// `Y z`: what the elimination adds to the right-hand side.
    pub(super) eliminated: [f64; LANES],
}

/// Sums over a chunk of points, or over all.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    pub(super) blocks: Vec<BlockTerms>,
    pub(super) couplings: Vec<Block>,
}

impl Sums {
    pub(super) fn new(layout: &Layout) -> Self {
        Self {
            blocks: vec![BlockTerms::default(); layout.num_blocks()],
            couplings: vec![Block::default(); layout.couplings.len()],
        }
    }

    pub(super) fn clear(&mut self) {
        self.blocks.fill(BlockTerms::default());
        self.couplings.fill(Block::default());
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (sum, term) in self.blocks.iter_mut().zip(&other.blocks) {
            add_block(&mut sum.hessian, &term.hessian);
            for lane in 0..LANES {
                sum.gradient[lane] += term.gradient[lane];
                sum.eliminated[lane] += term.eliminated[lane];
            }
        }
        for (sum, term) in self.couplings.iter_mut().zip(&other.couplings) {
            add_block(sum, term);
        }
    }
}

fn add_block(sum: &mut Block, term: &Block) {
    for (sum, term) in sum.iter_mut().flatten().zip(term.iter().flatten()) {
        *sum += term;
    }
}

/// What a pass over the points reads.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a> {
    pub(super) layout: &'a Layout,
    pub(super) state: &'a State,
    /// Free points, in visiting order.
    pub(super) free_points: &'a [bool],
    /// 1 / (scale of the Cauchy loss)²; zero for least squares.
    pub(super) loss_scale_inv2: f64,
    pub(super) damping: f64,
}

/// Linearizes the observations of a chunk of points and eliminates the points.
///
/// `factors` and `terms` are those of the chunk, `sums` is cleared first.
#[inline(always)]
pub(super) fn linearize_chunk<const FMA: bool>(
    pass: &Pass<'_>,
    points: Range<usize>,
    factors: &mut [Factor],
    terms: &mut [PointTerms],
    sums: &mut Sums,
) {
    sums.clear();
    let layout = pass.layout;
    let first_factor = layout.factor_starts[points.start];
    for (terms, point) in terms.iter_mut().zip(points) {
        let of_point = layout.factor_starts[point]..layout.factor_starts[point + 1];
        let factors = &mut factors[of_point.start - first_factor..of_point.end - first_factor];
        factors.fill(Factor::default());
        let blocks = &layout.factor_blocks[of_point];

        let chart = PointChart::new(pass, point);
        let mut v = [0.0; 6];
        let mut gradient = [0.0; 3];
        let mut cursor = 0;
        for observation in layout.point_starts[point]..layout.point_starts[point + 1] {
            add_observation::<FMA>(
                pass,
                observation,
                (&pass.state.points[point], &chart),
                (blocks, &mut *factors, &mut cursor),
                (&mut v, &mut gradient),
                sums,
            );
        }
        *terms = if pass.free_points[point] {
            factor_point::<FMA>(&v, &gradient, pass.damping)
        } else {
            PointTerms::default()
        };
        for (factor, &block) in factors.iter_mut().zip(blocks) {
            eliminate::<FMA>(terms, factor, &mut sums.blocks[block as usize].eliminated);
        }
    }
}

/// Adds one observation to `U`, `W`, `V` and the gradient.
#[inline(always)]
fn add_observation<const FMA: bool>(
    pass: &Pass<'_>,
    observation: usize,
    (point, chart): (&[f64; 3], &PointChart),
    (blocks, factors, cursor): (&[u32], &mut [Factor], &mut usize),
    (v, gradient): (&mut [f64; 6], &mut [f64; 3]),
    sums: &mut Sums,
) {
    let layout = pass.layout;
    let pose_index = layout.observation_poses[observation] as usize;
    let pose = &pass.state.poses[pose_index];
    let pose_block = layout.pose_blocks[pose_index];
    let free = &layout.intrinsics[pose.camera as usize];
    let lens = &pass.state.lenses[pose.camera as usize];

    let p = pose.transform::<FMA>(point);
    let mut d_params = ParamJacobian::default();
    let wanted = (!free.params.is_empty()).then_some(&mut d_params);
    let Some(projection) = lens.project_with_jacobians::<FMA>(&p, wanted) else {
        return;
    };
    let pixel = &layout.observation_pixels[observation];
    let mut r = [projection.pixel[0] - pixel[0], projection.pixel[1] - pixel[1]];
    let squared = fma::<FMA>(r[0], r[0], r[1] * r[1]);
    // Iteratively reweighted least squares: ρ'(s) = 1 / (1 + s/c²).
    let sqrt_weight = (1.0 / fma::<FMA>(squared, pass.loss_scale_inv2, 1.0)).sqrt();
    let mut a = projection.d_point;
    for axis in 0..2 {
        r[axis] *= sqrt_weight;
        for value in &mut a[axis] {
            *value *= sqrt_weight;
        }
    }

    // d pixel / d point, in the world and then in the chart of the point.
    let j_world: [[f64; 3]; 2] = std::array::from_fn(|axis| {
        std::array::from_fn(|k| {
            let z = a[axis][2] * pose.rotation[2][k];
            let y = fma::<FMA>(a[axis][1], pose.rotation[1][k], z);
            fma::<FMA>(a[axis][0], pose.rotation[0][k], y)
        })
    });
    let j_x = [chart.pull_back::<FMA>(&j_world[0]), chart.pull_back::<FMA>(&j_world[1])];
    *v = [
        fma::<FMA>(j_x[0][0], j_x[0][0], fma::<FMA>(j_x[1][0], j_x[1][0], v[0])),
        fma::<FMA>(j_x[0][1], j_x[0][0], fma::<FMA>(j_x[1][1], j_x[1][0], v[1])),
        fma::<FMA>(j_x[0][1], j_x[0][1], fma::<FMA>(j_x[1][1], j_x[1][1], v[2])),
        fma::<FMA>(j_x[0][2], j_x[0][0], fma::<FMA>(j_x[1][2], j_x[1][0], v[3])),
        fma::<FMA>(j_x[0][2], j_x[0][1], fma::<FMA>(j_x[1][2], j_x[1][1], v[4])),
        fma::<FMA>(j_x[0][2], j_x[0][2], fma::<FMA>(j_x[1][2], j_x[1][2], v[5])),
    ];
    for k in 0..3 {
        gradient[k] = fma::<FMA>(j_x[0][k], r[0], fma::<FMA>(j_x[1][k], r[1], gradient[k]));
    }

    // d pixel / d ξ: the rows a become (p × a, a).
    let j_pose: [[f64; LANES]; 2] = std::array::from_fn(|axis| {
        let a = &a[axis];
        [
            p[1] * a[2] - p[2] * a[1],
            p[2] * a[0] - p[0] * a[2],
            p[0] * a[1] - p[1] * a[0],
            a[0],
            a[1],
            a[2],
            0.0,
            0.0,
        ]
    });
    if pose_block != NONE {
        let terms = &mut sums.blocks[pose_block as usize];
        add_outer::<FMA, POSE_DIM>(&mut terms.hessian, &j_pose, &j_pose);
        add_gradient::<FMA>(&mut terms.gradient, &j_pose, &r);
        if !factors.is_empty() {
            while blocks[*cursor] != pose_block {
                *cursor += 1;
            }
            add_factor::<FMA>(&mut factors[*cursor], &j_pose, &j_x);
        }
    }
    if free.params.is_empty() {
        return;
    }
    let j_camera: [[[f64; LANES]; 2]; 2] = std::array::from_fn(|piece| {
        std::array::from_fn(|axis| {
            std::array::from_fn(|lane| {
                let param = free.params.get(piece * LANES + lane);
                param.map_or(0.0, |&param| d_params[axis][param] * sqrt_weight)
            })
        })
    });
    for piece in 0..free.num_pieces() {
        let block = free.first_block + piece;
        let terms = &mut sums.blocks[block];
        add_outer::<FMA, LANES>(&mut terms.hessian, &j_camera[piece], &j_camera[piece]);
        add_gradient::<FMA>(&mut terms.gradient, &j_camera[piece], &r);
        if pose_block != NONE {
            let coupling = &mut sums.couplings[layout.coupling_starts[pose_block as usize] + piece];
            add_outer::<FMA, POSE_DIM>(coupling, &j_pose, &j_camera[piece]);
        }
        for column in piece + 1..free.num_pieces() {
            let coupling = &mut sums.couplings[layout.coupling_starts[block] + column - piece - 1];
            add_outer::<FMA, LANES>(coupling, &j_camera[piece], &j_camera[column]);
        }
        if let Some(factor) = blocks.iter().rposition(|&b| b as usize == block) {
            add_factor::<FMA>(&mut factors[factor], &j_camera[piece], &j_x);
        }
    }
}

/// `sum += Aᵀ B` over the first `ROWS` rows.
#[inline(always)]
fn add_outer<const FMA: bool, const ROWS: usize>(
    sum: &mut Block,
    a: &[[f64; LANES]; 2],
    b: &[[f64; LANES]; 2],
) {
    for row in 0..ROWS {
        for lane in 0..LANES {
            let second = fma::<FMA>(a[1][row], b[1][lane], sum[row][lane]);
            sum[row][lane] = fma::<FMA>(a[0][row], b[0][lane], second);
        }
    }
}

/// `sum += Jᵀ r`.
#[inline(always)]
fn add_gradient<const FMA: bool>(sum: &mut [f64; LANES], j: &[[f64; LANES]; 2], r: &[f64; 2]) {
    for lane in 0..LANES {
        sum[lane] = fma::<FMA>(j[0][lane], r[0], fma::<FMA>(j[1][lane], r[1], sum[lane]));
    }
}

/// `W += Jᵀ Jₓ`.
#[inline(always)]
fn add_factor<const FMA: bool>(w: &mut Factor, j: &[[f64; LANES]; 2], j_x: &[[f64; 3]; 2]) {
    for k in 0..3 {
        for lane in 0..LANES {
            let second = fma::<FMA>(j[1][lane], j_x[1][k], w[k][lane]);
            w[k][lane] = fma::<FMA>(j[0][lane], j_x[0][k], second);
        }
    }
}

/// Factors `V + λ D`; a point without information does not move.
#[inline(always)]
fn factor_point<const FMA: bool>(v: &[f64; 6], gradient: &[f64; 3], damping: f64) -> PointTerms {
    let floor = v[0].max(v[2]).max(v[5]) * MIN_RELATIVE_DIAGONAL;
    let diagonal = [v[0].max(floor), v[2].max(floor), v[5].max(floor)];
    let inverse_root = |pivot: f64| 1.0 / pivot.sqrt();
    let l00 = inverse_root(fma::<FMA>(damping, diagonal[0], v[0]));
    let (l10, l20) = (v[1] * l00, v[3] * l00);
    let l11 = inverse_root(fma::<FMA>(damping, diagonal[1], v[2] - l10 * l10));
    let l21 = (v[4] - l20 * l10) * l11;
    let l22 = inverse_root(fma::<FMA>(damping, diagonal[2], v[5] - l20 * l20 - l21 * l21));
    let z0 = gradient[0] * l00;
    let z1 = (gradient[1] - l10 * z0) * l11;
    let z2 = (gradient[2] - l20 * z0 - l21 * z1) * l22;
    let terms = PointTerms {
        lower: [l00, l10, l11, l20, l21, l22],
        z: [z0, z1, z2],
        gradient: *gradient,
        diagonal,
    };
    // A pivot that is not positive leaves an infinite or undefined root behind.
    let is_finite = terms.lower.iter().chain(&terms.z).sum::<f64>().is_finite();
    if is_finite { terms } else { PointTerms::default() }
}

/// `Y = W L⁻ᵀ` in place, and `eliminated += Y z`.
#[inline(always)]
fn eliminate<const FMA: bool>(
    terms: &PointTerms,
    factor: &mut Factor,
    eliminated: &mut [f64; LANES],
) {
    let [l00, l10, l11, l20, l21, l22] = terms.lower;
    for lane in 0..LANES {
        let y0 = factor[0][lane] * l00;
        let y1 = fma::<FMA>(-l10, y0, factor[1][lane]) * l11;
        let y2 = fma::<FMA>(-l21, y1, fma::<FMA>(-l20, y0, factor[2][lane])) * l22;
        (factor[0][lane], factor[1][lane], factor[2][lane]) = (y0, y1, y2);
        let sum = fma::<FMA>(y0, terms.z[0], eliminated[lane]);
        eliminated[lane] = fma::<FMA>(y2, terms.z[2], fma::<FMA>(y1, terms.z[1], sum));
    }
}

/// Moves the points of a chunk by back substitution, `Δx = −L⁻ᵀ (z + Σ Yᵀ δ)`, where `step` holds
/// δ by blocks. Returns the points' part of the predicted decrease, `½ (λ Δᵀ D Δ − gᵀ Δ)`.
#[inline(always)]
pub(super) fn step_points<const FMA: bool>(
    pass: &Pass<'_>,
    points: Range<usize>,
    factors: &[Factor],
    terms: &[PointTerms],
    step: &[[f64; LANES]],
    moved: &mut [[f64; 3]],
) -> f64 {
    let layout = pass.layout;
    let first_factor = layout.factor_starts[points.start];
    let mut predicted = 0.0;
    for ((terms, moved), point) in terms.iter().zip(moved).zip(points) {
        let of_point = layout.factor_starts[point]..layout.factor_starts[point + 1];
        let blocks = &layout.factor_blocks[of_point.clone()];
        let factors = &factors[of_point.start - first_factor..of_point.end - first_factor];
        let mut sums = [[0.0; LANES]; 3];
        for (factor, &block) in factors.iter().zip(blocks) {
            let delta = &step[block as usize];
            for k in 0..3 {
                for lane in 0..LANES {
                    sums[k][lane] = fma::<FMA>(factor[k][lane], delta[lane], sums[k][lane]);
                }
            }
        }
        let [s0, s1, s2]: [f64; 3] =
            std::array::from_fn(|k| terms.z[k] + sums[k].iter().sum::<f64>());
        let [l00, l10, l11, l20, l21, l22] = terms.lower;
        let d2 = -s2 * l22;
        let d1 = (-s1 - l21 * d2) * l11;
        let d0 = (-s0 - l10 * d1 - l20 * d2) * l00;
        let delta = [d0, d1, d2];
        *moved = if pass.free_points[point] {
            PointChart::new(pass, point).retract(&delta)
        } else {
            pass.state.points[point]
        };
        for (k, delta) in delta.iter().enumerate() {
            predicted +=
                0.5 * delta * (pass.damping * terms.diagonal[k] * delta - terms.gradient[k]);
        }
    }
    predicted
}
