//! Matching and retrieval against brute force and known geometry.

mod common;

use common::{Random, textured};
use nalgebra::{Matrix3, Point2};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, global_descriptor,
    match_features, match_guided,
};
use volery_scene::{Descriptor, FeatureMatch, Features, Keypoint};

fn random_descriptor(random: &mut Random, largest: f32) -> Descriptor {
    std::array::from_fn(|_| random.range(0.0, largest) as u8)
}

fn near(descriptor: &Descriptor, random: &mut Random) -> Descriptor {
    descriptor.map(|b| (f32::from(b) + random.range(-6.0, 6.0)).clamp(0.0, 127.0) as u8)
}

/// Eq. (1) of the paper by the book, with ratio test, bound and cross check.
fn brute_force(a: &[Descriptor], b: &[Descriptor], max_ratio: f64) -> Vec<FeatureMatch> {
    let distance = |p: &Descriptor, q: &Descriptor| {
        p.iter().zip(q).map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2)).sum::<f64>().sqrt()
    };
    let nearest = |p: &Descriptor, all: &[Descriptor]| {
        let mut order: Vec<(f64, usize)> =
            all.iter().enumerate().map(|(i, q)| (distance(p, q), i)).collect();
        order.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        let distinct = order.get(1).is_none_or(|second| order[0].0 < max_ratio * second.0);
        (distinct && order[0].0 < 0.7 * 256.0).then_some(order[0].1)
    };
    let forward: Vec<_> = a.iter().map(|p| nearest(p, b)).collect();
    let backward: Vec<_> = b.iter().map(|q| nearest(q, a)).collect();
    (0..a.len())
        .filter_map(|i| {
            let j = forward[i]?;
            (backward[j] == Some(i))
                .then_some(FeatureMatch { feature1: i as u32, feature2: j as u32 })
        })
        .collect()
}

/// P15. The fast matcher is the formula, at sizes about the kernel's blocks.
#[test]
fn matches_equal_brute_force() {
    let mut random = Random(11);
    for (n, m) in [(0, 5), (5, 0), (1, 1), (1, 2), (3, 64), (64, 65), (129, 63), (200, 333)] {
        let a: Vec<Descriptor> = (0..n).map(|_| random_descriptor(&mut random, 40.0)).collect();
        let mut b: Vec<Descriptor> = (0..m).map(|_| random_descriptor(&mut random, 40.0)).collect();
        for j in 0..m.min(n) {
            if j % 3 != 0 {
                b[(j * 7) % m] = near(&a[j], &mut random);
            }
        }
        let (packed_a, packed_b) = (PackedDescriptors::new(&a), PackedDescriptors::new(&b));
        for max_ratio in [0.5f32, 0.8, 0.95, 1.0] {
            let matches = match_features(&packed_a, &packed_b, &MatchOptions { max_ratio });
            let expected = if n == 0 || m == 0 {
                Vec::new()
            } else {
                brute_force(&a, &b, f64::from(max_ratio))
            };
            assert_eq!(matches, expected, "{n} x {m}, ratio {max_ratio}");
        }
    }
}

/// The extremes of the bytes neither saturate nor overflow.
#[test]
fn extreme_bytes_are_exact() {
    let mut descriptors = vec![[127u8; 128], [0; 128]];
    for k in 0..8 {
        descriptors.push(std::array::from_fn(|i| if i % 8 == k { 127 } else { 0 }));
    }
    let packed = PackedDescriptors::new(&descriptors);
    let matches = match_features(&packed, &packed, &MatchOptions::default());
    let itself = |m: &FeatureMatch| m.feature1 == m.feature2;
    assert_eq!(matches.len(), descriptors.len());
    assert!(matches.iter().all(itself));
}

/// Two equal candidates are not distinct.
#[test]
fn duplicates_do_not_match() {
    let mut random = Random(4);
    let one = random_descriptor(&mut random, 40.0);
    let matches = match_features(
        &PackedDescriptors::new(&[one]),
        &PackedDescriptors::new(&[one, one]),
        &MatchOptions::default(),
    );
    assert!(matches.is_empty());
}

/// P18. With look-alikes elsewhere, the search along the line finds what the free one cannot;
/// every match obeys the line. A pure shift along x: `F = [t]ₓ`, lines are rows.
#[test]
fn guided_matching_finds_more() {
    let mut random = Random(21);
    let fundamental = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    let (mut features1, mut features2) = (Features::default(), Features::default());
    let (mut pixels1, mut pixels2) = (Vec::new(), Vec::new());
    let kinds: Vec<Descriptor> = (0..60).map(|_| random_descriptor(&mut random, 40.0)).collect();
    for i in 0..600 {
        // Every look is seen ten times, on rows far apart.
        let y = 10.0 + f64::from(i) * 0.75;
        let x = f64::from(random.range(20.0, 600.0));
        let shifted = Point2::new(x + f64::from(random.range(5.0, 40.0)), y);
        for (features, pixels, pixel) in [
            (&mut features1, &mut pixels1, Point2::new(x, y)),
            (&mut features2, &mut pixels2, shifted),
        ] {
            features.keypoints.push(Keypoint {
                x: pixel.x as f32,
                y: pixel.y as f32,
                scale: 2.0,
                orientation: 0.0,
            });
            features.descriptors.push(near(&kinds[i as usize % 60], &mut random));
            pixels.push(pixel);
        }
    }
    let options = MatchOptions::default();
    let free = match_features(
        &PackedDescriptors::new(&features1.descriptors),
        &PackedDescriptors::new(&features2.descriptors),
        &options,
    );
    let guided =
        match_guided(&features1, &pixels1, &features2, &pixels2, &fundamental, 2.0, &options);
    let right = |all: &[FeatureMatch]| all.iter().filter(|m| m.feature1 == m.feature2).count();
    assert!(right(&guided) >= right(&free));
    assert!(right(&guided) > 570, "{} of 600", right(&guided));
    assert!(guided.is_sorted());
    for m in &guided {
        let residual = pixels1[m.feature1 as usize].y - pixels2[m.feature2 as usize].y;
        assert!(residual.abs() <= 2.0);
    }

    // Lines of any slope, points that are not numbers, no points at all.
    for angle in [0.3f64, 1.2, 1.571, 2.5] {
        let turn = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), angle);
        let turned: Vec<Point2<f64>> =
            pixels2.iter().map(|p| Point2::from((turn * p.to_homogeneous()).xy())).collect();
        let fundamental = turn.matrix() * fundamental;
        let again =
            match_guided(&features1, &pixels1, &features2, &turned, &fundamental, 2.0, &options);
        assert_eq!(again, guided, "{angle}");
    }
    pixels2[5].x = f64::NAN;
    let without =
        match_guided(&features1, &pixels1, &features2, &pixels2, &fundamental, 2.0, &options);
    assert!(without.iter().all(|m| m.feature2 != 5));
    let none = Features::default();
    assert!(match_guided(&none, &[], &none, &[], &fundamental, 2.0, &options).is_empty());
}

/// Images of one place are more alike than images of different places.
#[test]
fn overlapping_images_are_alike() {
    let options = SiftOptions::default();
    let descriptors: Vec<_> = (100..106)
        .flat_map(|seed| {
            let canvas = textured(400, 240, seed);
            let crop = |left: usize| {
                let mut part = common::Canvas::new(300, 240, 0.0);
                part.paint(|x, y, _| canvas.sample(x + left as f32, y));
                global_descriptor(&detect_and_describe(&part.to_image(), &options))
            };
            [crop(0), crop(100)]
        })
        .collect();
    for (i, a) in descriptors.iter().enumerate() {
        assert!((a.similarity(a) - 1.0).abs() < 1e-4);
        let best = (0..descriptors.len()).filter(|&j| j != i).max_by(|&j, &k| {
            a.similarity(&descriptors[j]).total_cmp(&a.similarity(&descriptors[k]))
        });
        assert_eq!(best, Some(i ^ 1));
    }
    assert!(global_descriptor(&Features::default()).0.iter().all(|&v| v == 0.0));
}
