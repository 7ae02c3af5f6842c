//! Photos to a mesh, against the true surfaces of a rendered hall.

mod support;

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use support::{Folder, Scan, StopIn};
use volery_formats::{read_occupancy, read_ply_of_cloud, read_ply_of_mesh};
use volery_geometry::{KdTree, Point3, Rng, kd_tree::Neighbor};
use volery_pipeline::{
    JobSpec, MapFolder, Preset, StageGroup, StageProgress, Summary, map_folder, reconstruct,
};
use volery_scene::{NoProgress, Occupancy, Progress, Stage, TriangleMesh};

/// A scan whose map lies in the frame of the hall.
fn scan(folder: &Path) -> (Scan, JobSpec) {
    let scan = Scan::new(folder, 12);
    let mut spec = scan.spec.clone();
    for (image, pose) in spec.images.iter_mut().zip(&scan.poses) {
        let position = pose.inverse().translation.vector.into();
        image.prior.position = Some(volery_scene::PositionPrior { position, sigma: 0.01 });
    }
    let spec = JobSpec { preset: Preset::Fast, stages: vec![StageGroup::Mesh], ..spec };
    (scan, spec)
}

const FILES: [&str; 6] =
    ["map.json", "dense.ply", "freespace.bin", "mesh.ply", "map.glb", "poses.csv"];

fn files(folder: &Path) -> Vec<Vec<u8>> {
    FILES.iter().map(|name| fs::read(folder.join(name)).unwrap()).collect()
}

fn share(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|value| **value <= limit).count() as f64 / values.len() as f64
}

/// Points of the true surfaces that three cameras see, drawn evenly by area.
fn visible_points(scan: &Scan, num: usize) -> Vec<Point3<f64>> {
    let mut rng = Rng::new(11);
    let mut points = Vec::new();
    while points.len() < num {
        let point = scan.hall.room.surface_point(&mut rng).position;
        let sees = |pose: &&volery_geometry::Isometry3<f64>| {
            let pixel = scan.camera.project(&(**pose * point));
            let center = Point3::from(pose.inverse().translation.vector);
            pixel.is_some_and(|pixel| scan.camera.contains(&pixel))
                && scan.hall.room.sees(&center, &point)
        };
        if scan.poses.iter().filter(sees).count() >= 3 {
            points.push(point);
        }
    }
    points
}

/// Points of a mesh, drawn evenly by area.
fn surface_points(mesh: &TriangleMesh, num: usize) -> Vec<Point3<f64>> {
    let corners = |triangle: &[u32; 3]| triangle.map(|v| mesh.vertices[v as usize]);
    let mut area_up_to = vec![0.0];
    for triangle in &mesh.triangles {
        let [a, b, c] = corners(triangle);
        area_up_to.push(area_up_to[area_up_to.len() - 1] + (b - a).cross(&(c - a)).norm());
    }
    let mut rng = Rng::new(12);
    let mut draw = || {
        let pick = rng.uniform() * area_up_to[area_up_to.len() - 1];
        let index = area_up_to.partition_point(|area| *area <= pick) - 1;
        let [a, b, c] = corners(&mesh.triangles[index.min(mesh.triangles.len() - 1)]);
        let (u, v) = (rng.uniform().sqrt(), rng.uniform());
        a + (b - a) * (u * (1.0 - v)) + (c - a) * (u * v)
    };
    (0..num).map(|_| draw()).collect()
}

/// A pixel of the depth maps is 1 to 2 cm wide on the surfaces.
fn check_against_the_hall(scan: &Scan, out: &Path, summary: &Summary) {
    let cloud = read_ply_of_cloud(&fs::read(out.join("dense.ply")).unwrap()).unwrap();
    let mesh = read_ply_of_mesh(&fs::read(out.join("mesh.ply")).unwrap()).unwrap();
    let (dense, meshed) = (summary.dense.as_ref().unwrap(), summary.mesh.as_ref().unwrap());
    assert_eq!(
        (dense.num_points, meshed.num_triangles),
        (cloud.points.len(), mesh.triangles.len())
    );
    let info = map_folder::read_info(out).unwrap();
    assert_eq!(info.num_dense_points, Some(cloud.points.len()));
    assert_eq!(info.num_triangles, Some(mesh.triangles.len()));

    let room = &scan.hall.room;
    let off = |points: &mut dyn Iterator<Item = Point3<f64>>| -> Vec<f64> {
        points.map(|point| room.distance_to_surface(&point)).collect()
    };
    let cloud_off = off(&mut cloud.points.iter().map(|point| point.position.cast()));
    assert!(share(&cloud_off, 0.05) > 0.85, "cloud: {}", share(&cloud_off, 0.05));
    let mesh_off = off(&mut surface_points(&mesh, 4000).into_iter());
    assert!(share(&mesh_off, 0.05) > 0.8, "mesh: {}", share(&mesh_off, 0.05));
    let free = cloud.points.iter().filter(|point| {
        let ahead = point.position + point.normal * 0.15;
        room.is_free(&ahead.cast(), 0.05)
    });
    assert!(free.count() * 10 > cloud.points.len() * 8, "normals point into the room");

    let tree = KdTree::new(&mesh.vertices);
    let mut found: Vec<Neighbor> = Vec::new();
    let mut gap = |point: &Point3<f64>| {
        tree.nearest(point, 1, &mut found);
        found[0].distance_squared.sqrt()
    };
    let gaps: Vec<f64> = visible_points(scan, 1500).iter().map(&mut gap).collect();
    assert!(share(&gaps, 0.1) > 0.7, "complete: {}", share(&gaps, 0.1));
    assert_eq!(&fs::read(out.join("map.glb")).unwrap()[..4], b"glTF");
}

/// Free is air, by what the photos alone tell; what stands in the hall is not.
fn check_free_space(scan: &Scan, out: &Path, summary: &Summary) {
    let grid = read_occupancy(&fs::read(out.join("freespace.bin")).unwrap()).unwrap();
    let told = summary.dense.as_ref().unwrap().free_space.as_ref().unwrap();
    assert_eq!((told.voxel, told.size), (grid.voxel(), grid.size()));
    assert_eq!(map_folder::read_info(out).unwrap().free_space_voxel, Some(grid.voxel()));
    let volume = |state| grid.count(state) as f64 * grid.voxel().powi(3);
    assert!((told.free - volume(Occupancy::Free)).abs() < 1e-9);
    assert!(told.free > 4.0, "{} m³ of 168 are free", told.free);
    let room = &scan.hall.room;
    let states = grid.states().iter().enumerate();
    let free = states.filter(|(_, state)| **state == Occupancy::Free);
    let centers: Vec<Point3<f64>> = free.map(|(index, _)| grid.center(index)).collect();
    let is_buried = |center: &Point3<f64>| {
        !room.is_free(center, 0.0) && room.distance_to_surface(center) > 0.05
    };
    let num_buried = centers.iter().filter(|center| is_buried(center)).count();
    assert_eq!(num_buried, 0, "of {} free voxels", centers.len());
    // The scan looks into half of the hall: its other half is an unseen area.
    assert!(!told.unseen_areas.is_empty() && told.unseen_areas[0].area > 1.0);
}

/// True to the hall, and the same bytes for any number of threads and however often it is stopped.
#[test]
fn photos_become_a_mesh_that_is_true_to_the_hall() {
    let folder = Folder::new("mesh");
    let (scan, spec) = scan(&folder.0);
    let (calm, rough) = (folder.0.join("calm"), folder.0.join("rough"));
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let run = || reconstruct(&spec, &folder.0.join("work-calm"), &calm, &NoProgress).unwrap();
    let summary = single.install(run);
    assert_eq!(summary.num_registered, spec.images.len(), "{:?}", summary.quality);
    assert_eq!(summary.surface_error(), None);
    check_against_the_hall(&scan, &calm, &summary);
    check_free_space(&scan, &calm, &summary);
    let report = fs::read_to_string(calm.join("report.html")).unwrap();
    assert!(report.contains("<h2>Surface</h2>"));
    assert!(report.contains("<h3>Free space</h3>") && report.contains("unseen 1"));
    let num_pictures = report.matches("data:image/jpeg;base64,/9j/").count();
    assert_eq!(num_pictures, 13, "a plan, and four photos beside the mesh and their depths");

    let work = folder.0.join("work-rough");
    for stage in [Stage::DepthMaps, Stage::Fusion, Stage::Meshing, Stage::Texturing] {
        let progress = StopIn::new(stage);
        let error = reconstruct(&spec, &work, &rough, &progress).unwrap_err();
        assert!(error.is_cancelled(), "{stage:?}: {error}");
        assert!(MapFolder::open(&rough).is_ok(), "{stage:?}: the sparse map is there");
    }
    let summary = reconstruct(&spec, &work, &rough, &NoProgress).unwrap();
    let cached = |name: &str| {
        summary.stages.iter().any(|stage| stage.name == name && stage.cached == stage.units)
    };
    assert!(cached("dense") && cached("mesh"), "finished stages are not done again");
    assert!(files(&calm) == files(&rough));

    // What is not asked for any more does not stay behind.
    let sparse = JobSpec { stages: vec![StageGroup::Sfm], ..spec };
    let summary = reconstruct(&sparse, &work, &rough, &NoProgress).unwrap();
    assert!(summary.dense.is_none() && !rough.join("mesh.ply").exists());
}

/// Takes a photo away when the depth maps begin.
struct Thief<'a> {
    photo: &'a Path,
    came: AtomicBool,
}

impl Progress for Thief<'_> {
    fn report(&self, stage: Stage, _done: usize, _total: usize) {
        if stage == Stage::DepthMaps && !self.came.swap(true, Ordering::Relaxed) {
            fs::remove_file(self.photo).unwrap();
        }
    }
}

impl StageProgress for Thief<'_> {}

/// A dense stage that fails says why, and the sparse map is as good as it was.
#[test]
fn a_dense_stage_that_fails_leaves_the_sparse_map() {
    let folder = Folder::new("thief");
    let (_, spec) = scan(&folder.0);
    let out = folder.0.join("out");
    let thief = Thief { photo: &spec.images[4].path, came: AtomicBool::new(false) };
    let summary = reconstruct(&spec, &folder.0.join("work"), &out, &thief).unwrap();
    assert_eq!(summary.surface_error().unwrap().code, "io");
    assert!(!summary.is_complete() && summary.num_registered == spec.images.len());
    assert!(MapFolder::open(&out).is_ok() && !out.join("dense.ply").exists());
    let info = map_folder::read_info(&out).unwrap();
    assert_eq!((info.num_dense_points, info.num_triangles), (None, None));
}
