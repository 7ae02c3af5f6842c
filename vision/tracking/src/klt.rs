//! Where a patch of one image lies in another.

use nalgebra::{Matrix2, Point2, Vector2};
use volery_geometry::SimdLevel;

use crate::pyramid::{BORDER, Level};
use crate::simd::{AREA, Patch, SIDE, sums};

const MAX_ITERATIONS: usize = 12;
/// Steps below which a patch has come to rest, pixels.
const SMALL_STEP: f32 = 0.02;
/// A patch is not moved further on one level, pixels.
const MAX_MOVE: f32 = 6.0;
/// Least mean square slope of a patch along its flattest direction, squared levels per pixel: that
/// of the noise of a fair camera.
const MIN_SLOPE: f32 = 1.5;

/// A patch of an image, to be found in others.
pub(crate) struct Template {
    /// Without their mean.
    values: Patch,
    /// Slopes, without what gain and offset can explain.
    slopes: [Patch; 2],
    /// Σ T²
    square: f32,
    /// (Σ G Gᵀ)⁻¹
    inverse: [f32; 3],
}

/// Where a template was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Found {
    /// Pixels of the level.
    pub(crate) place: Point2<f32>,
    /// Correlation there, −1 to 1.
    pub(crate) likeness: f32,
}

impl Template {
    /// The patch of `level` around `center` as another camera sees it: pixel `d` from the middle of
    /// the patch shows `center + warp d`. `None` where the patch has no corner.
    pub(crate) fn new(level: &Level, center: Point2<f32>, warp: &Matrix2<f32>) -> Option<Self> {
        // One pixel more on every side, for the slopes.
        const WIDE: usize = SIDE + 2;
        let mut wide = [0.0_f32; WIDE * WIDE];
        let middle = (WIDE - 1) as f32 / 2.0;
        let step = warp.column(0);
        for j in 0..WIDE {
            let row = center + warp * Vector2::new(-middle, j as f32 - middle);
            for i in 0..WIDE {
                let x = row.x + step.x * i as f32;
                let y = row.y + step.y * i as f32;
                wide[j * WIDE + i] = level.sample(x, y);
            }
        }
        let mut values = [0.0; AREA];
        let mut slopes = [[0.0; AREA]; 2];
        for k in 0..AREA {
            let at = (k / SIDE + 1) * WIDE + k % SIDE + 1;
            values[k] = wide[at];
            slopes[0][k] = 0.5 * (wide[at + 1] - wide[at - 1]);
            slopes[1][k] = 0.5 * (wide[at + WIDE] - wide[at - WIDE]);
        }
        remove_mean(&mut values);
        let square = dot(&values, &values);
        if square < MIN_SLOPE * AREA as f32 {
            return None;
        }
        for slope in &mut slopes {
            remove_mean(slope);
            let along = dot(slope, &values) / square;
            slope.iter_mut().zip(&values).for_each(|(g, t)| *g -= along * t);
        }
        let xx = dot(&slopes[0], &slopes[0]);
        let xy = dot(&slopes[0], &slopes[1]);
        let yy = dot(&slopes[1], &slopes[1]);
        let flattest = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        if flattest < MIN_SLOPE * AREA as f32 {
            return None;
        }
        let determinant = xx * yy - xy * xy;
        let inverse = [yy / determinant, -xy / determinant, xx / determinant];
        Some(Self { values, slopes, square, inverse })
    }

    /// Minimizes over place `p`, gain `a` and offset `c`
    ///
    /// ```text
    /// Σ_d ( I(p + d) − a T(d) − c )²
    /// ```
    ///
    /// by the inverse compositional way: slopes are the template's, so that a step is a few sums
    /// over the image. Baker & Matthews, "Lucas-Kanade 20 Years On", IJCV 2004; gain and offset are
    /// projected out, as in part 3 of it. `None` where it does not come to rest nearby.
    pub(crate) fn find(&self, simd: SimdLevel, level: &Level, start: Point2<f32>) -> Option<Found> {
        let mut place = start;
        let mut found = None;
        for _ in 0..MAX_ITERATIONS {
            let (step, likeness) = self.step(simd, level, place)?;
            found = Some(Found { place, likeness });
            place += step;
            let is_near = (place - start).norm() < MAX_MOVE;
            if !is_near {
                return None;
            }
            if step.norm() < SMALL_STEP {
                break;
            }
        }
        found.map(|found| Found { place, ..found })
    }

    /// The next step from `place`, and the correlation there.
    fn step(
        &self,
        simd: SimdLevel,
        level: &Level,
        place: Point2<f32>,
    ) -> Option<(Vector2<f32>, f32)> {
        let is_inside = place.x >= 0.0
            && place.y >= 0.0
            && place.x <= level.width as f32
            && place.y <= level.height as f32;
        if !is_inside {
            return None;
        }
        // The patch's first pixel center, as an index into the plane.
        const TO_FIRST: f32 = BORDER as f32 - SIDE as f32 / 2.0;
        let (u, v) = (place.x + TO_FIRST, place.y + TO_FIRST);
        let (i, j) = (u as usize, v as usize);
        let start = j * level.stride + i;
        let fraction = [u - i as f32, v - j as f32];
        let patch = (&self.values, &self.slopes[0], &self.slopes[1]);
        let sums = sums(simd, &level.plane, level.stride, start, fraction, patch);
        let gain = sums.with_values / self.square;
        let spread = sums.square - sums.one * sums.one / AREA as f32;
        let likeness = sums.with_values / (self.square * spread).sqrt();
        // Nothing alike has a gain of zero or less. False for NaN.
        let is_alike = gain > 0.0 && likeness > 0.0;
        if !is_alike {
            return None;
        }
        let [x, y] = sums.with_slopes.map(|b| -b / gain);
        let [xx, xy, yy] = self.inverse;
        Some((Vector2::new(xx * x + xy * y, xy * x + yy * y), likeness))
    }
}

fn dot(a: &Patch, b: &Patch) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn remove_mean(patch: &mut Patch) {
    let mean = patch.iter().sum::<f32>() / AREA as f32;
    patch.iter_mut().for_each(|v| *v -= mean);
}

#[cfg(test)]
mod tests {
    use volery_scene::GrayImage;

    use super::*;
    use crate::pyramid::Pyramid;

    /// A smooth pattern without period, seen from `shift`, in other light.
    fn pattern(shift: Vector2<f64>, gain: f64, offset: f64) -> Level {
        let value = |x: f64, y: f64| {
            let waves = [(0.31, 0.12), (-0.17, 0.29), (0.07, -0.23), (0.41, 0.37)];
            waves.iter().map(|(a, b)| (a * x + b * y + a * 9.0).sin()).sum::<f64>()
        };
        let pixel = |k: usize| {
            let (x, y) = ((k % 96) as f64 + 0.5, (k / 96) as f64 + 0.5);
            (100.0 + 22.0 * value(x - shift.x, y - shift.y)) * gain + offset
        };
        let pixels = (0..96 * 96).map(|k| pixel(k).round().clamp(0.0, 255.0) as u8).collect();
        Pyramid::new(&GrayImage::new(96, 96, pixels).unwrap()).levels.remove(0)
    }

    /// Dies without the slopes' projection: light then moves the patch.
    #[test]
    fn a_shift_is_found_in_any_light() {
        let still = pattern(Vector2::zeros(), 1.0, 0.0);
        for (shift, gain, offset) in [
            (Vector2::new(0.0, 0.0), 1.0, 0.0),
            (Vector2::new(1.3, -0.7), 1.0, 0.0),
            (Vector2::new(-2.2, 1.6), 0.4, 10.0),
            (Vector2::new(0.45, 2.1), 1.3, -20.0),
        ] {
            let moved = pattern(shift, gain, offset);
            for (x, y) in [(30.0, 40.0), (50.5, 48.2), (61.7, 33.3)] {
                let center = Point2::new(x, y);
                let template = Template::new(&still, center, &Matrix2::identity()).unwrap();
                for &simd in SimdLevel::available() {
                    let found = template.find(simd, &moved, center).unwrap();
                    let error = found.place - center - shift.cast::<f32>();
                    assert!(error.norm() < 0.06, "{shift} at {center}: {error}");
                    assert!(found.likeness > 0.98);
                }
            }
        }
    }

    #[test]
    fn edges_and_flat_walls_have_no_place() {
        let flat = |pixel: fn(usize) -> u8| {
            let image = GrayImage::new(96, 96, (0..96 * 96).map(pixel).collect()).unwrap();
            Pyramid::new(&image).levels.remove(0)
        };
        let center = Point2::new(48.0, 48.0);
        for level in [flat(|_| 90), flat(|k| if k % 96 < 48 { 20 } else { 220 })] {
            assert!(Template::new(&level, center, &Matrix2::identity()).is_none());
        }
    }

    #[test]
    fn what_is_not_there_is_not_alike() {
        let here = pattern(Vector2::zeros(), 1.0, 0.0);
        let elsewhere = pattern(Vector2::new(400.0, 250.0), 1.0, 0.0);
        let alike = (0..25).filter(|k| {
            let center = Point2::new(28.0 + (k % 5) as f32 * 10.0, 28.0 + (k / 5) as f32 * 10.0);
            let template = Template::new(&here, center, &Matrix2::identity());
            let found = template.and_then(|t| t.find(SimdLevel::detect(), &elsewhere, center));
            found.is_some_and(|found| found.likeness > 0.9)
        });
        assert!(alike.count() <= 2);
    }
}
