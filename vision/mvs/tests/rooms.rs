//! Dense reconstruction of a rendered room against its true surfaces.

mod support;

use std::sync::atomic::{AtomicUsize, Ordering};

use support::{Scan, pinhole, scan};
use volery_geometry::{Camera, CameraModel, Point3, Rng};
use volery_mvs::{DenseError, DenseOptions, MemoryShelf, depth_map, reconstruct_dense};
use volery_scene::{
    Cancelled, DepthMap, GrayImage, ImageId, NoProgress, OrientedPoint, Photo, Photos, PointCloud,
    Progress, SparseModel, Stage,
};

fn reconstruct(scan: &Scan) -> (Vec<DepthMap>, PointCloud) {
    reconstruct_with(scan, &DenseOptions::default())
}

fn reconstruct_with(scan: &Scan, options: &DenseOptions) -> (Vec<DepthMap>, PointCloud) {
    let shelf = MemoryShelf::default();
    let dense = reconstruct_dense(&scan.model, scan, &shelf, options, &NoProgress).unwrap();
    let map = |image: &ImageId| depth_map(&scan.model, &shelf, options, *image).unwrap();
    (dense.images.iter().map(map).collect(), dense.cloud)
}

/// Part of the values that are at most `limit`.
fn share(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|&&value| value <= limit).count() as f64 / values.len() as f64
}

/// Every true surface point that three views see, drawn evenly by area.
fn visible_points(scan: &Scan, num: usize) -> Vec<Point3<f64>> {
    let mut rng = Rng::new(11);
    let mut points = Vec::new();
    while points.len() < num {
        let point = scan.hall.room.surface_point(&mut rng).position;
        let sees = |image: &&volery_scene::RegisteredImage| {
            let pixel = scan.camera.project(&(image.cam_from_world * point));
            pixel.is_some_and(|pixel| scan.camera.contains(&pixel))
                && scan.hall.room.sees(&image.center(), &point)
        };
        if scan.model.images.values().filter(sees).count() >= 3 {
            points.push(point);
        }
    }
    points
}

/// Depth, points and coverage of a room that is rendered 240 pixels wide: a pixel is 1 to 2 cm.
#[test]
fn a_room_is_rebuilt_where_three_views_see_it() {
    let scan = scan(pinhole(240), 7);
    let (maps, cloud) = reconstruct(&scan);
    assert_eq!(maps.len(), 7);

    let (mut seen, mut inferred) = (Vec::new(), Vec::new());
    for map in &maps {
        let truth = &scan.renderings[map.image.0 as usize].depth;
        for index in (0..truth.len()).filter(|&index| map.depth[index] > 0.0) {
            let error = f64::from((map.depth[index] / truth[index] - 1.0).abs());
            if map.inferred[index] { &mut inferred } else { &mut seen }.push(error);
        }
    }
    // Half of the pixels within 1 cm: the surfaces are 2.5 to 3.4 m away.
    assert!(share(&seen, 0.003) > 0.5, "{}", share(&seen, 0.003));
    assert!(share(&seen, 0.01) > 0.9, "{}", share(&seen, 0.01));
    assert!(share(&inferred, 0.03) > 0.7, "{} of {}", share(&inferred, 0.03), inferred.len());

    let room = &scan.hall.room;
    let off: Vec<f64> =
        cloud.points.iter().map(|point| room.distance_to_surface(&point.position.cast())).collect();
    assert!(share(&off, 0.01) > 0.5 && share(&off, 0.05) > 0.95, "{}", share(&off, 0.05));

    let targets = visible_points(&scan, 1500);
    let nearest = |target: &Point3<f64>| {
        let squared =
            cloud.points.iter().map(|p| (p.position - target.cast::<f32>()).norm_squared());
        f64::from(squared.fold(f32::INFINITY, f32::min).sqrt())
    };
    let gaps: Vec<f64> = targets.iter().map(nearest).collect();
    assert!(share(&gaps, 0.05) > 0.8, "{}", share(&gaps, 0.05));
}

/// Normals point out of the solids: a step along them is a step into the free space.
#[test]
fn normals_point_into_the_free_space() {
    let scan = scan(pinhole(120), 5);
    let (_, cloud) = reconstruct(&scan);
    let free = cloud.points.iter().filter(|point| {
        let ahead = point.position + point.normal * 0.15;
        scan.hall.room.is_free(&ahead.cast(), 0.05)
    });
    let share = free.count() as f64 / cloud.points.len() as f64;
    assert!(share > 0.9, "{share}");
    assert!(cloud.points.iter().all(|p| (p.normal.norm() - 1.0).abs() < 1e-3));
}

/// Nor on how many images fit into memory: borders of clusters are not seen in it. (The points
/// come in the order of the clusters.)
#[test]
fn the_cloud_does_not_depend_on_threads_or_clusters() {
    let scan = scan(pinhole(96), 5);
    let run = |num_threads: usize, cluster_size: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads).build().unwrap();
        let options = DenseOptions { cluster_size, ..DenseOptions::default() };
        pool.install(|| reconstruct_with(&scan, &options))
    };
    let (maps, cloud) = run(1, 5);
    assert_eq!(maps.len(), 5);
    assert!(!cloud.points.is_empty());
    assert!((&maps, &cloud) == (&run(2, 5).0, &run(2, 5).1), "threads");
    let key = |point: &OrientedPoint| point.position.coords.map(f32::to_bits).data.0;
    let sorted = |mut cloud: PointCloud| {
        cloud.points.sort_by_key(key);
        cloud
    };
    let (clustered_maps, clustered) = run(2, 2);
    assert!(maps == clustered_maps && sorted(cloud) == sorted(clustered), "clusters");
}

/// The same of cells, which clusters share at their borders.
#[test]
fn a_thinned_cloud_does_not_depend_on_threads_or_clusters() {
    let scan = scan(pinhole(96), 5);
    let run = |num_threads: usize, cluster_size: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads).build().unwrap();
        let options = DenseOptions { cluster_size, cell_px: 2.0, ..DenseOptions::default() };
        pool.install(|| reconstruct_with(&scan, &options)).1
    };
    let cloud = run(1, 5);
    assert!(cloud.points.len() > 1000 && cloud == run(2, 2));
}

/// Stops after so many reports.
struct StopAfter(usize, AtomicUsize);

impl Progress for StopAfter {
    fn report(&self, _stage: Stage, _done: usize, _total: usize) {
        self.1.fetch_add(1, Ordering::Relaxed);
    }
    fn is_cancelled(&self) -> bool {
        self.1.load(Ordering::Relaxed) > self.0
    }
}

/// However often it is stopped, it goes on and ends the same.
#[test]
fn stopped_again_and_again_it_ends_the_same() {
    let scan = scan(pinhole(80), 4);
    let options = DenseOptions { cluster_size: 2, ..DenseOptions::default() };
    let (_, expected) = reconstruct_with(&scan, &options);
    let shelf = MemoryShelf::default();
    let mut num_stops = 0;
    let cloud = loop {
        let stop = StopAfter(8, AtomicUsize::new(0));
        match reconstruct_dense(&scan.model, &scan, &shelf, &options, &stop) {
            Ok(dense) => break dense.cloud,
            Err(error) => assert_eq!(error, DenseError::Cancelled(Cancelled)),
        }
        num_stops += 1;
        assert!(num_stops < 50, "it does not go on");
    };
    assert!(num_stops > 2 && cloud == expected);
}

/// Cells keep one point each, as far apart as was asked for.
#[test]
fn a_thinned_cloud_has_a_point_per_cell() {
    let scan = scan(pinhole(96), 5);
    let shelf = MemoryShelf::default();
    let all = reconstruct(&scan).1.points.len();
    let options = DenseOptions { cell_px: 2.0, ..DenseOptions::default() };
    let dense = reconstruct_dense(&scan.model, &scan, &shelf, &options, &NoProgress).unwrap();
    // A pixel is 1/72 of the distance of about 3 m.
    assert!((0.05..0.12).contains(&dense.cell), "{}", dense.cell);
    assert!(dense.cloud.points.len() * 2 < all, "{} of {all}", dense.cloud.points.len());
}

/// A lens that bends the image is the same to the stereo as one that does not.
#[test]
fn distorted_photos_give_the_same_surfaces() {
    assert_eq!(num_beyond_photos_of_lens(-0.2), 0, "barrel");
    assert!(num_beyond_photos_of_lens(0.15) > 500, "pincushion");
}

/// Checks the surfaces that photos through a lens give; counts the pixels of depth maps that the
/// photos do not show.
fn num_beyond_photos_of_lens(k1: f64) -> usize {
    let params = [90.0, 91.0, 61.0, 44.0, k1, 0.05, 0.001, -0.001];
    let scan = scan(Camera::new(CameraModel::OpenCv, 120, 90, &params).unwrap(), 5);
    let (maps, cloud) = reconstruct(&scan);
    assert!(maps.iter().all(|map| map.camera.model == CameraModel::Pinhole));
    assert!(cloud.points.len() > 5000);
    let mut num_beyond = 0;
    for map in &maps {
        for index in 0..map.depth.len() {
            let ray = map.camera.unproject(&map.pixel(index)).unwrap();
            if !scan.camera.contains(&scan.camera.pixel_from_normalized(&ray)) {
                num_beyond += 1;
                assert_eq!(map.depth[index], 0.0);
            }
        }
    }
    let room = &scan.hall.room;
    let off: Vec<f64> =
        cloud.points.iter().map(|p| room.distance_to_surface(&p.position.cast())).collect();
    // A pixel is 3 cm wide on the surfaces.
    assert!(share(&off, 0.015) > 0.5 && share(&off, 0.06) > 0.9, "{}", share(&off, 0.06));
    num_beyond
}

/// Flat gray photos.
struct Blank(Camera);

impl Photos for Blank {
    fn photo(&self, _image: ImageId) -> Option<Photo> {
        let Camera { width, height, .. } = self.0;
        let gray = GrayImage::new(width, height, vec![90; (width * height) as usize]);
        Some(Photo { gray: gray.unwrap(), colors: None })
    }
}

#[test]
fn nothing_is_made_of_nothing() {
    let options = DenseOptions::default();
    let run = |model: &SparseModel, photos: &dyn Photos| {
        let shelf = MemoryShelf::default();
        let dense = reconstruct_dense(model, photos, &shelf, &options, &NoProgress);
        dense.map(|dense| dense.cloud)
    };
    let scan = scan(pinhole(96), 3);
    // Without texture no plane is better than another.
    assert_eq!(run(&scan.model, &Blank(scan.camera)), Ok(PointCloud::default()));
    // One image has no parallax.
    let mut single = scan.model.clone();
    single.images.retain(|id, _| id.0 == 0);
    assert_eq!(run(&single, &scan), Err(DenseError::NoSources));
    // Without points nobody knows who sees the same.
    let mut bare = scan.model.clone();
    bare.points.clear();
    assert_eq!(run(&bare, &scan), Err(DenseError::NoSources));
    assert_eq!(run(&SparseModel::default(), &scan), Err(DenseError::NoSources));
    let wrong = Blank(pinhole(64));
    assert!(matches!(run(&scan.model, &wrong), Err(DenseError::WrongSize { .. })));
}

struct Stop;

impl Progress for Stop {
    fn report(&self, _stage: Stage, _done: usize, _total: usize) {}
    fn is_cancelled(&self) -> bool {
        true
    }
}

#[test]
fn work_stops_when_asked() {
    let scan = scan(pinhole(64), 3);
    let options = DenseOptions::default();
    let shelf = MemoryShelf::default();
    let stopped = reconstruct_dense(&scan.model, &scan, &shelf, &options, &Stop);
    assert_eq!(stopped, Err(DenseError::Cancelled(Cancelled)));
}
