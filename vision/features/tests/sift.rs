//! SIFT against what is known of drawn images.

mod common;

use common::{Canvas, Random, textured};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_scene::{Features, Keypoint};

/// Scales and turns about the center: `x' = c' + s R (x − c)`.
struct Warp {
    scale: f32,
    angle: f32,
    from: [f32; 2],
    to: [f32; 2],
}

impl Warp {
    /// Of a canvas, into one that holds a disk of the original.
    fn new(canvas: &Canvas, scale: f32, angle: f32) -> Self {
        let from = [canvas.width as f32 / 2.0, canvas.height as f32 / 2.0];
        Self { scale, angle, from, to: [from[0] * scale, from[1] * scale] }
    }

    fn apply(&self, x: f32, y: f32) -> [f32; 2] {
        let (sin, cos) = self.angle.sin_cos();
        let (dx, dy) = (x - self.from[0], y - self.from[1]);
        [
            self.to[0] + self.scale * (cos * dx - sin * dy),
            self.to[1] + self.scale * (sin * dx + cos * dy),
        ]
    }

    /// The warped canvas; every pixel is the mean of 5 x 5 samples, as a camera would see it.
    fn render(&self, canvas: &Canvas) -> Canvas {
        let size = |n: usize| (n as f32 * self.scale).round() as usize;
        let mut out = Canvas::new(size(canvas.width), size(canvas.height), 0.0);
        let (sin, cos) = self.angle.sin_cos();
        out.paint(|x, y, _| {
            let mut sum = 0.0;
            for k in 0..25 {
                let dx = (x + (k % 5) as f32 / 5.0 - 0.4 - self.to[0]) / self.scale;
                let dy = (y + (k / 5) as f32 / 5.0 - 0.4 - self.to[1]) / self.scale;
                let (u, v) = (cos * dx + sin * dy, -sin * dx + cos * dy);
                sum += canvas.sample(u + self.from[0], v + self.from[1]);
            }
            sum / 25.0
        });
        out
    }
}

fn angle_difference(a: f32, b: f32) -> f32 {
    let turn = std::f32::consts::TAU;
    let d = (a - b).rem_euclid(turn);
    d.min(turn - d)
}

/// Matched pairs and how many of them lie within `1.5` px of where the warp puts them.
fn matched(a: &Features, b: &Features, warp: &Warp) -> (Vec<(Keypoint, Keypoint)>, usize) {
    let pack = |f: &Features| PackedDescriptors::new(&f.descriptors);
    let matches = match_features(&pack(a), &pack(b), &MatchOptions::default());
    let pairs: Vec<_> = matches
        .iter()
        .map(|m| (a.keypoints[m.feature1 as usize], b.keypoints[m.feature2 as usize]))
        .collect();
    let right = pairs
        .iter()
        .filter(|(k, l)| {
            let [x, y] = warp.apply(k.x, k.y);
            (x - l.x).hypot(y - l.y) < 1.5 * warp.scale.max(1.0)
        })
        .count();
    (pairs, right)
}

/// P12, P13, P14. Turned and scaled images keep their features: repeatability, matches, their
/// exactness, and orientations that turn with the image.
#[test]
fn features_survive_turns_and_scales() {
    let canvas = textured(360, 300, 3);
    let options = SiftOptions::default();
    let original = detect_and_describe(&canvas.to_image(), &options);
    assert!(original.len() > 600, "{}", original.len());
    for (scale, degrees) in [
        (1.0f32, 0.0f32),
        (1.0, 30.0),
        (1.0, 90.0),
        (1.0, 137.0),
        (1.0, 200.0),
        (1.0, 315.0),
        (0.7, 20.0),
        (0.5, 0.0),
        (1.4, 250.0),
        (2.0, 45.0),
    ] {
        let warp = Warp::new(&canvas, scale, degrees.to_radians());
        let warped_canvas = warp.render(&canvas);
        let warped = detect_and_describe(&warped_canvas.to_image(), &options);
        // Of the features that stay in view and are not too small in either image.
        let (width, height) = (warped_canvas.width as f32, warped_canvas.height as f32);
        let expected: Vec<&Keypoint> = original
            .keypoints
            .iter()
            .filter(|k| {
                let [x, y] = warp.apply(k.x, k.y);
                let margin = 8.0 * k.scale * scale;
                (margin..width - margin).contains(&x)
                    && (margin..height - margin).contains(&y)
                    && k.scale * scale > 1.3
                    && k.scale > 1.3
            })
            .collect();
        let repeated = expected
            .iter()
            .filter(|k| {
                let [x, y] = warp.apply(k.x, k.y);
                let allowed = 0.5 * k.scale * scale;
                warped.keypoints.iter().any(|l| {
                    (x - l.x).hypot(y - l.y) < allowed
                        && (l.scale / (k.scale * scale)).ln().abs() < 0.35
                })
            })
            .count();
        let repeatability = repeated as f32 / expected.len() as f32;
        let (pairs, right) = matched(&original, &warped, &warp);
        let context = format!(
            "{scale}x {degrees} deg: {} expected, repeatability {repeatability}, {right} right of {}",
            expected.len(),
            pairs.len()
        );
        assert!(expected.len() > 100, "{context}");
        assert!(repeatability > 0.7, "{context}");
        assert!(right as f32 > 0.9 * expected.len() as f32, "{context}");
        assert!(right as f32 > 0.97 * pairs.len() as f32, "{context}");

        // In keypoint scales: the place of a feature is as sharp as the feature.
        let mut errors: Vec<f32> = pairs
            .iter()
            .map(|(k, l)| {
                let [x, y] = warp.apply(k.x, k.y);
                (x - l.x).hypot(y - l.y) / (k.scale * scale)
            })
            .collect();
        errors.sort_by(f32::total_cmp);
        let median = errors[errors.len() / 2];
        assert!(median < 0.13, "median {median} {context}");
        let mut turns: Vec<f32> = pairs
            .iter()
            .map(|(k, l)| angle_difference(l.orientation, k.orientation + warp.angle).to_degrees())
            .collect();
        turns.sort_by(f32::total_cmp);
        assert!(turns[turns.len() * 8 / 10] < 5.0, "{} deg {context}", turns[turns.len() * 8 / 10]);
    }
}

/// P13. 128 bytes of at most 127 whose norm is 256, whatever the contrast.
#[test]
fn descriptors_have_one_norm() {
    let features = detect_and_describe(&textured(320, 240, 5).to_image(), &SiftOptions::default());
    for descriptor in &features.descriptors {
        assert!(descriptor.iter().all(|&b| b <= 127));
        let norm = descriptor.iter().map(|&b| f32::from(b).powi(2)).sum::<f32>().sqrt();
        assert!((norm - 256.0).abs() < 4.0, "{norm}");
    }
}

/// P13. A change of light and contrast leaves descriptors nearly as they are.
#[test]
fn descriptors_do_not_see_the_light() {
    let canvas = textured(320, 240, 6);
    let mut dim = Canvas::new(320, 240, 0.0);
    dim.paint(|x, y, _| 20.0 + 0.6 * canvas.sample(x, y) + 0.05 * x);
    let options = SiftOptions::default();
    let (a, b) = (
        detect_and_describe(&canvas.to_image(), &options),
        detect_and_describe(&dim.to_image(), &options),
    );
    let warp = Warp::new(&canvas, 1.0, 0.0);
    let (_, right) = matched(&a, &b, &warp);
    assert!(right as f32 > 0.75 * a.len().min(b.len()) as f32, "{right} of {}", a.len());
}

/// The cap holds, and what is left covers the image and several scales.
#[test]
fn the_cap_keeps_features_spread() {
    let image = textured(640, 480, 8).to_image();
    let all = detect_and_describe(&image, &SiftOptions::default());
    for max_features in [0, 1, 10, 300] {
        let options = SiftOptions { max_features, ..SiftOptions::default() };
        let some = detect_and_describe(&image, &options);
        assert_eq!(some.len(), max_features.min(all.len()));
        assert_eq!(some.keypoints.len(), some.descriptors.len());
        assert!(some.keypoints.is_sorted_by(|a, b| a.scale >= b.scale));
        if max_features == 300 {
            let mut cells = [false; 48];
            for k in &some.keypoints {
                cells[(k.y / 80.0) as usize * 8 + (k.x / 80.0) as usize] = true;
            }
            assert!(cells.iter().filter(|&&c| c).count() >= 46);
            assert!(some.keypoints.iter().filter(|k| k.scale > 4.0).count() >= 20);
            assert!(some.keypoints.iter().filter(|k| k.scale < 2.0).count() >= 100);
        }
    }
}

/// Upright features all have the given angle, one for each place.
#[test]
fn upright_features_have_the_given_angle() {
    let image = textured(200, 200, 9).to_image();
    let options = SiftOptions { upright: Some(0.3), ..SiftOptions::default() };
    let features = detect_and_describe(&image, &options);
    assert!(features.len() > 100);
    assert!(features.keypoints.iter().all(|k| k.orientation == 0.3));
    let mut places: Vec<_> =
        features.keypoints.iter().map(|k| (k.x.to_bits(), k.y.to_bits())).collect();
    places.sort_unstable();
    places.dedup();
    assert!(places.len() as f32 > 0.99 * features.len() as f32);
}

/// Images extracted side by side give what they give alone.
#[test]
fn threads_change_nothing() {
    let images: Vec<_> = (0..4).map(|seed| textured(160, 120, seed).to_image()).collect();
    let options = SiftOptions::default();
    let alone: Vec<_> = images.iter().map(|i| detect_and_describe(i, &options)).collect();
    let together: Vec<Features> = std::thread::scope(|scope| {
        let handles: Vec<_> =
            images.iter().map(|i| scope.spawn(|| detect_and_describe(i, &options))).collect();
        handles.into_iter().map(|h| h.join().unwrap()).collect()
    });
    assert!(alone == together);
    let mut random = Random(1);
    assert!(random.unit() != random.unit());
}
