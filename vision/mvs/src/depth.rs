//! The depth map of one image, from coarse to fine.

use nalgebra::Vector3;
use volery_geometry::{SimdLevel, rng::mix};
use volery_scene::DepthMap;

use crate::checkerboard::{Cell, Field};
use crate::dice::Dice;
use crate::patch::PatchSource;
use crate::patch_match::{Judge, MAX_COST, Sweep};
use crate::planar_prior::{Support, planar_prior};
use crate::plane::{Plane, Rays};
use crate::selection::Neighborhood;
use crate::source::{QuadImage, Source, Transfer};
use crate::working_image::{Level, NUM_LEVELS, WorkingImage};

/// Iterations at each size, finest first: the coarsest starts from the sparse points and from
/// chance, the others from the size before.
const SWEEPS: [u64; NUM_LEVELS] = [2, 2, 4];
/// Iterations once other depth maps have a say.
const GEOMETRIC_SWEEPS: u64 = 1;
/// Iterations after which the sources that judge are chosen anew.
const SUMMON_EVERY: u64 = 2;

/// An image with the images that judge its depth.
pub(crate) struct Stereo<'a> {
    pub(crate) simd: SimdLevel,
    pub(crate) reference: &'a WorkingImage,
    pub(crate) sources: Vec<&'a WorkingImage>,
    pub(crate) neighborhood: &'a Neighborhood,
    pub(crate) seed: u64,
}

impl Stereo<'_> {
    /// The depth map that the images alone give.
    pub(crate) fn photometric(&self) -> DepthMap {
        let mut field: Option<Field> = None;
        for level in (0..NUM_LEVELS).rev() {
            let sources = self.sources_at(level);
            let judge = self.judge(level, &sources, None);
            let mut finer = match field {
                Some(coarser) => self.refined(level, &coarser),
                None => {
                    let mut start = self.start(level);
                    judge.assess(&mut start);
                    start
                }
            };
            for sweep in 0..SWEEPS[level] {
                let number = (level as u64) << 8 | sweep;
                judge.sweep(
                    &mut finer,
                    Sweep { number, summons: sweep.is_multiple_of(SUMMON_EVERY) },
                );
            }
            field = Some(finer);
        }
        self.depth_map(&field.expect("an image has at least one size"))
    }

    /// `start` improved under the eyes of the other depth maps: inverse depths row by row, those
    /// of the sources that have a map, 0 where unknown.
    pub(crate) fn geometric(
        &self,
        start: &DepthMap,
        inverse_depths: &[Option<&[f32]>],
    ) -> DepthMap {
        let sources = self.sources_at(0);
        let judge = self.judge(0, &sources, Some(inverse_depths));
        let rays = Rays::new(&start.camera);
        let mut field = Field::new(start.width(), start.height(), |x, y| {
            let index = y * start.width() + x;
            let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
            let normal = Vector3::from(start.normals[index]);
            let plane = rays.plane(u, v, 1.0 / start.depth[index], &normal);
            Cell { plane, cost: 1.0 - f32::from(start.confidence[index]) / 255.0 }
        });
        for sweep in 0..GEOMETRIC_SWEEPS {
            let number = 1 << 16 | sweep;
            judge.sweep(&mut field, Sweep { number, summons: sweep.is_multiple_of(SUMMON_EVERY) });
        }
        self.depth_map(&field)
    }

    fn level(&self, level: usize) -> &Level {
        &self.reference.levels[level]
    }

    fn sources_at(&self, level: usize) -> Vec<Source> {
        let own = self.reference;
        let camera = &self.level(level).camera;
        let source = |other: &&WorkingImage| {
            let theirs = &other.levels[level];
            let other_from_own = other.cam_from_world * own.cam_from_world.inverse();
            Source {
                image: QuadImage::new(&theirs.gray),
                from_reference: Transfer::new(camera, &theirs.camera, &other_from_own),
                to_reference: Transfer::new(&theirs.camera, camera, &other_from_own.inverse()),
            }
        };
        self.sources.iter().map(source).collect()
    }

    fn judge<'a>(
        &self,
        level: usize,
        sources: &'a [Source],
        geometry: Option<&'a [Option<&'a [f32]>]>,
    ) -> Judge<'a> {
        let Level { camera, gray } = self.level(level);
        Judge {
            simd: self.simd,
            patches: PatchSource::new(gray),
            sources,
            geometry,
            rays: Rays::new(camera),
            range: self.neighborhood.range,
            inverse_depth_per_px: self.inverse_depth_per_px(level, sources),
            seed: self.seed ^ mix(u64::from(self.reference.id.0)),
        }
    }

    /// Change of inverse depth that moves a point by one pixel, in the middle of the sources and
    /// of the sparse points.
    fn inverse_depth_per_px(&self, level: usize, sources: &[Source]) -> f32 {
        let scale = 0.5_f32.powi(level as i32);
        let mut speeds = Vec::new();
        for source in sources {
            for point in &self.neighborhood.points {
                let [x, y, z] =
                    source.from_reference.apply(point.u * scale, point.v * scale, point.w);
                let b = source.from_reference.b;
                let speed = ((b[0] - x / z * b[2]) / z).hypot((b[1] - y / z * b[2]) / z);
                if speed > 0.0 && speed.is_finite() {
                    speeds.push(speed);
                }
            }
        }
        speeds.sort_by(f32::total_cmp);
        speeds.get(speeds.len() / 2).map_or(self.neighborhood.range[1], |speed| 1.0 / speed)
    }

    /// Planes through the sparse points on one color of the checkerboard, planes by chance elsewhere.
    fn start(&self, level: usize) -> Field {
        let camera = &self.level(level).camera;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let scale = 0.5_f32.powi(level as i32);
        let at_scale = |p: &Support| Support { u: p.u * scale, v: p.v * scale, w: p.w };
        let points: Vec<Support> = self.neighborhood.points.iter().map(at_scale).collect();
        let prior = planar_prior(&points, width, height, |_, _| true);
        let rays = Rays::new(camera);
        let [low, high] = self.neighborhood.range;
        Field::new(width, height, |x, y| {
            let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
            let key = self.seed ^ mix(u64::from(self.reference.id.0));
            let mut dice = Dice(mix(key ^ mix((y as u64) << 32 | x as u64)));
            let known = prior[y * width + x].filter(|p| {
                (x + y) % 2 == 0 && p.w >= low && p.w <= high && rays.is_visible(p, u, v)
            });
            let plane = known.unwrap_or_else(|| {
                let normal = Vector3::new(dice.spread(), dice.spread(), -1.0);
                rays.plane(u, v, low + (high - low) * dice.uniform(), &normal)
            });
            Cell { plane, cost: MAX_COST }
        })
    }

    /// The planes of a coarser size, each for its four pixels.
    fn refined(&self, level: usize, coarser: &Field) -> Field {
        let camera = &self.level(level).camera;
        Field::new(camera.width as usize, camera.height as usize, |x, y| {
            let (cx, cy) = ((x / 2).min(coarser.width - 1), (y / 2).min(coarser.height - 1));
            let Cell { plane, cost } = coarser.get(cx, cy);
            let [du, dv] = [(x, cx), (y, cy)]
                .map(|(fine, coarse)| (fine as f32 + 0.5) - 2.0 * (coarse as f32 + 0.5));
            let plane = plane.at_double_size().moved(du, dv);
            Cell {
                plane: Plane {
                    w: plane.w.clamp(self.neighborhood.range[0], self.neighborhood.range[1]),
                    ..plane
                },
                cost,
            }
        })
    }

    fn depth_map(&self, field: &Field) -> DepthMap {
        let camera = self.level(0).camera;
        let rays = Rays::new(&camera);
        let mut map = DepthMap::empty(self.reference.id, camera, self.reference.cam_from_world);
        for y in 0..field.height {
            for x in 0..field.width {
                let cell = field.get(x, y);
                let index = y * field.width + x;
                let normal = rays.normal(&cell.plane, x as f32 + 0.5, y as f32 + 0.5);
                map.depth[index] = 1.0 / cell.plane.w;
                map.normals[index] = normal.into();
                map.confidence[index] = ((1.0 - cell.cost).clamp(0.0, 1.0) * 255.0) as u8;
            }
        }
        map
    }
}
