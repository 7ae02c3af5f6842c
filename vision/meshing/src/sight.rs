//! What the lines of sight say of a surface.
//!
//! A line from a camera to what it sees ends at a surface and crosses none. A Poisson surface that
//! such lines cross is a skin over free space; where none ends, nobody has seen whether there is
//! one.

use nalgebra::{Matrix3x4, Point3};
use rayon::prelude::*;
use volery_scene::DepthMap;

use crate::Surface;

/// A line ends at a surface that lies within this part of its length.
const MAX_MISS: f32 = 0.015;
/// A line that goes on by more than this part of its length has crossed the surface.
const MIN_BEYOND: f32 = 0.03;
/// Least number of known depths among the nine pixels around a line that crosses.
const MIN_KNOWN: usize = 6;
/// Lines that cross by chance: so many are not yet believed.
const MAX_STRAY: u16 = 1;

/// How many lines of sight end at each vertex of a surface, and how many go on behind it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SightVotes {
    votes: Vec<Votes>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Votes {
    ending: u16,
    crossing: u16,
}

impl SightVotes {
    /// No votes yet, for a surface of so many vertices.
    pub fn new(num_vertices: usize) -> Self {
        Self { votes: vec![Votes::default(); num_vertices] }
    }

    /// Adds the lines of sight of a depth map, which is not needed any more then. `vertices` are
    /// those of the surface, in the frame of the map's pose. What was inferred may end a line but
    /// does not let it cross.
    ///
    /// # Panics
    ///
    /// If there are more or fewer vertices than before.
    pub fn add(&mut self, vertices: &[Point3<f64>], map: &DepthMap) {
        assert_eq!(vertices.len(), self.votes.len());
        let pixel_from_world = map.camera.calibration_matrix()
            * map.cam_from_world.to_homogeneous().fixed_rows::<3>(0);
        self.votes
            .par_iter_mut()
            .zip(vertices)
            .for_each(|(votes, vertex)| votes.add(vertex, &pixel_from_world, map));
    }

    /// Whether lines of sight end at a vertex, and more of them than cross it.
    pub fn is_seen(&self, vertex: usize) -> bool {
        let Votes { ending, crossing } = self.votes[vertex];
        ending > 0 && (crossing <= MAX_STRAY || crossing < ending)
    }

    /// Takes the foundation from vertices that are not seen: their density becomes 0, and
    /// [`crate::trim::trim`] cuts them off.
    pub fn discredit_unseen(&self, surface: &mut Surface) {
        for (vertex, density) in surface.densities.iter_mut().enumerate() {
            if !self.is_seen(vertex) {
                *density = 0.0;
            }
        }
    }
}

impl Votes {
    fn add(&mut self, vertex: &Point3<f64>, pixel_from_world: &Matrix3x4<f64>, map: &DepthMap) {
        let p = pixel_from_world * vertex.to_homogeneous();
        if p.z <= 0.0 {
            return;
        }
        let (width, height) = (map.width(), map.height());
        let (u, v, depth) = (p.x / p.z, p.y / p.z, p.z as f32);
        if !(u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64) {
            return;
        }
        // Depth is only known to about a pixel where it jumps or where the surface is steep.
        let (x, y) = (u as usize, v as usize);
        let (mut low, mut high, mut num_known, mut is_inferred) =
            (f32::INFINITY, 0.0_f32, 0, false);
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for index in y * width + x.saturating_sub(1)..y * width + (x + 2).min(width) {
                let depth = map.depth[index];
                if depth > 0.0 {
                    (low, high) = (low.min(depth), high.max(depth));
                    num_known += 1;
                    is_inferred |= map.inferred[index];
                }
            }
        }
        if num_known == 0 {
            return;
        }
        if depth >= low * (1.0 - MAX_MISS) && depth <= high * (1.0 + MAX_MISS) {
            self.ending = self.ending.saturating_add(1);
        } else if depth < low * (1.0 - MIN_BEYOND) && num_known >= MIN_KNOWN && !is_inferred {
            self.crossing = self.crossing.saturating_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};
    use volery_geometry::{Camera, CameraModel};
    use volery_scene::{ImageId, NoProgress, PointCloud};

    use super::*;
    use crate::test_shapes::*;
    use crate::{PoissonOptions, TrimOptions, reconstruct_surface, trim};

    const WINDOW: [f64; 2] = [1.0, 2.0];

    /// A window in the far wall, 1 m wide and high; behind it another wall.
    fn in_window(p: &Point3<f64>) -> bool {
        let in_range = |v: f64| (WINDOW[0]..WINDOW[1]).contains(&v);
        p.y > 2.9 && in_range(p.x) && in_range(p.z)
    }

    /// A corner that no camera looks at.
    fn in_corner(p: &Point3<f64>) -> bool {
        p.x > 3.0 && p.y > 2.0 && p.z > 1.5
    }

    /// Depth of the room along a ray, 5 m more through the window, nothing in the corner.
    fn depth_map(index: u32, eye: &Point3<f64>, ahead: &Vector3<f64>) -> DepthMap {
        let camera = Camera::from_focal(CameraModel::Pinhole, 120, 90, 60.0).unwrap();
        let looking = Isometry3::face_towards(eye, &(eye + ahead), &-Vector3::z());
        let mut map = DepthMap::empty(ImageId(index), camera, looking.inverse());
        for index in 0..map.depth.len() {
            let xy = camera.unproject(&map.pixel(index)).unwrap();
            let ray = looking * Vector3::new(xy.x, xy.y, 1.0);
            let to_wall = |axis: usize| {
                let wall = if ray[axis] > 0.0 { ROOM_SIZE[axis] } else { 0.0 };
                (wall - eye[axis]) / ray[axis]
            };
            let t = (0..3).map(to_wall).fold(f64::INFINITY, f64::min);
            let point = eye + ray * t;
            let known = !in_corner(&point);
            map.depth[index] = match in_window(&point) {
                true => (8.0 - eye.y) / ray.y,
                false => t * f64::from(u8::from(known)),
            } as f32;
        }
        map
    }

    fn depth_maps() -> Vec<DepthMap> {
        (0..36)
            .map(|i: u32| {
                let yaw = f64::from(i % 12) * std::f64::consts::TAU / 12.0;
                let pitch = [1.2, 0.0, -1.2_f64][i as usize / 12];
                let eye = Point3::new(1.8 + 0.3 * yaw.cos(), 1.4 + 0.3 * yaw.sin(), 1.2);
                let ahead =
                    Vector3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
                depth_map(i, &eye, &ahead)
            })
            .collect()
    }

    fn surface(cloud: &PointCloud) -> Surface {
        let options = PoissonOptions { depth: 7, ..PoissonOptions::default() };
        reconstruct_surface(cloud, &options, &NoProgress).unwrap()
    }

    fn carved(closed: &Surface, max_hole_area: f64) -> Surface {
        let mut votes = SightVotes::new(closed.mesh.vertices.len());
        depth_maps().iter().for_each(|map| votes.add(&closed.mesh.vertices, map));
        let mut surface = closed.clone();
        votes.discredit_unseen(&mut surface);
        let options =
            TrimOptions { min_density_ratio: 1e-6, max_hole_area, ..TrimOptions::default() };
        trim(&surface, &options)
    }

    /// Seen walls stay whole; no skin is left over the window, none over the corner, and what floats
    /// in the room, where the lines of sight pass, goes.
    #[test]
    fn what_is_seen_stays_and_nothing_else() {
        let mut cloud = room(40_000, 1, |p| !in_window(p) && !in_corner(p));
        let ghost = Point3::new(1.0, 2.2, 0.6);
        for mut point in sphere(1500, 5).points {
            point.position = (ghost + point.normal.cast::<f64>() * 0.15).cast();
            cloud.points.push(point);
        }
        let closed = surface(&cloud);
        let inside = |p: &Point3<f64>, low: f64, high: f64| {
            (low..high).contains(&p.x) && (low..high).contains(&p.z) && p.y > 2.5
        };
        let num_over_window = |s: &Surface| {
            s.mesh.vertices.iter().filter(|p| inside(p, WINDOW[0] + 0.1, WINDOW[1] - 0.1)).count()
        };
        let num_of_ghost =
            |s: &Surface| s.mesh.vertices.iter().filter(|p| (*p - ghost).norm() < 0.25).count();
        let deep = |p: &&Point3<f64>| p.x > 3.15 && p.y > 2.15 && p.z > 1.65;
        let num_in_corner = |s: &Surface| s.mesh.vertices.iter().filter(deep).count();
        let counts = |s: &Surface| [num_over_window(s), num_of_ghost(s), num_in_corner(s)];
        assert!(counts(&closed).iter().all(|&count| count > 20), "{:?}", counts(&closed));
        let open = carved(&closed, 0.0);
        assert_eq!(counts(&open), [0, 0, 0]);
        let stays = |p: &Point3<f64>| open.mesh.vertices.iter().any(|v| (v - p).norm() < 0.1);
        for point in positions(&room(500, 2, |p| !in_window(p) && !in_corner(p))) {
            assert!(stays(&point), "no wall at {point}");
        }
    }

    #[test]
    fn small_holes_are_closed_and_large_ones_kept() {
        let closed = surface(&room(40_000, 1, |p| !in_window(p)));
        let has_skin = |s: &Surface| {
            s.mesh.vertices.iter().any(|p| (p - Point3::new(1.5, 3.0, 1.5)).norm() < 0.3)
        };
        assert!(has_skin(&carved(&closed, 1.5)) && !has_skin(&carved(&closed, 0.5)));
    }

    /// Lines that were concluded and not seen cross nothing; a single stray line is not believed.
    #[test]
    fn only_what_was_seen_carves() {
        let vertices = [Point3::new(1.5, 2.0, 1.2)];
        let eye = Point3::new(1.5, 1.0, 1.2);
        let crossing = |index: u32| depth_map(index, &eye, &Vector3::y());
        let mut votes = SightVotes::new(1);
        let mut inferred = crossing(0);
        inferred.inferred.fill(true);
        (0..5).for_each(|_| votes.add(&vertices, &inferred));
        assert_eq!(votes, SightVotes::new(1));
        let mut ending = crossing(1);
        ending.depth.fill(1.0);
        votes.add(&vertices, &ending);
        votes.add(&vertices, &crossing(2));
        assert!(votes.is_seen(0));
        votes.add(&vertices, &crossing(3));
        assert!(!votes.is_seen(0));
    }
}
