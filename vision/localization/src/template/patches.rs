//! A drawn view against the photo, patch by patch: where each patch of the view is found in the
//! photo, and with its depth, which point of the map is seen there.

use nalgebra::{Isometry3, Matrix3, Point2, Point3};
use volery_geometry::Camera;
use volery_rendering::{DrawableMesh, Rendering, VirtualCamera};
use volery_scene::GrayImage;

use super::planes::normalized;
use super::similarity::correlation;
use super::working::{Level, Working, radius_at};
use crate::refine::Sight;

/// Pixels to each side of a patch's middle.
const RADIUS: usize = 6;
/// Cells along the width that give one patch each.
const NUM_CELLS: usize = 23;
/// Least contrast of a patch in its weakest direction, square levels per pixel.
const MIN_CORNER: f64 = 6.0;
/// Depths of a patch differ by no more than this part.
const MAX_DEPTH_RANGE: f32 = 0.1;
/// Least correlation of a patch that is found.
const MIN_CORRELATION: f64 = 0.5;
/// Patches that are found this near to where they should be agree with the pose, pixels.
const AGREEING_PX: f64 = 1.0;
/// How far patches are looked for when a pose is judged, pixels.
const JUDGED_RANGE: usize = 5;

/// How well a drawn view agrees with the photo: a second opinion on a pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RenderScore {
    /// Correlation of local contrasts, −1 to 1, over what is seen of the map.
    pub correlation: f64,
    /// Patches with contrast that were looked for.
    pub num_patches: usize,
    /// Part of them found within a pixel (of an image 320 wide) of where they should be. By chance
    /// it is some 0.04.
    pub agreement: f64,
    /// Part of the view that shows the map, 0 to 1.
    pub seen: f64,
}

/// A patch of the view that was found in the photo.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PatchMatch {
    /// In the photo.
    pub(crate) pixel: Point2<f64>,
    /// Its offset from where the view has it, pixels.
    pub(crate) shift_px: f64,
    pub(crate) point_in_world: Point3<f64>,
}

impl PatchMatch {
    pub(crate) fn sight(&self) -> Sight {
        Sight {
            pixel: self.pixel,
            relative_sigma: 1.0,
            point: self.point_in_world,
            point_index: 0,
            covariance: Matrix3::zeros(),
        }
    }
}

/// All patches of a view.
pub(crate) struct PatchMatches {
    pub(crate) found: Vec<PatchMatch>,
    pub(crate) num_tried: usize,
}

/// How well the mesh, seen from a pose, agrees with a photo; `None` if the photo is not the
/// camera's or too small.
pub fn render_score(
    photo: &GrayImage,
    camera: &Camera,
    mesh: &DrawableMesh,
    cam_from_world: &Isometry3<f64>,
) -> Option<RenderScore> {
    let working = Working::new(photo, camera)?;
    let level = &working.levels[0];
    let view = View::draw(&VirtualCamera::new(&level.camera), level, mesh, cam_from_world);
    Some(view.score(&view.match_patches(JUDGED_RANGE)))
}

/// What the virtual camera sees from a pose, beside the photo.
pub(crate) struct View<'a> {
    level: &'a Level,
    cam_from_world: Isometry3<f64>,
    drawn: Rendering,
    pub(crate) gray: GrayImage,
    /// With local contrast.
    normalized: GrayImage,
}

impl<'a> View<'a> {
    /// `eye` is that of `level`.
    pub(crate) fn draw(
        eye: &VirtualCamera,
        level: &'a Level,
        mesh: &DrawableMesh,
        cam_from_world: &Isometry3<f64>,
    ) -> Self {
        let drawn = eye.draw_mesh(mesh, cam_from_world);
        let gray = drawn.gray();
        let normalized = normalized(&gray, radius_at(&level.camera), |k| drawn.depth[k] > 0.0);
        Self { level, cam_from_world: *cam_from_world, drawn, gray, normalized }
    }

    /// The gray levels of view and photo where the view shows the map.
    pub(crate) fn seen_pairs(&self) -> impl Iterator<Item = [u8; 2]> {
        self.pairs(&self.gray, &self.level.gray)
    }

    fn pairs(&self, view: &GrayImage, photo: &GrayImage) -> impl Iterator<Item = [u8; 2]> {
        let both = view.pixels().iter().zip(photo.pixels());
        let seen = both.zip(&self.drawn.depth).filter(|(_, depth)| **depth > 0.0);
        seen.map(|((&view, &photo), _)| [view, photo])
    }

    pub(crate) fn score(&self, matches: &PatchMatches) -> RenderScore {
        let (mut n, mut s) = (0, [0_u64; 5]);
        for [a, b] in self.pairs(&self.normalized, &self.level.normalized) {
            let (a, b) = (u64::from(a), u64::from(b));
            n += 1;
            [a, b, a * a, b * b, a * b].iter().zip(&mut s).for_each(|(v, sum)| *sum += v);
        }
        let [a, b, aa, bb, ab] = s.map(|v| v as f64 / f64::from(n.max(1)));
        let scale = (aa - a * a) * (bb - b * b);
        let agreeing = matches.found.iter().filter(|m| m.shift_px <= AGREEING_PX).count();
        RenderScore {
            correlation: if scale > 0.0 { (ab - a * b) / scale.sqrt() } else { 0.0 },
            num_patches: matches.num_tried,
            agreement: agreeing as f64 / matches.num_tried.max(1) as f64,
            seen: self.drawn.seen_part(),
        }
    }

    /// Looks for the patches of the view within `range` pixels of where it has them.
    pub(crate) fn match_patches(&self, range: usize) -> PatchMatches {
        let Self { normalized: view, drawn, .. } = self;
        let world_from_cam = self.cam_from_world.inverse();
        let (width, height) = (view.width() as usize, view.height() as usize);
        let rim = RADIUS + range + 1;
        let edge = (width / NUM_CELLS).max(1);
        let corners = Corners::new(view);
        let mut found = Vec::new();
        let mut num_tried = 0;
        for cell in 0..(width / edge) * (height / edge) {
            let (x0, y0) = (cell % (width / edge) * edge, cell / (width / edge) * edge);
            let mut best: Option<(f64, usize, usize)> = None;
            for y in (y0.max(rim)..(y0 + edge).min(height.saturating_sub(rim))).step_by(2) {
                for x in (x0.max(rim)..(x0 + edge).min(width.saturating_sub(rim))).step_by(2) {
                    let strength = corners.strength(x, y);
                    let is_better = best.is_none_or(|(other, ..)| strength > other);
                    if strength >= MIN_CORNER && is_better && is_one_surface(drawn, x, y) {
                        best = Some((strength, x, y));
                    }
                }
            }
            let Some((_, x, y)) = best else { continue };
            num_tried += 1;
            let Some([du, dv]) = find(view, &self.level.normalized, x, y, range) else { continue };
            let center = Point2::new(x as f64 + 0.5, y as f64 + 0.5);
            let Some(xy) = self.level.camera.unproject(&center) else { continue };
            let depth = f64::from(drawn.depth[y * width + x]);
            found.push(PatchMatch {
                pixel: Point2::new(center.x + du, center.y + dv),
                shift_px: du.hypot(dv),
                point_in_world: world_from_cam * Point3::new(xy.x * depth, xy.y * depth, depth),
            });
        }
        PatchMatches { found, num_tried }
    }
}

/// Whether a patch lies on one surface: at an outline it shows two that move apart.
fn is_one_surface(drawn: &Rendering, x: usize, y: usize) -> bool {
    let width = drawn.width as usize;
    let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
    for row in (y - RADIUS..=y + RADIUS).step_by(RADIUS) {
        for column in (x - RADIUS..=x + RADIUS).step_by(RADIUS) {
            let depth = drawn.depth[row * width + column];
            (low, high) = (low.min(depth), high.max(depth));
        }
    }
    low > 0.0 && high - low <= MAX_DEPTH_RANGE * low
}

/// Where the photo shows a patch of the view, relative to its place in the view, to parts of a
/// pixel.
fn find(view: &GrayImage, photo: &GrayImage, x: usize, y: usize, range: usize) -> Option<[f64; 2]> {
    let patch = part_of(view, x, y, RADIUS)?;
    let around = part_of(photo, x, y, RADIUS + range)?;
    let scores = correlation(&patch, &around);
    let side = 2 * range + 1;
    let at = |i: usize, j: usize| scores[j * side + i];
    let (mut i, mut j) = (0, 0);
    for (k, &score) in scores.iter().enumerate() {
        if score > at(i, j) {
            (i, j) = (k % side, k / side);
        }
    }
    let is_inside = i > 0 && j > 0 && i + 1 < side && j + 1 < side;
    if !is_inside || at(i, j) < MIN_CORRELATION {
        return None;
    }
    // The peak of the parabola through three scores.
    let peak = |before: f64, top: f64, after: f64| {
        let bend = before - 2.0 * top + after;
        if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 }
    };
    let dx = i as f64 - range as f64 + peak(at(i - 1, j), at(i, j), at(i + 1, j));
    let dy = j as f64 - range as f64 + peak(at(i, j - 1), at(i, j), at(i, j + 1));
    Some([dx, dy])
}

/// The square around a pixel; `None` where it is cut off.
fn part_of(image: &GrayImage, x: usize, y: usize, radius: usize) -> Option<GrayImage> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    if x < radius || y < radius || x + radius >= width || y + radius >= height {
        return None;
    }
    let rows = (y - radius..=y + radius)
        .flat_map(|row| &image.row(row as u32)[x - radius..=x + radius])
        .copied();
    let side = 2 * radius as u32 + 1;
    GrayImage::new(side, side, rows.collect())
}

/// Sums of products of the slopes, to tell corners from edges and from nothing.
struct Corners {
    stride: usize,
    sums: Vec<[f64; 3]>,
}

impl Corners {
    fn new(image: &GrayImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let stride = width + 1;
        let mut sums = vec![[0.0; 3]; stride * (height + 1)];
        for y in 0..height {
            let mut row = [0.0; 3];
            for x in 0..width {
                if x > 0 && y > 0 && x + 1 < width && y + 1 < height {
                    let at = |x: usize, y: usize| f64::from(image.pixels()[y * width + x]);
                    let gx = (at(x + 1, y) - at(x - 1, y)) / 2.0;
                    let gy = (at(x, y + 1) - at(x, y - 1)) / 2.0;
                    row = [row[0] + gx * gx, row[1] + gx * gy, row[2] + gy * gy];
                }
                let above = sums[y * stride + x + 1];
                sums[(y + 1) * stride + x + 1] = [0, 1, 2].map(|k| above[k] + row[k]);
            }
        }
        Self { stride, sums }
    }

    /// Smaller eigenvalue of the mean product matrix of a patch.
    ///
    /// Source: Shi and Tomasi, "Good Features to Track", CVPR 1994.
    fn strength(&self, x: usize, y: usize) -> f64 {
        let (x0, y0, x1, y1) = (x - RADIUS, y - RADIUS, x + RADIUS + 1, y + RADIUS + 1);
        let at = |x: usize, y: usize, k: usize| self.sums[y * self.stride + x][k];
        let [xx, xy, yy] = [0, 1, 2].map(|k| {
            (at(x1, y1, k) + at(x0, y0, k) - at(x0, y1, k) - at(x1, y0, k))
                / ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f64
        });
        (xx + yy) / 2.0 - (((xx - yy) / 2.0).powi(2) + xy * xy).sqrt()
    }
}
