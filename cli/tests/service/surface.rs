//! Maps with surfaces as a user meets them: drawn, compared with photos, joined.

use std::fs;

use uuid::Uuid;
use volery_api::{
    CameraPose, CreateJob, LocalizeMethod, LocalizePrior, LocalizeStatus, PositionPrior, Preset,
    RegisterMaps, RenderRequest, RenderWhat, StageGroup, YawPrior,
};
use volery_client::{Client, LocalizeQuery};
use volery_geometry::{Point3, Vector3, similarity_from_points};

use crate::server::{Photos, Scanned, api_camera, mapped, upload};
use crate::support::{utf8, volery_json};

async fn map_of(client: &Client, set: Uuid, last: StageGroup) -> Uuid {
    let request = CreateJob {
        imageset_ids: vec![set],
        preset: Preset::Fast,
        stages: vec![last],
        ..CreateJob::default()
    };
    let job = client.create_job(&request).await.unwrap();
    mapped(client, job.id).await.outputs.unwrap().map_id
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

/// Correlation of the gray values of two pictures where the first shows something.
fn correlation(drawn: &image::GrayImage, photo: &image::GrayImage) -> f64 {
    let pairs = drawn.pixels().zip(photo.pixels()).filter(|(drawn, _)| drawn.0[0] > 0);
    let values: Vec<[f64; 2]> =
        pairs.map(|(a, b)| [f64::from(a.0[0]), f64::from(b.0[0])]).collect();
    let n = values.len() as f64;
    let mean = [0, 1].map(|k| values.iter().map(|v| v[k]).sum::<f64>() / n);
    let product = |i: usize, j: usize| {
        values.iter().map(|v| (v[i] - mean[i]) * (v[j] - mean[j])).sum::<f64>() / n
    };
    product(0, 1) / (product(0, 0) * product(1, 1)).sqrt()
}

/// A view of the mesh from where a photo was taken looks like it, its depth says so in floats; the
/// photo is found again by the view alone; and a second map joins the first with all its photos.
#[test]
fn a_map_is_drawn_compared_and_joined() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let scanned = runtime.block_on(Scanned::new("surface"));
    let Scanned { server, client, hall, set, folder } = &scanned;
    let files = Photos::in_folder(&folder.join("scan"), None).files;
    let (first, second) = runtime.block_on(async {
        let first = map_of(client, *set, StageGroup::Mesh).await;
        let camera = Some(*hall.camera());
        let end = upload(client, &Photos { files: files[8..].to_vec(), camera }).await;
        (first, map_of(client, end, StageGroup::Sfm).await)
    });

    let shot = &hall.scan[5];
    let path = folder.join("scan").join(&shot.name);
    let file = fs::read(&path).unwrap();
    let ask = |map: Uuid, prior, method| {
        let query = LocalizeQuery { image: file.clone(), prior, method, ..Default::default() };
        async move { client.localize(map, &query).await.unwrap().localization }
    };
    let pose = runtime.block_on(async {
        let found = ask(first, None, Some(LocalizeMethod::Pnp)).await;
        assert_eq!(found.status, LocalizeStatus::Ok, "{found:?}");
        let pose = found.pose.unwrap();

        let request = |what| RenderRequest {
            pose: CameraPose { ..pose.clone() },
            camera: Some(api_camera(hall.camera())),
            what,
        };
        let png = client.render_map(first, &request(RenderWhat::Color)).await.unwrap();
        let drawn = image::load_from_memory(&png).unwrap().to_luma8();
        let photo = image::load_from_memory(&file).unwrap().to_luma8();
        assert_eq!(drawn.dimensions(), photo.dimensions());
        let alike = correlation(&drawn, &photo);
        assert!(alike > 0.8, "{alike}");
        let depths = client.render_map(first, &request(RenderWhat::DepthF32)).await.unwrap();
        let depths: Vec<f32> =
            depths.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let (width, height) = photo.dimensions();
        assert_eq!(depths.len(), (width * height) as usize);
        assert!(depths.iter().filter(|d| **d > 0.0).count() * 2 > depths.len());
        pose
    });

    // By the view alone, from a place and a yaw that are somewhat off.
    let [w, i, j, k] = pose.orientation;
    let rotation = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
    let forward = rotation * Vector3::z();
    let yaw = YawPrior { yaw: forward.y.atan2(forward.x) + 0.03, sigma: 0.05 };
    let [x, y, z] = pose.position;
    let position = PositionPrior { position: [x + 0.1, y - 0.1, z + 0.05], sigma: 0.2 };
    let prior = LocalizePrior { position: Some(position), yaw: Some(yaw) };
    let by_view = runtime.block_on(ask(first, Some(prior), Some(LocalizeMethod::Template)));
    assert_eq!(by_view.status, LocalizeStatus::Ok, "{by_view:?}");
    assert_eq!(by_view.method, Some(LocalizeMethod::Template));
    let off = distance(by_view.pose.unwrap().position, pose.position);
    assert!(off < 0.1, "{off}");
    let without = runtime.block_on(ask(first, None, Some(LocalizeMethod::Template)));
    assert_eq!(without.reason.as_deref(), Some("no_prior"));

    // As the program asks: the telemetry's yaw goes along, for a map that knows its north or not.
    let near = format!("{:.2},{:.2},{:.2}", x + 0.1, y, z);
    let telemetry = folder.join("telemetry.csv");
    let map = first.to_string();
    let (answer, _) = volery_json(&[
        "localize",
        "--server",
        &server.url,
        "--token",
        &server.token,
        "--map",
        &map,
        "--near",
        &near,
        "--telemetry",
        utf8(&telemetry),
        "--json",
        utf8(&path),
    ]);
    assert_eq!(answer["num_ok"], 1, "{answer:#}");

    runtime.block_on(async {
        let request = RegisterMaps {
            maps: vec![first, second],
            stages: vec![StageGroup::Sfm],
            ..RegisterMaps::default()
        };
        let job = client.register_maps(&request).await.unwrap();
        let joined = mapped(client, job.id).await.outputs.unwrap().map_id;
        let cameras = client.map_cameras(joined).await.unwrap().images;
        assert_eq!(cameras.len(), files.len() + files[8..].len());
        let (found, truth): (Vec<_>, Vec<_>) = cameras
            .iter()
            .map(|camera| {
                let name = camera.image.rsplit('/').next().unwrap();
                let shot = hall.scan.iter().find(|shot| shot.name == name).unwrap();
                let center = shot.cam_from_world.inverse().translation.vector;
                (Point3::from(camera.pose.position), Point3::from(center))
            })
            .unzip();
        let align = similarity_from_points(&found, &truth).unwrap();
        let worst =
            found.iter().zip(&truth).map(|(f, t)| (align * f - t).norm()).fold(0.0, f64::max);
        assert!(worst < 0.05, "{worst}");
        let again = ask(joined, None, None).await;
        assert_eq!(again.status, LocalizeStatus::Ok);
    });
}
