use nalgebra::Vector3;
use volery_geometry::Rng;
use volery_synthetic::{Room, ScanOptions, Zone};

use super::*;
use crate::test_zones::{off, whole};
use crate::{NearbyOptions, register_nearby};

fn two_scans(num_points: usize) -> [Zone; 2] {
    let room = Room::random(Vector3::new(8.0, 6.0, 3.0), 5.0, 4);
    [1, 2].map(|seed| whole(&room, num_points, seed))
}

fn surfels(zone: &Zone) -> Surfels {
    Surfels::new(&zone.cloud, 0.05).unwrap()
}

fn slip(length: f64, angle: f64, rng: &mut Rng) -> Similarity3<f64> {
    let [shift, axis] = [(); 2].map(|()| rng.normal3().normalize());
    Similarity3::new(shift * length, axis * angle, 1.0)
}

/// P54: neither pairing nor moving raises `E(R, t) = 1/Nₚ Σ ‖xᵢ − R pᵢ − t‖²`, and the cost told
/// is that formula over the nearest points, searched plainly.
#[test]
fn the_cost_of_the_paper_falls_and_is_its_formula() {
    let [a, b] = two_scans(3000).map(|zone| Surfels::new(&zone.cloud, 0.2).unwrap());
    let start = slip(0.4, 0.1, &mut Rng::new(1));
    let options = IcpOptions {
        metric: Metric::PointToPoint,
        kernel: Kernel::Squared,
        max_distance: f64::INFINITY,
        max_iterations: 60,
        ..Default::default()
    };
    let found = icp(a.pieces(), &b, &start, &options).unwrap();
    assert!(found.costs.len() > 5, "{:?}", found.costs);
    assert!(found.costs.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-12)));
    assert!(found.costs.last().unwrap() < &(0.5 * found.costs[0]));
    let plain: f64 = a
        .pieces()
        .iter()
        .map(|p| {
            let at = start * p.position;
            let distances = b.pieces().iter().map(|x| (x.position - at).norm_squared());
            distances.fold(f64::INFINITY, f64::min)
        })
        .sum();
    let plain = plain / a.pieces().len() as f64;
    assert!((found.costs[0] / plain - 1.0).abs() < 1e-12);
}

/// A step of the plane metrics lowers their cost, and from the truth they do not move away: the
/// gradient is that of the cost.
#[test]
fn exact_copies_are_brought_together_exactly() {
    let [a, _] = two_scans(20_000);
    let target = surfels(&a);
    for metric in [Metric::PointToPoint, Metric::PointToPlane, Metric::Generalized] {
        for kernel in [Kernel::Squared, Kernel::Huber, Kernel::Cauchy, Kernel::Tukey] {
            let options = IcpOptions { metric, kernel, max_distance: 0.1, ..Default::default() };
            let start = slip(0.01, 0.001, &mut Rng::new(2));
            let found = icp(target.pieces(), &target, &start, &options).unwrap();
            let (shift, turn) =
                off(&found.target_from_source, &Similarity3::identity(), &a.viewpoints[0]);
            assert!(shift < 1e-5 && turn < 1e-5, "{metric:?} {kernel:?}: {shift} {turn}");
            assert!(found.converged && found.rms < 1e-5);
        }
    }
}

/// The nearest points along a wall hold plain point-to-point back, the more so where zones share
/// only a part; the plane metrics end within 2 mm from every start.
#[test]
fn planes_arrive_where_points_stick() {
    let room = Room::random(Vector3::new(10.0, 6.0, 3.0), 8.0, 2);
    let scans =
        room.zones([2, 1], 0.5, &ScanOptions { num_points: 40_000, ..Default::default() }, 1);
    let [a, b] = [0, 1].map(|k| surfels(&scans[k]));
    let middle = a.center();
    let error = |metric, seed| {
        let start = slip(0.25, 0.04, &mut Rng::new(seed));
        let options = NearbyOptions { metric, ..Default::default() };
        let found = register_nearby(&a, &b, &start, &options).unwrap();
        off(&found.target_from_source, &Similarity3::identity(), &middle).0
    };
    let mut stuck = 0;
    for seed in 0..8 {
        let point = error(Metric::PointToPoint, seed);
        let [plane, generalized] =
            [Metric::PointToPlane, Metric::Generalized].map(|m| error(m, seed));
        assert!(plane < 0.002 && generalized < 0.002, "{seed}: {plane} {generalized}");
        stuck += usize::from(point > 0.010);
    }
    assert!(stuck >= 4, "{stuck} of 8");
}

/// A third of the source is somewhere else: without trimming or a kernel it drags.
#[test]
fn robust_kernels_and_trimming_leave_out_what_does_not_belong() {
    let [a, b] = two_scans(30_000).map(|zone| surfels(&zone));
    let mut source: Vec<Surfel> = a.pieces().iter().step_by(3).copied().collect();
    let third = source.len() / 3;
    for piece in source.iter_mut().step_by(3).take(third) {
        piece.position += piece.normal * 0.12;
    }
    let run = |kernel, kept| {
        let options = IcpOptions {
            metric: Metric::PointToPlane,
            kernel,
            kept,
            max_distance: 0.3,
            ..Default::default()
        };
        let found = icp(&source, &b, &slip(0.03, 0.005, &mut Rng::new(3)), &options).unwrap();
        off(&found.target_from_source, &Similarity3::identity(), &a.center()).0
    };
    let squared = run(Kernel::Squared, 1.0);
    for (kernel, kept) in [(Kernel::Squared, 0.6), (Kernel::Cauchy, 1.0), (Kernel::Tukey, 1.0)] {
        let robust = run(kernel, kept);
        assert!(robust < 0.002, "{kernel:?} {kept}: {robust}, squared {squared}");
    }
    assert!(run(Kernel::Huber, 1.0) < squared);
}

#[test]
fn two_hundred_thousand_points_come_together() {
    let [a, b] = two_scans(100_000).map(|zone| surfels(&zone));
    let start = slip(0.2, 0.06, &mut Rng::new(1));
    for metric in [Metric::PointToPlane, Metric::Generalized] {
        let options = NearbyOptions { metric, ..Default::default() };
        let found = register_nearby(&a, &b, &start, &options).unwrap();
        let (shift, turn) = off(&found.target_from_source, &Similarity3::identity(), &a.center());
        assert!(shift < 0.002 && turn.to_degrees() < 0.02, "{metric:?}: {shift} {turn}");
    }
}

#[test]
fn bad_options_are_named_and_distance_is_no_overlap() {
    let [a, _] = two_scans(3000);
    let target = surfels(&a);
    let run = |options: IcpOptions, start: Similarity3<f64>| {
        icp(target.pieces(), &target, &start, &options)
    };
    let good = IcpOptions::default();
    for (name, options) in [
        ("kept", IcpOptions { kept: 0.0, ..good }),
        ("kept", IcpOptions { kept: f64::NAN, ..good }),
        ("max_distance", IcpOptions { max_distance: -1.0, ..good }),
        ("max_iterations", IcpOptions { max_iterations: 0, ..good }),
    ] {
        let error = run(options, Similarity3::identity()).unwrap_err();
        assert!(matches!(error, RegistrationError::Option { name: n, .. } if n == name));
    }
    let far = Similarity3::new(Vector3::x() * 50.0, Vector3::zeros(), 1.0);
    assert_eq!(run(good, far).unwrap_err().code(), "no_overlap");
}
