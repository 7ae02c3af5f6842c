//! The search of the paper: views at places around the last one, moved until the photo's middle
//! stands in theirs at the same size (P69-P72).

use nalgebra::{Isometry3, Point3, Vector3};
use volery_geometry::triangulation::camera_center;
use volery_geometry::{Camera, median};
use volery_scene::GrayImage;

use super::key_view::KeyView;
use super::planes::sample;
use super::similarity::{Place, Similarity, best_place};
use super::working::Level;

/// Part of each side of the photo that is the template: its middle.
const TEMPLATE_PART: f64 = 0.6;
/// Spacing of the places relative to the median depth, with its bounds in meters.
const SPACING: f64 = 0.12;
const MIN_SPACING: f64 = 0.08;
const MAX_SPACING: f64 = 0.4;
/// Most places along each axis, to both sides.
const MAX_STEPS: i32 = 5;
/// Places that are centered, the most alike first.
const NUM_CENTERED: usize = 4;
/// Moves of one place.
const MAX_MOVES: usize = 3;
/// Sizes of the template (P66): the steps between them move a camera by a part of the depth.
const SIZES: [f64; 5] = [0.82, 0.91, 1.0, 1.1, 1.21];
/// How far one move reaches, pixels.
const REACH: u32 = 9;
/// Places nearer to each other than this part of the median depth are one.
const SAME_PLACE: f64 = 0.04;

/// A place with the likeness of its view.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) score: f64,
}

/// What was found, most alike first.
pub(crate) struct Candidates {
    pub(crate) found: Vec<Candidate>,
    /// Places whose view was compared in the first round.
    pub(crate) num_places: usize,
}

/// Where places are looked for.
pub(crate) struct Area {
    /// Camera at the start.
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) radius: f64,
    /// Whether places behind the plane through the start, across the view, are left out (P71).
    pub(crate) only_ahead: bool,
    pub(crate) similarity: Similarity,
}

pub(crate) fn search(key: &KeyView, level: &Level, area: &Area) -> Candidates {
    let templates: Vec<Template> =
        SIZES.iter().filter_map(|&size| Template::of(&level.normalized, size)).collect();
    let Some(template) = templates.iter().find(|template| template.size == 1.0) else {
        return Candidates { found: Vec::new(), num_places: 0 };
    };
    let places = places(area, key.median_depth);
    let mut found: Vec<Candidate> = places
        .iter()
        .map(|cam_from_world| {
            let (view, _) = key.view(&level.camera, cam_from_world);
            let place = best_place(&template.image, &view, area.similarity);
            let score = place.map_or(0.0, |place| place.score);
            Candidate { cam_from_world: *cam_from_world, score }
        })
        .collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(NUM_CENTERED);
    let mut centered: Vec<Candidate> =
        found.iter().map(|start| center(key, &level.camera, &templates, start, area)).collect();
    centered.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut distinct: Vec<Candidate> = Vec::new();
    for candidate in centered {
        let is_new = distinct.iter().all(|other| {
            let apart =
                camera_center(&other.cam_from_world) - camera_center(&candidate.cam_from_world);
            apart.norm() > SAME_PLACE * key.median_depth
        });
        if is_new {
            distinct.push(candidate);
        }
    }
    Candidates { found: distinct, num_places: places.len() }
}

/// Poses with the start's rotation on a level grid around it.
fn places(area: &Area, median_depth: f64) -> Vec<Isometry3<f64>> {
    let start = camera_center(&area.cam_from_world);
    let world_from_cam = area.cam_from_world.rotation.inverse();
    let level = |v: Vector3<f64>| Vector3::new(v.x, v.y, 0.0);
    let forward = level(world_from_cam * Vector3::z());
    let right = level(world_from_cam * Vector3::x());
    // Looking straight down, the image's up is ahead.
    let forward =
        if forward.norm() > 0.1 { forward } else { level(world_from_cam * -Vector3::y()) };
    let (forward, right) = (forward.normalize(), right.normalize());
    let spacing = (SPACING * median_depth).clamp(MIN_SPACING, MAX_SPACING);
    let spacing = spacing.max(area.radius / f64::from(MAX_STEPS));
    let steps = (area.radius / spacing).floor() as i32;
    let first_ahead = if area.only_ahead { 0 } else { -steps };
    let mut places = Vec::new();
    for ahead in first_ahead..=steps {
        for aside in -steps..=steps {
            let offset = (forward * f64::from(ahead) + right * f64::from(aside)) * spacing;
            if offset.norm() <= area.radius + 1e-9 {
                places.push(at(&area.cam_from_world, &(start + offset)));
            }
        }
    }
    places
}

/// The pose with another center.
fn at(cam_from_world: &Isometry3<f64>, center: &Point3<f64>) -> Isometry3<f64> {
    let rotation = cam_from_world.rotation;
    Isometry3::from_parts((rotation * -center.coords).into(), rotation)
}

/// Moves a camera sideways until the template stands in the middle of its view, and along its axis
/// until both have the same size (P68, P70).
fn center(
    key: &KeyView,
    camera: &Camera,
    templates: &[Template],
    start: &Candidate,
    area: &Area,
) -> Candidate {
    let mut best = Candidate { score: 0.0, ..*start };
    let mut cam_from_world = start.cam_from_world;
    for _ in 0..MAX_MOVES {
        let (view, depth) = key.view(camera, &cam_from_world);
        let mut at_best: Option<(Place, f64, [u32; 2])> = None;
        for Template { size, image } in templates {
            let Some(place) = place_near_middle(image, &view, area.similarity) else { continue };
            if at_best.is_none_or(|(other, ..)| place.score > other.score) {
                at_best = Some((place, *size, [image.width(), image.height()]));
            }
        }
        let Some((place, size, [width, height])) = at_best else { break };
        let offset = |at: usize, part: u32, whole: u32| {
            at as f64 + (f64::from(part) - f64::from(whole)) / 2.0
        };
        let shift = [offset(place.x, width, camera.width), offset(place.y, height, camera.height)];
        let is_there = size == 1.0 && shift[0].abs() < 1.0 && shift[1].abs() < 1.0;
        if place.score > best.score {
            best = Candidate { cam_from_world, score: place.score };
        }
        if is_there {
            break;
        }
        let z = depth_under(&depth, camera, &place, [width, height]).unwrap_or(key.median_depth);
        let focal = camera.focal();
        let step = Vector3::new(shift[0] * z / focal.x, shift[1] * z / focal.y, z * (1.0 - size));
        cam_from_world.translation.vector -= step;
        if place.score >= best.score {
            best.cam_from_world = cam_from_world;
        }
    }
    best
}

/// The best place within [`REACH`] pixels of the middle.
fn place_near_middle(
    template: &GrayImage,
    view: &GrayImage,
    similarity: Similarity,
) -> Option<Place> {
    let first = |view: u32, template: u32| Some(view.checked_sub(template)? / 2);
    let [x, y] = [first(view.width(), template.width())?, first(view.height(), template.height())?];
    let [x0, y0] = [x.saturating_sub(REACH), y.saturating_sub(REACH)];
    let x1 = (x + template.width() + REACH).min(view.width());
    let y1 = (y + template.height() + REACH).min(view.height());
    let rows = (y0..y1).flat_map(|row| &view.row(row)[x0 as usize..x1 as usize]).copied();
    let part = GrayImage::new(x1 - x0, y1 - y0, rows.collect())?;
    let place = best_place(template, &part, similarity)?;
    Some(Place { x: place.x + x0 as usize, y: place.y + y0 as usize, ..place })
}

/// Median depth of what lies under the template.
fn depth_under(depth: &[f32], camera: &Camera, place: &Place, size: [u32; 2]) -> Option<f64> {
    let mut under: Vec<f64> = (place.y..place.y + size[1] as usize)
        .flat_map(|y| {
            let start = y * camera.width as usize + place.x;
            depth[start..start + size[0] as usize].iter().map(|&z| f64::from(z))
        })
        .filter(|z| z.is_finite())
        .collect();
    median(&mut under)
}

/// The middle of the photo, `size` times as large.
struct Template {
    size: f64,
    image: GrayImage,
}

impl Template {
    fn of(photo: &GrayImage, size: f64) -> Option<Self> {
        let scaled = |v: u32| (f64::from(v) * TEMPLATE_PART * size).round() as u32;
        let (width, height) = (scaled(photo.width()), scaled(photo.height()));
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                let from = |at: u32, out: u32, whole: u32| {
                    let offset = (f64::from(at) + 0.5 - f64::from(out) / 2.0) / size;
                    (f64::from(whole) / 2.0 + offset) as f32
                };
                let (u, v) = (from(x, width, photo.width()), from(y, height, photo.height()));
                let [value, ..] = sample(photo, u, v)?;
                pixels.push((value + 0.5) as u8);
            }
        }
        Some(Self { size, image: GrayImage::new(width, height, pixels)? })
    }
}
