//! Maps of two flights through one hall become one map.

mod support;

use std::{fs, path::Path, sync::LazyLock};

use support::Folder;
use volery_formats::read_ply_of_cloud;
use volery_geometry::{Camera, CameraModel, KdTree, Point3, Rng, Vector3, similarity_from_points};
use volery_pipeline::{
    CameraSpec, FoundBy, ImageInput, JobSpec, MapFolder, MapSource, PipelineError, Preset,
    RegisterReport, Registration, RegistrationMethod, StageGroup, extend_map, map_folder::read_map,
    reconstruct, register_maps,
};
use volery_scene::{NoProgress, PositionPrior, RegisteredImage};
use volery_synthetic::{CenterMotion, Hall, Renderer, Sensor, yaw_scan};

/// Photos of the whole round, and those of the two flights; they share the view of five photos,
/// not the photos.
const NUM_PHOTOS: usize = 28;
const FLIGHTS: [std::ops::Range<usize>; 2] = [0..16, 12..28];

fn camera() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 400, 300, 300.0).unwrap()
}

fn round(seed: u64) -> Vec<volery_geometry::Isometry3<f64>> {
    let motion = CenterMotion::Circle { radius: 0.9 };
    yaw_scan(&Point3::new(0.0, 0.0, 1.5), NUM_PHOTOS, 0.2, motion, seed)
}

/// Photos of a flight, named by their place on the round, as in every flight.
fn photos(
    folder: &Path,
    hall_seed: u64,
    flight: usize,
    places: impl Iterator<Item = usize>,
) -> JobSpec {
    let hall = Hall::furnished(Vector3::new(8.0, 7.0, 3.0), 0.008, hall_seed);
    let renderer = Renderer::new(&camera());
    let poses = round(5 + flight as u64);
    let images = places.map(|i| {
        let seed = (100 * flight + i) as u64;
        let photo = Sensor::default().expose(&renderer.render(&hall, &poses[i]), seed);
        let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
        let path = folder.join(format!("{hall_seed}-{flight}-{i}.png"));
        image::save_buffer(&path, &pixels, photo.width, photo.height, image::ColorType::Rgb8)
            .unwrap();
        ImageInput::new(format!("{i}.png"), path)
    });
    JobSpec {
        camera: Some(CameraSpec::from(&camera())),
        stages: vec![StageGroup::Sfm],
        preset: Preset::Fast,
        ..JobSpec::new(images.collect())
    }
}

/// The map of a flight.
fn fly(folder: &Path, hall_seed: u64, flight: usize) -> MapSource {
    let spec = photos(folder, hall_seed, flight, FLIGHTS[flight].clone());
    let name = format!("flight {hall_seed}-{flight}");
    let out = folder.join(&name);
    let summary = reconstruct(&spec, &folder.join("work"), &out, &NoProgress).unwrap();
    assert_eq!(summary.num_registered, FLIGHTS[flight].len(), "{:?}", summary.quality);
    let photos = spec.images.iter().map(|image| image.path.clone()).collect();
    MapSource { name, folder: out, photos }
}

/// The first flight through the hall, mapped once for all tests.
fn first_flight() -> MapSource {
    static MAP: LazyLock<MapSource> = LazyLock::new(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pipeline-first-flight");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        fly(&folder, 5, 0)
    });
    MAP.clone()
}

/// Of the sparse maps.
fn join(sources: &[MapSource], out: &Path) -> Result<RegisterReport, PipelineError> {
    let spec = JobSpec { stages: vec![StageGroup::Sfm], seed: 1, ..JobSpec::new(Vec::new()) };
    let work = out.with_extension("work");
    register_maps(sources, &Registration::default(), &spec, &work, out, &NoProgress)
}

/// P52, P53: one frame, one model, one index; photos of either flight are where they were taken.
#[test]
fn two_flights_become_one_map() {
    let folder = Folder::new("join");
    let sources = [first_flight(), fly(&folder.0, 5, 1)];
    let out = folder.0.join("joined");
    let report = join(&sources, &out).unwrap();
    assert_eq!(report.lack(), None);
    let [pair] = &report.pairs[..] else { panic!("{:?}", report.pairs) };
    assert!(pair.used && pair.num_inliers >= 20 && pair.error.is_none(), "{pair:?}");
    assert!(pair.overlap > 0.1 && report.num_shared_points >= 20);
    assert!(report.reprojection_px.unwrap() < 1.5);

    let (info, map) = read_map(&out).unwrap();
    assert_eq!((info.num_images, info.inputs.len()), (32, 32));
    let truth: Vec<Point3<f64>> = FLIGHTS
        .iter()
        .enumerate()
        .flat_map(|(flight, range)| range.clone().map(move |i| (flight, i)))
        .map(|(flight, i)| Point3::from(round(5 + flight as u64)[i].inverse().translation.vector))
        .collect();
    let found: Vec<Point3<f64>> = map.model.images.values().map(RegisteredImage::center).collect();
    let align = similarity_from_points(&found, &truth).unwrap();
    for (image, (found, truth)) in map.model.images.values().zip(found.iter().zip(&truth)) {
        let off = (align * found - truth).norm();
        assert!(off < 0.03, "{} is off by {off} m", image.name);
    }
    // The second flight repeats names of the first.
    let names: Vec<&str> = map.model.images.values().map(|image| image.name.as_str()).collect();
    assert_eq!((names[15], names[16], names[31]), ("15.png", "2/12.png", "27.png"));
    let index = MapFolder::open(&out).unwrap();
    assert_eq!(index.index().num_images(), 32);
    let alone = MapFolder::open(&sources[0].folder).unwrap();
    assert!(index.index().num_points() > alone.index().num_points() * 3 / 2);

    // A map that was joined can be joined again, and equal runs give equal bytes.
    let again = folder.0.join("again");
    assert_eq!(join(&sources, &again).unwrap(), report);
    for name in ["map.json", "localization.bin", "colmap/points3D.txt"] {
        assert!(fs::read(out.join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name}");
    }
    let kept: RegisterReport =
        serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(kept, report);
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(sources.iter().all(|source| page.contains(&source.name)));
}

/// Two halls are not one, and one map is nothing to join; nothing is written.
#[test]
fn flights_through_two_halls_are_refused() {
    let folder = Folder::new("refuse");
    let sources = [first_flight(), fly(&folder.0, 6, 1)];
    let out = folder.0.join("joined");
    let error = join(&sources, &out).unwrap_err();
    assert_eq!(error.code, "no_overlap", "{error}");
    assert!(!out.join("map.json").exists());
    let error = join(&sources[..1], &out).unwrap_err();
    assert_eq!(error.code, "bad_input");
    let missing = MapSource { folder: folder.0.join("x"), ..sources[0].clone() };
    let error = join(&[sources[0].clone(), missing], &out).unwrap_err();
    assert_eq!(error.code, "bad_map");
}

/// Largest distance of camera centers from the truth of the flights that `flight_of` tells, after
/// the frame of the map is found from all of them.
fn largest_error(folder: &Path, flight_of: impl Fn(&str) -> (usize, usize)) -> f64 {
    let (_, map) = read_map(folder).unwrap();
    let (found, truth): (Vec<_>, Vec<_>) = map
        .model
        .images
        .values()
        .map(|image| {
            let (flight, place) = flight_of(&image.name);
            let pose = round(5 + flight as u64)[place].inverse();
            (image.center(), Point3::from(pose.translation.vector))
        })
        .unzip();
    let align = similarity_from_points(&found, &truth).unwrap();
    found.iter().zip(&truth).map(|(f, t)| (align * f - t).norm()).fold(0.0, f64::max)
}

/// Two photos are no map, but each sees what the map knows; photos that are in it already, one
/// given twice and one of another hall do not count.
#[test]
fn two_photos_join_a_map_and_known_ones_are_left_alone() {
    let folder = Folder::new("extend");
    let map = first_flight();
    let known = photos(&folder.0, 5, 0, [3, 4].into_iter());
    let fresh = photos(&folder.0, 5, 1, [12, 14].into_iter());
    let foreign = photos(&folder.0, 6, 1, [13].into_iter());
    let mut spec = known.clone();
    spec.images.extend(fresh.images.clone());
    spec.images.extend(foreign.images);
    spec.images.push(ImageInput { name: "again.png".to_owned(), ..fresh.images[0].clone() });
    let (work, new) = (folder.0.join("work"), folder.0.join("new"));
    let extend = |spec: &JobSpec, map: &MapSource, name: &str| {
        let out = folder.0.join(name);
        extend_map(map, spec, &work, &new, &out, &NoProgress).map(|report| (report, out))
    };
    let (report, out) = extend(&spec, &map, "extended").unwrap();
    let reasons: Vec<_> = report.photos.iter().map(|photo| photo.reason.as_deref()).collect();
    assert_eq!(reasons[..4], [Some("already_in_map"), Some("already_in_map"), None, None]);
    assert!(reasons[4].is_some_and(|reason| reason.starts_with("too_few")), "{reasons:?}");
    assert_eq!(reasons[5], Some("repeated"));
    let joined: Vec<bool> = report.photos.iter().map(|photo| photo.joined).collect();
    assert_eq!(joined, [false, false, true, true, false, false]);
    assert_eq!(report.photos[5].same_as.as_deref(), Some("12.png"));
    assert_eq!(report.lack().unwrap().code, "images_unplaced");

    let (info, _) = read_map(&out).unwrap();
    assert_eq!((info.num_images, info.inputs.len()), (18, 19));
    let of_name = |name: &str| match name.strip_prefix("2/") {
        Some(new) => (1, new.strip_suffix(".png").unwrap().parse().unwrap()),
        None => (0, name.strip_suffix(".png").unwrap().parse().unwrap()),
    };
    let error = largest_error(&out, of_name);
    assert!(error < 0.03, "{error}");
    assert_eq!(MapFolder::open(&out).unwrap().index().num_images(), 18);

    // The same photos again are nothing new, and the foreign one alone joins nothing.
    let extended = MapSource { folder: out, ..map };
    let again = JobSpec { images: spec.images[..4].to_vec(), ..spec.clone() };
    assert_eq!(extend(&again, &extended, "again").unwrap_err().code, "nothing_new");
    let foreign = JobSpec { images: vec![spec.images[4].clone()], ..spec };
    assert_eq!(extend(&foreign, &extended, "foreign").unwrap_err().code, "no_overlap");
    assert!(!folder.0.join("foreign").join("map.json").exists());
}

/// A flight that goes on beyond the map joins as a map of its own.
#[test]
fn a_flight_extends_a_map() {
    let folder = Folder::new("fly-on");
    let map = first_flight();
    let spec = photos(&folder.0, 5, 1, FLIGHTS[1].clone());
    let out = folder.0.join("out");
    let (work, new) = (folder.0.join("work"), folder.0.join("new"));
    let report = extend_map(&map, &spec, &work, &new, &out, &NoProgress).unwrap();
    assert_eq!(report.lack(), None);
    assert!(report.photos.iter().all(|photo| photo.joined));
    assert_eq!(report.maps.len(), 2);
    let (info, map) = read_map(&out).unwrap();
    assert_eq!((info.num_images, info.inputs.len()), (32, 32));
    let numbered: Vec<String> = map.model.images.values().map(|image| image.name.clone()).collect();
    let of_name = |name: &str| {
        let place = numbered.iter().position(|known| known == name).unwrap();
        if place < 16 { (0, place) } else { (1, place - 4) }
    };
    let error = largest_error(&out, of_name);
    assert!(error < 0.03, "{error}");
}

/// Shorter flights, since depth maps cost time.
const DENSE_FLIGHTS: [std::ops::Range<usize>; 2] = [0..11, 7..18];

/// Share of the points of a dense cloud that lie on the hall, where the map is in its frame.
fn share_on_walls(folder: &Path) -> f64 {
    let cloud = read_ply_of_cloud(&fs::read(folder.join("dense.ply")).unwrap()).unwrap();
    let hall = Hall::furnished(Vector3::new(8.0, 7.0, 3.0), 0.008, 5);
    let mut rng = Rng::new(1);
    let walls: Vec<Point3<f64>> =
        (0..200_000).map(|_| hall.room.surface_point(&mut rng).position).collect();
    let walls = KdTree::new(&walls);
    let seen: Vec<_> = cloud.points.iter().filter(|point| !point.inferred).collect();
    let on_walls = seen.iter().filter(|p| walls.nearest_within(&p.position.cast(), 0.05).is_some());
    on_walls.count() as f64 / seen.len() as f64
}

/// A flight that knows its places, with a dense cloud.
fn fly_dense(folder: &Path, flight: usize) -> MapSource {
    let mut spec = photos(folder, 5, flight, DENSE_FLIGHTS[flight].clone());
    for (image, place) in spec.images.iter_mut().zip(DENSE_FLIGHTS[flight].clone()) {
        let pose = round(5 + flight as u64)[place].inverse();
        let position = Point3::from(pose.translation.vector);
        image.prior.position = Some(PositionPrior { position, sigma: 0.01 });
    }
    spec.stages = vec![StageGroup::Dense];
    let name = format!("dense {flight}");
    let out = folder.join(&name);
    let summary = reconstruct(&spec, &folder.join("work"), &out, &NoProgress).unwrap();
    assert!(summary.scale.metric && summary.surface_error().is_none(), "{summary:?}");
    let photos = spec.images.iter().map(|image| image.path.clone()).collect();
    MapSource { name, folder: out, photos }
}

/// P53, P54: where no point is asked, the shape of the hall brings two flights together, and the
/// dense cloud of what comes of it lies on the walls of both.
#[test]
fn surfaces_join_two_flights_and_have_one_cloud() {
    let folder = Folder::new("surfaces");
    let sources = [fly_dense(&folder.0, 0), fly_dense(&folder.0, 1)];
    let how = Registration { method: RegistrationMethod::Surfaces, with_scale: false };
    let spec = JobSpec {
        stages: vec![StageGroup::Dense],
        preset: Preset::Fast,
        ..JobSpec::new(Vec::new())
    };
    let (work, out) = (folder.0.join("work"), folder.0.join("joined"));
    let report = register_maps(&sources, &how, &spec, &work, &out, &NoProgress).unwrap();
    assert_eq!(report.lack(), None);
    let [pair] = &report.pairs[..] else { panic!("{:?}", report.pairs) };
    assert_eq!((pair.by, pair.scale), (Some(FoundBy::Surfaces), Some(1.0)));
    assert!(pair.iterations.is_some_and(|n| n > 0) && pair.rms.unwrap() < 0.05, "{pair:?}");
    let (info, map) = read_map(&out).unwrap();
    assert_eq!(report.dense.as_ref().unwrap().num_depth_maps, 22);
    // Both flights know where they were, so that the frame of the map is that of the hall.
    let flown = DENSE_FLIGHTS.iter().enumerate();
    let flown = flown.flat_map(|(flight, range)| range.clone().map(move |i| (flight, i)));
    for (image, (flight, place)) in map.model.images.values().zip(flown) {
        let truth = round(5 + flight as u64)[place].inverse().translation.vector;
        let off = (image.center().coords - truth).norm();
        assert!(off < 0.05, "{} is off by {off} m", image.name);
    }
    let cloud = read_ply_of_cloud(&fs::read(out.join("dense.ply")).unwrap()).unwrap();
    assert_eq!(info.num_dense_points, Some(cloud.points.len()));
    // It lies on the walls as well as the clouds of the flights do, and shows more of them.
    let alone = sources.iter().map(|source| share_on_walls(&source.folder)).fold(1.0, f64::min);
    let joined = share_on_walls(&out);
    assert!(joined > 0.8 && joined > alone - 0.05, "{joined}, alone {alone}");
    for source in &sources {
        let (flight, _) = read_map(&source.folder).unwrap();
        assert!(cloud.points.len() * 4 > flight.num_dense_points.unwrap() * 5);
    }

    // Photos that are gone are told; the map stays.
    let gone = sources.map(|source| MapSource { photos: Vec::new(), ..source });
    let out = folder.0.join("gone");
    let report = register_maps(&gone, &Registration::default(), &spec, &work, &out, &NoProgress);
    assert_eq!(report.unwrap().lack().unwrap().code, "no_photos");
    assert!(out.join("map.json").exists() && !out.join("dense.ply").exists());
}
