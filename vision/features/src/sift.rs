//! SIFT: Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004.

mod extrema;
mod math;
mod patch;
mod pyramid;
mod selection;

use volery_scene::{Descriptor, Features, GrayImage, Keypoint};

use crate::simd::SimdLevel;
use extrema::{Thresholds, find_extrema};
use patch::{Place, Samples};
use pyramid::{NUM_LEVELS, Plane};

/// The last octave is the one whose shorter side falls below this.
const MIN_OCTAVE_SIDE: usize = 24;

/// Options of [`detect_and_describe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftOptions {
    /// Most features kept, spread evenly over the image and its scales.
    pub max_features: usize,
    /// -1 doubles the image first, 0 starts at its own size.
    pub first_octave: i32,
    /// Least DoG contrast, of a gray range of 1. COLMAP's 0.02 / 3 leaves walls too bare: at this
    /// one maps err a quarter less (docs/decisions/0005).
    pub peak_threshold: f32,
    /// Greatest ratio of principal curvatures (COLMAP's 10).
    pub edge_threshold: f32,
    /// All orientations are this angle (radians); `None` estimates them.
    pub upright: Option<f32>,
}

impl Default for SiftOptions {
    fn default() -> Self {
        Self {
            max_features: 8192,
            first_octave: -1,
            peak_threshold: 0.014 / 3.0,
            edge_threshold: 10.0,
            upright: None,
        }
    }
}

/// SIFT features of an image, coarsest first, so that a prefix is a usable smaller set.
///
/// Runs on the calling thread; the same image gives the same bits on every processor of one
/// architecture. An image without contrast, or too small for an octave, has no features.
pub fn detect_and_describe(image: &GrayImage, options: &SiftOptions) -> Features {
    detect_and_describe_with(SimdLevel::detect(), image, options)
}

/// A keypoint without orientation, with its place in the scale space.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// Pixels of the image.
    x: f32,
    y: f32,
    /// Position in the list of octaves.
    octave: usize,
    level: usize,
    place: Place,
    /// Pixels of the image per pixel of the octave.
    step: f32,
    response: f32,
}

fn detect_and_describe_with(simd: SimdLevel, image: &GrayImage, options: &SiftOptions) -> Features {
    if image.width() == 0 || image.height() == 0 || options.max_features == 0 {
        return Features::default();
    }
    let octaves = scale_space(simd, image, options.first_octave);
    let candidates = find_candidates(simd, &octaves, options);
    let size = [image.width() as f32, image.height() as f32];
    let wanted = selection::select(&candidates, size, options.max_features);

    let mut samples = Samples::default();
    let mut oriented: Vec<(&Candidate, f32)> = Vec::with_capacity(options.max_features);
    for index in wanted {
        let candidate = &candidates[index];
        if let Some(angle) = options.upright {
            oriented.push((candidate, angle));
            continue;
        }
        let plane = &octaves[candidate.octave].levels[candidate.level];
        for angle in patch::orientations(simd, plane, candidate.place, &mut samples) {
            oriented.push((candidate, angle));
        }
        if oriented.len() >= options.max_features {
            break;
        }
    }
    oriented.truncate(options.max_features);
    oriented.sort_by(|(a, angle_a), (b, angle_b)| {
        let scale = |c: &Candidate| c.place.sigma * c.step;
        scale(b)
            .total_cmp(&scale(a))
            .then(a.y.total_cmp(&b.y))
            .then(a.x.total_cmp(&b.x))
            .then(angle_a.total_cmp(angle_b))
    });
    describe(simd, &octaves, &oriented, &mut samples)
}

fn describe(
    simd: SimdLevel,
    octaves: &[Octave],
    oriented: &[(&Candidate, f32)],
    samples: &mut Samples,
) -> Features {
    let mut features = Features::default();
    for &(candidate, angle) in oriented {
        let plane = &octaves[candidate.octave].levels[candidate.level];
        let descriptor: Descriptor =
            patch::descriptor(simd, plane, candidate.place, angle, samples);
        features.keypoints.push(Keypoint {
            x: candidate.x,
            y: candidate.y,
            scale: candidate.place.sigma * candidate.step,
            orientation: angle,
        });
        features.descriptors.push(descriptor);
    }
    features
}

/// One octave: pixel (X, Y) lies at `(X, Y) * step + origin` of the image.
struct Octave {
    levels: [Plane; NUM_LEVELS],
    step: f32,
    origin: f32,
}

fn scale_space(simd: SimdLevel, image: &GrayImage, first_octave: i32) -> Vec<Octave> {
    let (mut base, mut step, origin) = if first_octave < 0 {
        (pyramid::doubled_base(simd, image), 0.5, 0.25)
    } else {
        (pyramid::base(simd, image), 1.0, 0.5)
    };
    let mut octaves = Vec::new();
    loop {
        let is_last = base.width.min(base.height) < MIN_OCTAVE_SIDE;
        let levels = pyramid::octave(simd, base);
        base = pyramid::halve(&levels[pyramid::SCALES_PER_OCTAVE]);
        octaves.push(Octave { levels, step, origin });
        step *= 2.0;
        if is_last {
            return octaves;
        }
    }
}

fn find_candidates(simd: SimdLevel, octaves: &[Octave], options: &SiftOptions) -> Vec<Candidate> {
    let thresholds = Thresholds { peak: options.peak_threshold, edge: options.edge_threshold };
    let first_step = octaves[0].step;
    let mut candidates = Vec::new();
    for (index, octave) in octaves.iter().enumerate() {
        for extremum in find_extrema(simd, &octave.levels, thresholds) {
            let sigma = pyramid::true_sigma(extremum.level, octave.step / first_step);
            candidates.push(Candidate {
                x: extremum.x * octave.step + octave.origin,
                y: extremum.y * octave.step + octave.origin,
                octave: index,
                level: extremum.nearest_level,
                place: Place { x: extremum.x, y: extremum.y, sigma },
                step: octave.step,
                response: extremum.response,
            });
        }
    }
    candidates
}

#[cfg(test)]
mod tests;
