//! Localization in rooms of points with made-up descriptors: the truth is known, and there are no
//! pixels in the way.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{BundleOptions, BundleProblem, IntrinsicsRefinement, adjust_bundle};
use volery_features::{GlobalDescriptor, global_descriptor};
use volery_geometry::{Camera, CameraModel, similarity_from_points};
use volery_localization::{
    IndexError, LocalizationAnswer, LocalizationIndex, LocalizationPrior, LocalizeOptions,
    NotFoundReason, Status, StepTimings, localize_features,
};
use volery_scene::{
    CameraId, DESCRIPTOR_LEN, Descriptor, Features, ImageId, Keypoint, NoProgress, Observation,
    Point3d, PointId, RegisteredImage, SparseModel,
};

/// Keypoint noise of map and queries, pixels per coordinate.
const SIGMA_PX: f64 = 0.7;

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let (u, v) = (self.uniform(1e-12, 1.0), self.uniform(0.0, std::f64::consts::TAU));
        (-2.0 * u.ln()).sqrt() * v.cos()
    }

    /// Of norm 256, as RootSIFT's.
    fn descriptor(&mut self) -> Descriptor {
        let raw: [f64; DESCRIPTOR_LEN] = std::array::from_fn(|_| self.uniform(0.0, 1.0).powi(3));
        let norm = raw.iter().map(|v| v * v).sum::<f64>().sqrt();
        raw.map(|v| (v / norm * 256.0).min(127.0) as u8)
    }

    /// The same surface seen again.
    fn seen_again(&mut self, descriptor: &Descriptor) -> Descriptor {
        descriptor.map(|v| (f64::from(v) + 4.0 * self.normal()).clamp(0.0, 127.0) as u8)
    }
}

fn camera() -> Camera {
    Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 500.0, 320.0, 240.0]).unwrap()
}

/// Points on the walls of a room of 8 x 8 x 3 m with the given middle.
fn room(random: &mut Random, num_points: usize, middle: Vector3<f64>) -> Vec<Point3<f64>> {
    (0..num_points)
        .map(|_| {
            let (along, up) = (random.uniform(-4.0, 4.0), random.uniform(0.0, 3.0));
            let bump = random.uniform(0.0, 0.3);
            let turn = f64::from(random.next() as u32 % 4) * std::f64::consts::FRAC_PI_2;
            let on_wall = Vector3::new(4.0 - bump, along, up);
            Point3::from(Rotation3::from_axis_angle(&Vector3::z_axis(), turn) * on_wall + middle)
        })
        .collect()
}

/// A level camera at `center` that looks along `yaw` (from x towards y).
fn looking(center: Vector3<f64>, yaw: f64) -> Isometry3<f64> {
    let forward = Vector3::new(yaw.cos(), yaw.sin(), 0.0);
    let right = Vector3::new(yaw.sin(), -yaw.cos(), 0.0);
    let r = nalgebra::Matrix3::from_columns(&[right, -Vector3::z(), forward]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    Isometry3::from_parts(Translation3::from(center), rotation).inverse()
}

/// Keypoints of the points in view, and which points they are.
fn photograph(
    random: &mut Random,
    cam_from_world: &Isometry3<f64>,
    points: &[Point3<f64>],
    descriptors: &[Descriptor],
) -> (Features, Vec<usize>) {
    let (mut features, mut seen) = (Features::default(), Vec::new());
    for (i, point) in points.iter().enumerate() {
        let Some(pixel) = camera().project(&(cam_from_world * point)) else { continue };
        let noise = nalgebra::Vector2::new(random.normal(), random.normal()) * SIGMA_PX;
        let pixel: Point2<f64> = pixel + noise;
        if (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y) {
            let (x, y) = (pixel.x as f32, pixel.y as f32);
            features.keypoints.push(Keypoint { x, y, scale: 2.0, orientation: 0.0 });
            features.descriptors.push(random.seen_again(&descriptors[i]));
            seen.push(i);
        }
    }
    (features, seen)
}

/// Features that belong to nothing.
fn clutter(random: &mut Random, count: usize) -> Features {
    let mut features = Features::default();
    for _ in 0..count {
        let (x, y) = (random.uniform(0.0, 640.0) as f32, random.uniform(0.0, 480.0) as f32);
        features.keypoints.push(Keypoint { x, y, scale: 2.0, orientation: 0.0 });
        features.descriptors.push(random.descriptor());
    }
    features
}

/// A map of `points` from a ring of twelve views about each of `middles`.
fn map(
    random: &mut Random,
    points: &[Point3<f64>],
    descriptors: &[Descriptor],
    middles: &[Vector3<f64>],
) -> LocalizationIndex {
    let mut model = SparseModel::default();
    model.cameras.insert(CameraId(0), camera());
    let mut tracks: Vec<Vec<Observation>> = vec![Vec::new(); points.len()];
    let (mut all, mut globals): (Vec<Vec<Descriptor>>, Vec<GlobalDescriptor>) = Default::default();
    for middle in middles {
        for step in 0..12 {
            let yaw = f64::from(step) * std::f64::consts::TAU / 12.0;
            let center = middle + Vector3::new(-1.5 * yaw.cos(), -1.5 * yaw.sin(), 1.5);
            let cam_from_world = looking(center, yaw);
            let (features, seen) = photograph(random, &cam_from_world, points, descriptors);
            let image = ImageId(model.images.len() as u32);
            for (keypoint, &point) in seen.iter().enumerate() {
                tracks[point].push(Observation { image, keypoint: keypoint as u32 });
            }
            let registered = RegisteredImage {
                name: format!("{image:?}"),
                camera: CameraId(0),
                cam_from_world,
                keypoints: features.keypoints.iter().map(|k| k.pixel()).collect(),
                points: seen.iter().map(|&i| Some(PointId(i as u64))).collect(),
            };
            model.images.insert(image, registered);
            globals.push(global_descriptor(&features));
            all.push(features.descriptors);
        }
    }
    for (i, track) in tracks.into_iter().enumerate() {
        if track.len() < 2 {
            continue;
        }
        let point = Point3d { position: points[i], color: [0; 3], error_px: 0.8, track };
        model.points.insert(PointId(i as u64), point);
    }
    adjust(&mut model);
    LocalizationIndex::new(&model, &all, &globals)
}

/// Least squares over all, as every map has behind it, and back to where it was.
fn adjust(model: &mut SparseModel) {
    let slots: BTreeMap<PointId, u32> =
        model.points.keys().enumerate().map(|(slot, id)| (*id, slot as u32)).collect();
    let pose = |image: &RegisteredImage| BundlePose {
        cam_from_world: image.cam_from_world,
        camera: 0,
        constant: false,
        position_prior: None,
        gravity_prior: None,
    };
    let sightings = model.points.iter().flat_map(|(id, point)| {
        point.track.iter().map(|observation| BundleObservation {
            pose: observation.image.0,
            point: slots[id],
            pixel: model.images[&observation.image].keypoints[observation.keypoint as usize],
        })
    });
    let refine = IntrinsicsRefinement::FIXED;
    let mut problem = BundleProblem {
        cameras: vec![BundleCamera { camera: camera(), refine, focal_prior: None }],
        poses: model.images.values().map(pose).collect(),
        points: model.points.values().map(|point| point.position).collect(),
        constant_points: Vec::new(),
        observations: sightings.collect(),
    };
    let options = BundleOptions { loss_scale_px: None, ..BundleOptions::default() };
    adjust_bundle(&mut problem, &options, &NoProgress).unwrap();
    let truth: Vec<Point3<f64>> = model.images.values().map(RegisteredImage::center).collect();
    for (image, pose) in model.images.values_mut().zip(&problem.poses) {
        image.cam_from_world = pose.cam_from_world;
    }
    for (point, position) in model.points.values_mut().zip(&problem.points) {
        point.position = *position;
    }
    let adjusted: Vec<Point3<f64>> = model.images.values().map(RegisteredImage::center).collect();
    model.transform(&similarity_from_points(&adjusted, &truth).unwrap());
}

struct World {
    random: Random,
    points: Vec<Point3<f64>>,
    descriptors: Vec<Descriptor>,
    index: LocalizationIndex,
}

fn world(seed: u64) -> World {
    let mut random = Random(seed);
    let points = room(&mut random, 1500, Vector3::zeros());
    let descriptors: Vec<Descriptor> = points.iter().map(|_| random.descriptor()).collect();
    let index = map(&mut random, &points, &descriptors, &[Vector3::zeros()]);
    World { random, points, descriptors, index }
}

fn ask(
    features: &Features,
    index: &LocalizationIndex,
    prior: &LocalizationPrior,
) -> LocalizationAnswer {
    let (options, mut timings) = (LocalizeOptions::default(), StepTimings::default());
    localize_features(features, &camera(), index, prior, &options, &|| 0.0, &mut timings)
}

fn append(features: &mut Features, more: Features) {
    features.keypoints.extend(more.keypoints);
    features.descriptors.extend(more.descriptors);
}

/// P60, and the covariance is honest: the squared error in units of the stated covariance is 6 on
/// average for six dimensions. Half of the keypoints are clutter. The queries of a map share its
/// errors, so that a few maps say little more than a few draws, hence the wide bounds.
#[test]
fn poses_are_found_and_their_covariance_is_honest() {
    let (num_queries, mut num_in_band, mut sum) = (60, 0, 0.0);
    let mut worlds = [world(1), world(11), world(21)];
    for query in 0..num_queries {
        let World { random, points, descriptors, index } = &mut worlds[query % 3];
        let center = Vector3::from_fn(|axis, _| match axis {
            2 => random.uniform(1.0, 2.0),
            _ => random.uniform(-1.5, 1.5),
        });
        let truth = looking(center, random.uniform(0.0, std::f64::consts::TAU));
        let (mut features, _) = photograph(random, &truth, points, descriptors);
        let num_seen = features.len();
        append(&mut features, clutter(random, num_seen));
        let answer = ask(&features, index, &LocalizationPrior::default());
        let Status::Ok(pose) = answer.status else { panic!("{:?}", answer.status) };
        let truth = truth.inverse();
        let position = truth.translation.vector - pose.map_from_camera.translation.vector;
        let rotation = truth.rotation * pose.map_from_camera.rotation.inverse();
        let turn = rotation.scaled_axis();
        assert!(position.norm() < 0.06 && turn.norm() < 0.02, "{position} {turn}");
        let error =
            nalgebra::Vector6::new(position.x, position.y, position.z, turn.x, turn.y, turn.z);
        let information = pose.covariance.try_inverse().unwrap();
        let squared = error.dot(&(information * error));
        num_in_band += usize::from(squared < 12.592);
        sum += squared;
    }
    println!("{num_in_band} in band, mean {}", sum / num_queries as f64);
    assert!(num_in_band * 20 >= num_queries * 17, "{num_in_band} of {num_queries} in the band");
    let mean = sum / num_queries as f64;
    assert!((2.0..=10.0).contains(&mean), "mean normalized squared error {mean}");
}

/// P61: what is not in the map is not found.
#[test]
fn clutter_is_not_found() {
    let World { mut random, index, .. } = world(2);
    for _ in 0..20 {
        let answer = ask(&clutter(&mut random, 500), &index, &LocalizationPrior::default());
        assert!(matches!(answer.status, Status::NotFound(_)), "{:?}", answer.status);
    }
    let answer = ask(&clutter(&mut random, 5), &index, &LocalizationPrior::default());
    assert_eq!(answer.status, Status::NotFound(NotFoundReason::TooFewFeatures));
}

/// One poster that hangs in both rooms is no proof of being in either.
#[test]
fn support_in_a_corner_is_not_believed() {
    let World { mut random, points, descriptors, index } = world(3);
    let truth = looking(Vector3::new(0.0, 0.0, 1.5), 0.3);
    let (mut features, _) = photograph(&mut random, &truth, &points, &descriptors);
    let in_corner: Vec<usize> = (0..features.len())
        .filter(|&i| features.keypoints[i].x < 150.0 && features.keypoints[i].y < 130.0)
        .collect();
    features = Features {
        keypoints: in_corner.iter().map(|&i| features.keypoints[i]).collect(),
        descriptors: in_corner.iter().map(|&i| features.descriptors[i]).collect(),
    };
    append(&mut features, clutter(&mut random, 400));
    let answer = ask(&features, &index, &LocalizationPrior::default());
    assert!(matches!(answer.status, Status::NotFound(_)), "{:?}", answer.status);
}

/// Two rooms that look exactly alike: the answer is both, never one of them.
#[test]
fn twin_rooms_are_ambiguous() {
    let mut random = Random(4);
    let shift = Vector3::new(30.0, 0.0, 0.0);
    let one = room(&mut random, 800, Vector3::zeros());
    let mut descriptors: Vec<Descriptor> = one.iter().map(|_| random.descriptor()).collect();
    let points: Vec<Point3<f64>> =
        one.iter().copied().chain(one.iter().map(|p| p + shift)).collect();
    descriptors.extend(descriptors.clone());
    let index = map(&mut random, &points, &descriptors, &[Vector3::zeros(), shift]);
    let truth = looking(Vector3::new(0.2, -0.1, 1.5), 1.0);
    let (features, _) = photograph(&mut random, &truth, &points[..800], &descriptors);
    let answer = ask(&features, &index, &LocalizationPrior::default());
    let Status::Ambiguous(poses) = answer.status else { panic!("{:?}", answer.status) };
    let mut x: Vec<f64> = poses.iter().map(|p| p.map_from_camera.translation.x).collect();
    x.sort_by(f64::total_cmp);
    assert!((x[0] - 0.2).abs() < 0.03 && (x[1] - 30.2).abs() < 0.03, "{x:?}");
}

/// A pose that contradicts what is known is not passed on as sure.
#[test]
fn a_prior_can_veto() {
    let World { mut random, points, descriptors, index } = world(5);
    let truth = looking(Vector3::new(0.5, 0.0, 1.5), 0.5);
    let (features, _) = photograph(&mut random, &truth, &points, &descriptors);
    let with = |position: f64, yaw: f64| {
        let position = Some((Point3::new(position, 0.0, 1.5), 0.1));
        ask(&features, &index, &LocalizationPrior { position, yaw: Some((yaw, 0.05)) }).status
    };
    assert!(matches!(with(0.5, 0.5), Status::Ok(_)));
    assert!(matches!(with(0.5, 0.5 + std::f64::consts::TAU), Status::Ok(_)));
    assert!(matches!(with(3.0, 0.5), Status::Ambiguous(_)));
    assert!(matches!(with(0.5, 2.0), Status::Ambiguous(_)));
}

#[test]
fn equal_arguments_give_equal_answers() {
    let World { mut random, points, descriptors, index } = world(6);
    let truth = looking(Vector3::new(0.5, 0.0, 1.5), 2.5);
    let (mut features, _) = photograph(&mut random, &truth, &points, &descriptors);
    append(&mut features, clutter(&mut random, 300));
    let prior = LocalizationPrior::default();
    let read = LocalizationIndex::from_bytes(&index.to_bytes()).unwrap();
    assert_eq!(ask(&features, &index, &prior), ask(&features, &read, &prior));
}

#[test]
fn bytes_come_back_and_cut_bytes_are_refused() {
    let mut random = Random(7);
    let points = room(&mut random, 40, Vector3::zeros());
    let descriptors: Vec<Descriptor> = points.iter().map(|_| random.descriptor()).collect();
    let index = map(&mut random, &points, &descriptors, &[Vector3::zeros()]);
    let bytes = index.to_bytes();
    let read = LocalizationIndex::from_bytes(&bytes).unwrap();
    assert_eq!(read.to_bytes(), bytes);
    assert!(read.num_points() > 10 && read.num_images() == 12);
    for end in (0..bytes.len()).step_by(7) {
        let error = LocalizationIndex::from_bytes(&bytes[..end]).err();
        assert!(matches!(error, Some(IndexError::Damaged { .. })), "cut at {end}");
    }
    for at in (0..bytes.len()).step_by(37) {
        let mut damaged = bytes.clone();
        damaged[at] = 0xff;
        let _ = LocalizationIndex::from_bytes(&damaged);
    }
}

/// An empty map answers, too.
#[test]
fn an_empty_map_finds_nothing() {
    let index = LocalizationIndex::new(&SparseModel::default(), &[], &[]);
    let mut random = Random(8);
    let answer = ask(&clutter(&mut random, 100), &index, &LocalizationPrior::default());
    assert_eq!(answer.status, Status::NotFound(NotFoundReason::TooFewMatches));
    assert!(LocalizationIndex::from_bytes(&index.to_bytes()).is_ok());
}
