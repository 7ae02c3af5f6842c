//! Scenes of points without images: what feature matching would give, with its errors, and the
//! truth.

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use volery_geometry::triangulation::camera_center;
use volery_geometry::{Camera, CameraModel};
use volery_scene::FeatureMatch;

use crate::flight::{CenterMotion, yaw_scan};
use crate::{Rng, Room, SurfacePoint};

/// How a scene is observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointOptions {
    /// Points on the surfaces of the room.
    pub num_points: usize,
    /// Standard deviation of a keypoint per axis, pixels.
    pub noise_px: f64,
    /// Part of the matches of every pair that is wrong, 0..1.
    pub wrong_fraction: f64,
    /// Probability that a visible point has a keypoint.
    pub detection: f64,
    /// Pairs that share fewer points have no matches; `usize::MAX` for no matches at all.
    pub min_shared: usize,
    /// Part of the points that look like the one across the room, half a turn about its vertical
    /// axis away, 0..1: opposite walls that cannot be told apart.
    pub repeated_fraction: f64,
}

impl Default for PointOptions {
    /// The measured conditions of a yaw scan. The density gives about a thousand keypoints a
    /// view, as SIFT finds in a furnished room; at it COLMAP's published millimeter on a circle
    /// of 0.3 m is what the data allow.
    fn default() -> Self {
        Self {
            num_points: 12_000,
            noise_px: 0.7,
            wrong_fraction: 0.15,
            detection: 0.9,
            min_shared: 15,
            repeated_fraction: 0.0,
        }
    }
}

/// Keypoints and matches of a flight with the truth behind them.
#[derive(Debug, Clone, PartialEq)]
pub struct PointScene {
    /// One for all images.
    pub camera: Camera,
    /// True poses.
    pub cam_from_world: Vec<Isometry3<f64>>,
    /// True points.
    pub points: Vec<Point3<f64>>,
    /// Per image, noisy, pixels.
    pub keypoints: Vec<Vec<Point2<f64>>>,
    /// Per image and keypoint: which point it truly sees.
    pub point_of_keypoint: Vec<Vec<usize>>,
    /// Pairs `(i, j)`, `i < j`, in order, with matches of which some are wrong.
    pub matches: Vec<(usize, usize, Vec<FeatureMatch>)>,
}

/// A 1280x960 pinhole camera with 70 degrees of horizontal view (f = 914 px).
pub fn paper_camera() -> Camera {
    let focal = 640.0 / 35.0_f64.to_radians().tan();
    Camera::from_focal(CameraModel::Pinhole, 1280, 960, focal).expect("constants are valid")
}

impl PointScene {
    /// The paper's scan in [`Room::standard`]: `num_views` images `step` radians apart, from near
    /// the middle of the room at 1.5 m.
    pub fn yaw_scan(num_views: usize, step: f64, motion: CenterMotion, seed: u64) -> Self {
        let center = Point3::new(0.3, -0.2, 1.5);
        let poses = yaw_scan(&center, num_views, step, motion, seed);
        Self::observe(&Room::standard(), &paper_camera(), poses, &PointOptions::default(), seed)
    }

    /// What `camera` sees of random points of `room` from the given poses.
    ///
    /// A point has a keypoint where it projects into the image, faces the camera and no furniture
    /// stands before it, with probability `options.detection`.
    pub fn observe(
        room: &Room,
        camera: &Camera,
        cam_from_world: Vec<Isometry3<f64>>,
        options: &PointOptions,
        seed: u64,
    ) -> Self {
        let mut rng = Rng::fork(seed, 0);
        let mut surface: Vec<_> =
            (0..options.num_points).map(|_| room.surface_point(&mut rng)).collect();
        let look_of_point = repeat(room, &mut surface, options.repeated_fraction);
        let (mut keypoints, mut point_of_keypoint) = (Vec::new(), Vec::new());
        for (image, pose) in cam_from_world.iter().enumerate() {
            let mut rng = Rng::fork(seed, 1 + image as u64);
            let center = camera_center(pose);
            let (mut pixels, mut seen) = (Vec::new(), Vec::new());
            for (index, point) in surface.iter().enumerate() {
                if (center - point.position).dot(&point.normal) <= 0.0 {
                    continue;
                }
                let Some(pixel) = camera.project(&(pose * point.position)) else { continue };
                if !camera.contains(&pixel) || !room.sees(&center, &point.position) {
                    continue;
                }
                let noise = nalgebra::Vector2::new(rng.normal(), rng.normal());
                let noisy = pixel + noise * options.noise_px;
                if rng.chance(options.detection) && camera.contains(&noisy) {
                    pixels.push(noisy);
                    seen.push(index);
                }
            }
            keypoints.push(pixels);
            point_of_keypoint.push(seen);
        }
        let looks: Vec<_> =
            point_of_keypoint.iter().map(|points| looks_of(points, &look_of_point)).collect();
        let num_keypoints: Vec<usize> = keypoints.iter().map(Vec::len).collect();
        let matches = all_matches(&looks, &num_keypoints, options, seed);
        let points = surface.into_iter().map(|point| point.position).collect();
        Self { camera: *camera, cam_from_world, points, keypoints, point_of_keypoint, matches }
    }

    /// Number of images.
    pub fn num_images(&self) -> usize {
        self.cam_from_world.len()
    }

    /// Number of keypoints over all images.
    pub fn num_keypoints(&self) -> usize {
        self.keypoints.iter().map(Vec::len).sum()
    }

    /// Whether a match of images `i` and `j` ties keypoints of one point.
    pub fn is_true_match(&self, i: usize, j: usize, m: &FeatureMatch) -> bool {
        let point1 = self.point_of_keypoint[i].get(m.feature1 as usize);
        point1.is_some() && point1 == self.point_of_keypoint[j].get(m.feature2 as usize)
    }
}

/// Adds the copies of the first `fraction` of the points that have room for one. Returns what each
/// point looks like: the index of the point it is a copy of, or its own.
fn repeat(room: &Room, surface: &mut Vec<SurfacePoint>, fraction: f64) -> Vec<usize> {
    let num_points = surface.len();
    let mut looks: Vec<usize> = (0..num_points).collect();
    for original in 0..(num_points as f64 * fraction).round() as usize {
        let SurfacePoint { position: p, normal: n } = surface[original];
        let copy = SurfacePoint {
            position: Point3::new(-p.x, -p.y, p.z),
            normal: Vector3::new(-n.x, -n.y, n.z),
        };
        // Only the shell of the room has itself on the other side.
        let is_on_shell = !room.is_free(&p, 1e-6);
        if is_on_shell && room.is_free(&(copy.position + copy.normal * 1e-3), 0.0) {
            surface.push(copy);
            looks.push(original);
        }
    }
    looks
}

/// Sorted pairs of a look and the keypoint that has it. A look that two keypoints of one image
/// have fails the ratio test, so it is left out.
fn looks_of(points: &[usize], look_of_point: &[usize]) -> Vec<(usize, u32)> {
    let mut looks: Vec<(usize, u32)> =
        points.iter().zip(0..).map(|(&point, keypoint)| (look_of_point[point], keypoint)).collect();
    looks.sort_unstable();
    let is_alone = |i: usize| {
        let differs = |j: Option<&(usize, u32)>| j.is_none_or(|other| other.0 != looks[i].0);
        differs(looks.get(i + 1)) && differs(i.checked_sub(1).map(|j| &looks[j]))
    };
    (0..looks.len()).filter(|&i| is_alone(i)).map(|i| looks[i]).collect()
}

fn all_matches(
    looks: &[Vec<(usize, u32)>],
    num_keypoints: &[usize],
    options: &PointOptions,
    seed: u64,
) -> Vec<(usize, usize, Vec<FeatureMatch>)> {
    let mut all = Vec::new();
    if options.min_shared == usize::MAX {
        return all;
    }
    let n = looks.len();
    for i in 0..n {
        for j in i + 1..n {
            let mut matches = shared(&looks[i], &looks[j]);
            if matches.len() < options.min_shared.max(1) {
                continue;
            }
            let mut rng = Rng::fork(seed ^ 0x6d61_7463, (i * n + j) as u64);
            spoil(&mut matches, num_keypoints[j], options.wrong_fraction, &mut rng);
            matches.sort_unstable();
            all.push((i, j, matches));
        }
    }
    all
}

/// Matches of equal looks.
fn shared(looks1: &[(usize, u32)], looks2: &[(usize, u32)]) -> Vec<FeatureMatch> {
    let (mut a, mut b) = (0, 0);
    let mut matches = Vec::new();
    while a < looks1.len() && b < looks2.len() {
        match looks1[a].0.cmp(&looks2[b].0) {
            std::cmp::Ordering::Less => a += 1,
            std::cmp::Ordering::Greater => b += 1,
            std::cmp::Ordering::Equal => {
                matches.push(FeatureMatch { feature1: looks1[a].1, feature2: looks2[b].1 });
                a += 1;
                b += 1;
            }
        }
    }
    matches
}

/// Gives `fraction` of the matches a wrong partner in image 2. Stays one to one, as cross-checked
/// matches are.
fn spoil(matches: &mut [FeatureMatch], num_features2: usize, fraction: f64, rng: &mut Rng) {
    let num_wrong = (matches.len() as f64 * fraction).round() as usize;
    rng.shuffle(matches);
    let mut is_taken = vec![false; num_features2];
    for m in &matches[num_wrong..] {
        is_taken[m.feature2 as usize] = true;
    }
    let mut free: Vec<u32> = (0..num_features2 as u32).filter(|&f| !is_taken[f as usize]).collect();
    rng.shuffle(&mut free);
    for m in &mut matches[..num_wrong] {
        // The only free partner may be the true one: then the match stays true.
        let position = free.iter().rposition(|&f| f != m.feature2);
        if let Some(position) = position {
            m.feature2 = free.swap_remove(position);
        } else if let Some(last) = free.pop() {
            m.feature2 = last;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cam_from_heading;

    fn scan() -> PointScene {
        PointScene::yaw_scan(36, 10_f64.to_radians(), CenterMotion::Wobble { sigma: 0.03 }, 5)
    }

    #[test]
    fn keypoints_are_the_projections_but_for_the_noise() {
        let scene = scan();
        let (mut sum, mut n) = (0.0_f64, 0.0_f64);
        for image in 0..scene.num_images() {
            assert!(scene.keypoints[image].len() > 150, "{}", scene.keypoints[image].len());
            for (pixel, &point) in
                scene.keypoints[image].iter().zip(&scene.point_of_keypoint[image])
            {
                let seen = scene.cam_from_world[image] * scene.points[point];
                let truth = scene.camera.project(&seen).unwrap();
                sum += (pixel - truth).norm_squared() / 2.0;
                n += 1.0;
            }
        }
        let sigma = f64::sqrt(sum / n);
        assert!((sigma - 0.7).abs() < 0.02, "{sigma}");
    }

    #[test]
    fn the_stated_part_of_the_matches_is_wrong_and_all_are_one_to_one() {
        let scene = scan();
        let (mut num_wrong, mut num) = (0, 0);
        for (i, j, matches) in &scene.matches {
            assert!(i < j);
            num += matches.len();
            num_wrong += matches.iter().filter(|m| !scene.is_true_match(*i, *j, m)).count();
            let mut used: Vec<u32> = matches.iter().map(|m| m.feature2).collect();
            used.sort_unstable();
            used.dedup();
            assert_eq!(used.len(), matches.len());
            assert!(matches.windows(2).all(|w| w[0].feature1 < w[1].feature1));
        }
        let fraction = f64::from(num_wrong as u32) / f64::from(num as u32);
        assert!((fraction - 0.15).abs() < 0.005, "{fraction}");
        // Every image overlaps the six before and after it.
        assert!(scene.matches.len() >= 36 * 5, "{}", scene.matches.len());
    }

    /// Cameras back to back in the middle of an empty room see copies and nothing in common.
    #[test]
    fn opposite_walls_may_look_alike() {
        let room = Room { size: Vector3::new(6.0, 6.0, 3.0), furniture: Vec::new() };
        let center = Point3::new(0.0, 0.0, 1.5);
        let poses = [0.0, std::f64::consts::PI].map(|yaw| cam_from_heading(&center, yaw, 0.0, 0.0));
        for (repeated_fraction, num_expected) in [(0.0, 0), (1.0, 1)] {
            let options =
                PointOptions { num_points: 2000, repeated_fraction, ..Default::default() };
            let scene = PointScene::observe(&room, &paper_camera(), poses.to_vec(), &options, 1);
            assert_eq!(scene.matches.len(), num_expected);
            for (i, j, matches) in &scene.matches {
                assert!(
                    matches.len() > 100 && !matches.iter().any(|m| scene.is_true_match(*i, *j, m))
                );
            }
        }
    }

    #[test]
    fn equal_seeds_give_equal_scenes() {
        assert_eq!(scan(), scan());
    }
}
