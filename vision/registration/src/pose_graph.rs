//! Many zones in one frame: the poses that agree best with all transforms between pairs.

use nalgebra::{DMatrix, DVector, Point3, Similarity3};
use volery_geometry::Rng;

use crate::constraint::{Constraint, Twist, TwistMatrix, twist};
use crate::icp::similarity_from_twist;

/// A link that is off by this many sigmas is wrong. Sigmas of registrations are small beside what
/// edges and occlusions do to them, and wrong links are off by thousands.
const OUTLIER_SIGMAS: f64 = 30.0;
const BOUND: f64 = OUTLIER_SIGMAS * OUTLIER_SIGMAS;
/// Of the order in which links are tried.
const SEED: u64 = 0x7ee5;
/// Chains of links that are tried as a start. With one wrong link in ten and twelve zones a third
/// of all chains is right.
const MAX_TREES: u64 = 300;
/// Steps of the search.
const NUM_STEPS: usize = 12;
/// Keeps zones where they are that no link holds.
const DAMPING: f64 = 1e-12;
/// Information on the scale of a link that has none of its own: both zones have one unit.
const SAME_UNIT: f64 = 1e12;
/// Times that a step is halved which makes the links agree less.
const MAX_HALVINGS: usize = 10;

/// A transform between two zones.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Which zone moves.
    pub source: usize,
    /// Which stays.
    pub target: usize,
    /// The transform.
    pub target_from_source: Similarity3<f64>,
    /// The center of its uncertainty, in the frame of the target.
    pub center: Point3<f64>,
    /// Inverse covariance of the twist about the center; nothing on scale means that it is known.
    pub information: TwistMatrix,
}

impl Link {
    fn known(&self) -> TwistMatrix {
        let mut information = self.information;
        if information[(6, 6)] == 0.0 {
            information[(6, 6)] = SAME_UNIT;
        }
        information
    }

    /// A transform as well known as its contacts tell.
    pub fn new(
        source: usize,
        target: usize,
        target_from_source: Similarity3<f64>,
        constraint: &Constraint,
    ) -> Self {
        let Constraint { center, information, .. } = *constraint;
        Self { source, target, target_from_source, center, information }
    }
}

/// Zones in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseGraph {
    /// Per zone; `None` where no chain of links leads to the reference.
    pub frame_from_zone: Vec<Option<Similarity3<f64>>>,
    /// Per link, from 0 (the others contradict it) to 1.
    pub weights: Vec<f64>,
}

/// Poses of zones in the frame of zone `reference`, which agree best with all links.
///
/// Minimizes `Σ ρ(rᵀ Λ r)` by Gauss–Newton, where `r` is the twist of
///
/// ```text
/// X_target⁻¹ X_source target_from_source⁻¹
/// ```
///
/// about the center of the link and `ρ` is that of Geman and McClure. Closed loops spread their
/// error over their links by what each knows. A wrong link is found out where a loop runs through
/// it: the search starts from the spanning tree of links with which most of the others agree.
/// Links to zones that do not exist are ignored.
///
/// # Source
///
/// Grisetti, Kuemmerle, Stachniss and Burgard, "A Tutorial on Graph-Based SLAM", ITSM 2010;
/// Govindu, "Robustness in Motion Averaging", ACCV 2006, section 4, for the start.
pub fn solve_pose_graph(num_zones: usize, links: &[Link], reference: usize) -> PoseGraph {
    let mut poses = best_tree(num_zones, links, reference);
    let used: Vec<usize> = (0..links.len()).filter(|&i| is_between(&links[i], &poses)).collect();
    let mut weights = vec![0.0; links.len()];
    for _ in 0..NUM_STEPS {
        for &i in &used {
            let share = 1.0 / (1.0 + error(&links[i], &poses) / BOUND);
            weights[i] = share * share;
        }
        step(&mut poses, links, &used, &weights, reference);
    }
    PoseGraph { frame_from_zone: poses, weights }
}

fn is_between(link: &Link, poses: &[Option<Similarity3<f64>>]) -> bool {
    let known = |zone: usize| poses.get(zone).is_some_and(Option::is_some);
    known(link.source) && known(link.target)
}

/// Poses along the tree with which most links agree; the first is that of the links with most
/// information.
fn best_tree(num_zones: usize, links: &[Link], reference: usize) -> Vec<Option<Similarity3<f64>>> {
    let mut order: Vec<&Link> =
        links.iter().filter(|l| l.source.max(l.target) < num_zones).collect();
    let strength = |link: &Link| link.information.fixed_view::<3, 3>(3, 3).trace();
    order.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    let mut best = (usize::MAX, Vec::new());
    for tree in 0..MAX_TREES {
        if tree > 0 {
            Rng::fork(SEED, tree).shuffle(&mut order);
        }
        let poses = along_links(num_zones, &order, reference);
        let disagrees = |link: &&&Link| is_between(link, &poses) && error(link, &poses) > BOUND;
        let num_wrong = order.iter().filter(disagrees).count();
        if num_wrong < best.0 {
            best = (num_wrong, poses);
        }
        if best.0 == 0 {
            break;
        }
    }
    best.1
}

/// Poses along chains of links, the first ones first.
fn along_links(
    num_zones: usize,
    order: &[&Link],
    reference: usize,
) -> Vec<Option<Similarity3<f64>>> {
    let mut poses = vec![None; num_zones];
    if reference < num_zones {
        poses[reference] = Some(Similarity3::identity());
    }
    loop {
        let next = order.iter().find(|l| poses[l.source].is_some() != poses[l.target].is_some());
        let Some(link) = next else { return poses };
        match (poses[link.source], poses[link.target]) {
            (None, Some(target)) => poses[link.source] = Some(target * link.target_from_source),
            (Some(source), None) => {
                poses[link.target] = Some(source * link.target_from_source.inverse());
            }
            _ => return poses,
        }
    }
}

/// How far the poses of its ends move a link, as a twist about its center.
fn residual(link: &Link, poses: &[Option<Similarity3<f64>>]) -> Option<Twist> {
    let (source, target) = (poses[link.source]?, poses[link.target]?);
    let change = target.inverse() * source * link.target_from_source.inverse();
    let moved = change * link.center - link.center;
    Some(twist(&change.isometry.rotation.scaled_axis(), &moved, change.scaling().ln()))
}

fn error(link: &Link, poses: &[Option<Similarity3<f64>>]) -> f64 {
    residual(link, poses).map_or(0.0, |r| r.dot(&(link.known() * r)))
}

/// One Gauss–Newton step. Zones move by twists about the origin of the frame.
fn step(
    poses: &mut [Option<Similarity3<f64>>],
    links: &[Link],
    used: &[usize],
    weights: &[f64],
    reference: usize,
) {
    let n = 7 * poses.len();
    let mut h = DMatrix::zeros(n, n);
    let mut g = DVector::zeros(n);
    for &i in used {
        let link = &links[i];
        let (Some(r), Some(target)) = (residual(link, poses), poses[link.target]) else { continue };
        // Both ends see the same motion of the center, with opposite signs.
        let j = derivative(link, &target);
        let weighted = j.transpose() * link.known() * weights[i];
        let (block, vector) = (weighted * j, weighted * r);
        let (s, t) = (7 * link.source, 7 * link.target);
        for (row, column, sign) in [(s, s, 1.0), (t, t, 1.0), (s, t, -1.0), (t, s, -1.0)] {
            let mut view = h.fixed_view_mut::<7, 7>(row, column);
            view += block * sign;
        }
        let mut view = g.fixed_rows_mut::<7>(s);
        view += vector;
        let mut view = g.fixed_rows_mut::<7>(t);
        view -= vector;
    }
    // The reference stays; zones without links do, too.
    let largest = h.diagonal().iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    for k in 0..n {
        let is_fixed = k / 7 == reference;
        if is_fixed {
            h.row_mut(k).fill(0.0);
            h.column_mut(k).fill(0.0);
            g[k] = 0.0;
        }
        h[(k, k)] += if is_fixed { largest } else { DAMPING * largest };
    }
    let Some(factor) = h.cholesky() else { return };
    let mut solved = factor.solve(&-g);
    let cost = |poses: &[Option<Similarity3<f64>>]| -> f64 {
        used.iter().map(|&i| weights[i] * error(&links[i], poses)).sum()
    };
    let before = cost(poses);
    for _ in 0..MAX_HALVINGS {
        let after = moved(poses, &solved);
        if cost(&after) <= before {
            poses.copy_from_slice(&after);
            return;
        }
        solved /= 2.0;
    }
}

fn moved(poses: &[Option<Similarity3<f64>>], by: &DVector<f64>) -> Vec<Option<Similarity3<f64>>> {
    let one = |(zone, pose): (usize, &Option<Similarity3<f64>>)| {
        let delta = Twist::from_fn(|k, _| by[7 * zone + k]);
        pose.map(|pose| similarity_from_twist(&Point3::origin(), &delta) * pose)
    };
    poses.iter().enumerate().map(one).collect()
}

/// Derivative of the twist of a link by one of its source, to first order.
fn derivative(link: &Link, frame_from_target: &Similarity3<f64>) -> TwistMatrix {
    // q: the center in the frame. A twist moves it by ω × q + τ + λ q, which the target sees
    // turned and scaled back.
    let q = (frame_from_target * link.center).coords;
    let back = frame_from_target.isometry.rotation.inverse().to_rotation_matrix();
    let scaled = back.matrix() / frame_from_target.scaling();
    let mut j = TwistMatrix::zeros();
    j.fixed_view_mut::<3, 3>(0, 0).copy_from(back.matrix());
    j.fixed_view_mut::<3, 3>(3, 0).copy_from(&(scaled * -q.cross_matrix()));
    j.fixed_view_mut::<3, 3>(3, 3).copy_from(&scaled);
    j.fixed_view_mut::<3, 1>(3, 6).copy_from(&(scaled * q));
    j[(6, 6)] = 1.0;
    j
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn random_pose(rng: &mut Rng, scale: f64) -> Similarity3<f64> {
        Similarity3::new(rng.normal3() * 5.0, rng.normal3(), scale)
    }

    /// Information of a link that knows turns to `angle`, shifts to `length` and scales to
    /// `scale`.
    fn information(angle: f64, length: f64, scale: Option<f64>) -> TwistMatrix {
        let lambda = scale.map_or(0.0, |s| 1.0 / (s * s));
        let [a, l] = [angle, length].map(|s| Vector3::repeat(1.0 / (s * s)));
        TwistMatrix::from_diagonal(&twist(&a, &l, lambda))
    }

    /// Truth of a ring of zones, and links around it and across with noise.
    fn ring(
        n: usize,
        noise: f64,
        with_scale: bool,
        seed: u64,
    ) -> (Vec<Similarity3<f64>>, Vec<Link>) {
        let mut rng = Rng::new(seed);
        let truth: Vec<_> = (0..n)
            .map(|_| {
                let scale = if with_scale { rng.range(0.5, 2.0) } else { 1.0 };
                random_pose(&mut rng, scale)
            })
            .collect();
        let pairs = (0..n).map(|i| (i, (i + 1) % n)).chain((0..n / 2).map(|i| (i, i + n / 2)));
        let links = pairs
            .map(|(source, target)| {
                let center = Point3::from(rng.normal3());
                let lambda = if with_scale { noise * rng.normal() } else { 0.0 };
                let error = twist(&(rng.normal3() * noise), &(rng.normal3() * noise), lambda);
                let exact = truth[target].inverse() * truth[source];
                let target_from_source = similarity_from_twist(&center, &error) * exact;
                let sigma = noise.max(1e-6);
                let information = information(sigma, sigma, with_scale.then_some(sigma));
                Link { source, target, target_from_source, center, information }
            })
            .collect();
        (truth, links)
    }

    /// Largest shift and turn against the truth, both from the reference.
    fn worst(found: &PoseGraph, truth: &[Similarity3<f64>], reference: usize) -> (f64, f64) {
        let mut worst = (0.0_f64, 0.0_f64);
        for (found, truth_here) in found.frame_from_zone.iter().zip(truth) {
            let expected = truth[reference].inverse() * truth_here;
            let error = expected.inverse() * found.unwrap();
            worst.0 = worst.0.max(error.isometry.translation.vector.norm());
            worst.0 = worst.0.max(error.scaling().ln().abs());
            worst.1 = worst.1.max(error.isometry.rotation.angle());
        }
        worst
    }

    #[test]
    fn exact_links_give_the_truth_back() {
        for with_scale in [false, true] {
            let (truth, links) = ring(9, 0.0, with_scale, 1);
            for reference in [0, 4] {
                let found = solve_pose_graph(9, &links, reference);
                let (shift, turn) = worst(&found, &truth, reference);
                assert!(shift < 1e-9 && turn < 1e-9, "{shift} {turn}");
                assert!(found.weights.iter().all(|&w| w > 0.999));
            }
        }
    }

    /// P52: closing loops makes it better than following a chain.
    #[test]
    fn loops_halve_the_error_of_a_chain() {
        let [mut closed, mut open] = [0.0; 2];
        for seed in 0..20 {
            let (truth, links) = ring(12, 1e-3, false, seed);
            closed += worst(&solve_pose_graph(12, &links, 0), &truth, 0).1;
            open += worst(&solve_pose_graph(12, &links[..11], 0), &truth, 0).1;
        }
        assert!(closed < 0.6 * open, "{closed} {open}");
    }

    /// The minimum is one: no small move of a zone makes the links agree better. Dies if a
    /// derivative is wrong.
    #[test]
    fn no_small_move_is_better() {
        for with_scale in [false, true] {
            let (_, links) = ring(8, 3e-3, with_scale, 7);
            let found = solve_pose_graph(8, &links, 0);
            let cost = |poses: &[Option<Similarity3<f64>>]| -> f64 {
                let robust = |link| {
                    let e: f64 = error(link, poses);
                    e / (1.0 + e / BOUND)
                };
                links.iter().map(robust).sum()
            };
            let least = cost(&found.frame_from_zone);
            for zone in 1..8 {
                for k in 0..(if with_scale { 7 } else { 6 }) {
                    for size in [-3e-4, 3e-4] {
                        let mut moved = found.frame_from_zone.clone();
                        let mut delta = Twist::zeros();
                        delta[k] = size;
                        let pose = moved[zone].unwrap();
                        moved[zone] = Some(similarity_from_twist(&Point3::origin(), &delta) * pose);
                        assert!(cost(&moved) > least, "zone {zone} along {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_wrong_link_is_found_out() {
        for seed in 0..10 {
            let (truth, mut links) = ring(12, 1e-3, false, seed);
            let mut rng = Rng::new(seed);
            let wrong = [3, 14];
            for i in wrong {
                links[i].target_from_source = random_pose(&mut rng, 1.0);
            }
            let found = solve_pose_graph(12, &links, 0);
            let (shift, turn) = worst(&found, &truth, 0);
            assert!(shift < 0.05 && turn < 0.01, "{seed}: {shift} {turn}");
            for (i, &weight) in found.weights.iter().enumerate() {
                assert_eq!(weight < 0.5, wrong.contains(&i), "{seed}: link {i} weighs {weight}");
            }
        }
    }

    #[test]
    fn zones_without_links_have_no_pose() {
        let (_, links) = ring(6, 0.0, false, 3);
        let found = solve_pose_graph(8, &links, 0);
        assert!(found.frame_from_zone[..6].iter().all(Option::is_some));
        assert_eq!(found.frame_from_zone[6..], [None, None]);
        let alone = solve_pose_graph(2, &[], 1);
        assert_eq!(alone.frame_from_zone, [None, Some(Similarity3::identity())]);
        // A link to nowhere is no link.
        assert_eq!(solve_pose_graph(2, &links[4..5], 0).frame_from_zone[1], None);
        assert_eq!(solve_pose_graph(0, &[], 0).frame_from_zone, []);
    }
}
