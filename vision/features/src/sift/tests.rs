use super::*;
use crate::simd::SimdLevel;

/// A Gaussian blob on gray, pixel centers at half-integers.
fn blob(width: u32, height: u32, center: [f32; 2], sigma: f32, height_gray: f32) -> GrayImage {
    let pixels = (0..width * height).map(|i| {
        let (x, y) = ((i % width) as f32 + 0.5 - center[0], (i / width) as f32 + 0.5 - center[1]);
        (100.0 + height_gray * (-(x * x + y * y) / (2.0 * sigma * sigma)).exp()).round() as u8
    });
    GrayImage::new(width, height, pixels.collect()).unwrap()
}

/// P10, P11. The difference of Gaussians of variance V and kV peaks over a blob of variance T at
/// V = T/√k... in scales, at σ = T½ / 2^(1/6); the place is exact to a tenth of a pixel.
#[test]
fn blobs_are_found_where_they_are_at_their_scale() {
    for (index, sigma) in [1.8f32, 2.5, 3.7, 5.0, 7.3, 9.9].into_iter().enumerate() {
        for contrast in [100.0, -90.0] {
            let center = [60.3 + 0.17 * index as f32, 57.9 - 0.23 * index as f32];
            let image = blob(120, 110, center, sigma, contrast);
            let features = detect_and_describe(&image, &SiftOptions::default());
            // Rounding to whole gray levels rings the blob with weak extrema of its own.
            let miss = |k: &Keypoint| (k.x - center[0]).hypot(k.y - center[1]);
            let nearest = features
                .keypoints
                .iter()
                .min_by(|a, b| miss(a).total_cmp(&miss(b)))
                .expect("a blob is a feature");
            assert!(miss(nearest) < 0.1, "blob {sigma}: {} px off", miss(nearest));
            let expected = sigma / 2f32.powf(1.0 / 6.0);
            let ratio = nearest.scale / expected;
            assert!((0.9..1.15).contains(&ratio), "blob {sigma}: scale {}", nearest.scale);
        }
    }
}

/// P11. Half-pixel conventions: a mirrored image has mirrored keypoints, doubled or not.
#[test]
fn mirrored_images_have_mirrored_keypoints() {
    let (width, height) = (96, 80);
    let image = blob(width, height, [40.37, 31.81], 3.0, 100.0);
    let mirrored = image.pixels().chunks(width as usize).flat_map(|r| r.iter().rev().copied());
    let mirrored = GrayImage::new(width, height, mirrored.collect()).unwrap();
    for first_octave in [-1, 0] {
        let options = SiftOptions { first_octave, ..SiftOptions::default() };
        let a = detect_and_describe(&image, &options).keypoints[0];
        let b = detect_and_describe(&mirrored, &options).keypoints[0];
        assert!((a.x + b.x - width as f32).abs() < 0.04, "octave {first_octave}: {} {}", a.x, b.x);
        assert!((a.y - b.y).abs() < 0.02);
    }
}

/// P11. A straight edge has no place along itself.
#[test]
fn edges_give_no_keypoints() {
    let pixels = (0..100 * 100).map(|i| if i % 100 + (i / 100) / 3 < 60 { 50 } else { 200 });
    let image = GrayImage::new(100, 100, pixels.collect()).unwrap();
    let features = detect_and_describe(&image, &SiftOptions::default());
    let inside = |k: &&Keypoint| (20.0..80.0).contains(&k.x) && (20.0..80.0).contains(&k.y);
    let strong = features.keypoints.iter().filter(inside).filter(|k| k.scale > 2.0).count();
    assert_eq!(strong, 0);
}

/// Every instruction set gives the same bits.
#[test]
fn all_instruction_sets_agree() {
    let mut state = 1u32;
    let pixels = (0..157 * 123).map(|i| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let (x, y) = (i % 157, i / 157);
        (x * y / 40 % 160) as u8 + (state >> 27) as u8 + 40 * u8::from((x / 9 + y / 13) % 2 == 0)
    });
    let image = GrayImage::new(157, 123, pixels.collect()).unwrap();
    for first_octave in [-1, 0] {
        let options = SiftOptions { first_octave, ..SiftOptions::default() };
        let plain = detect_and_describe_with(SimdLevel::Portable, &image, &options);
        assert!(plain.len() > 100, "{}", plain.len());
        for &level in SimdLevel::available() {
            assert!(detect_and_describe_with(level, &image, &options) == plain, "{level:?}");
        }
    }
}

/// Nothing to find, and nothing to crash on.
#[test]
fn empty_tiny_constant_and_narrow_images() {
    let options = SiftOptions::default();
    for (width, height) in [(0, 0), (0, 5), (1, 1), (2, 1), (3, 3), (1, 3000), (3000, 2), (7, 2000)]
    {
        for value in [0u8, 255] {
            let pixels = vec![value; (width * height) as usize];
            let image = GrayImage::new(width, height, pixels).unwrap();
            assert!(detect_and_describe(&image, &options).is_empty(), "{width}x{height}");
        }
        let pixels = (0..width * height).map(|i| (i * i * 37 % 251) as u8).collect();
        let image = GrayImage::new(width, height, pixels).unwrap();
        for first_octave in [-1, 0] {
            let options = SiftOptions { first_octave, ..options };
            let features = detect_and_describe(&image, &options);
            assert!(features.keypoints.iter().all(|k| {
                (0.0..=width as f32).contains(&k.x)
                    && (0.0..=height as f32).contains(&k.y)
                    && k.scale.is_finite()
            }));
        }
    }
    let image = GrayImage::new(64, 64, vec![9; 64 * 64]).unwrap();
    assert!(detect_and_describe(&image, &options).is_empty());
}
