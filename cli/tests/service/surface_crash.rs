//! A job is cancelled, and the service killed, in every stage that makes the surface. It ends with
//! the bytes of an undisturbed run.

use std::collections::BTreeSet;

use uuid::Uuid;
use volery_api::{CreateJob, Job, JobState, Preset};
use volery_client::Client;

use crate::{
    server::{Photos, Server, glance_until, map_content, mapped, upload},
    support::{Folder, hall_photos},
};

const NUM_PHOTOS: usize = 10;

/// Stages of a surface.
const STAGES: [&str; 4] = ["depth_maps", "fusion", "meshing", "texturing"];

/// Where a job is among [`STAGES`]; `None` before them.
fn position(job: &Job) -> Option<usize> {
    STAGES.iter().position(|stage| job.stage.as_deref() == Some(stage))
}

async fn submit(client: &Client, photos: &Photos) -> Uuid {
    let request = CreateJob {
        imageset_ids: vec![upload(client, photos).await],
        preset: Preset::Fast,
        stages: vec![volery_api::StageGroup::Mesh],
        seed: 9,
        ..CreateJob::default()
    };
    client.create_job(&request).await.unwrap().id
}

#[test]
fn a_surface_cancelled_and_killed_in_every_stage_is_the_same() {
    let folder = Folder::new("surface-crash");
    let hall = hall_photos(&folder.0);
    let mut photos = Photos::in_folder(&folder.join("scan"), Some(*hall.camera()));
    photos.files.truncate(NUM_PHOTOS);
    let runtime = tokio::runtime::Runtime::new().unwrap();

    let data = folder.join("rough");
    let mut server = Server::start(&data);
    let job = runtime.block_on(submit(&server.client(), &photos));
    let (mut cancelled, mut killed) = (BTreeSet::new(), BTreeSet::new());
    for stage in 0..STAGES.len() {
        let client = server.client();
        let reached = |job: &Job| position(job) >= Some(stage);
        runtime.block_on(async {
            glance_until(&client, job, reached).await;
            if client.cancel_job(job).await.is_ok() {
                let ended = glance_until(&client, job, |_| false).await;
                assert_eq!(ended.state, JobState::Cancelled, "{ended:?}");
                assert_eq!(ended.outputs, None);
                cancelled.extend(ended.stage);
                client.retry_job(job, None).await.unwrap();
            }
        });
        let last = runtime.block_on(glance_until(&client, job, reached));
        server.kill();
        if !last.state.is_final() {
            killed.extend(last.stage);
        }
        server = Server::start(&data);
    }
    println!("cancelled in {cancelled:?}, killed in {killed:?}");
    for stage in ["depth_maps", "meshing"] {
        assert!(cancelled.contains(stage) && killed.contains(stage), "{stage}");
    }

    let content = |server: &Server, job: Uuid| {
        let client = server.client();
        runtime.block_on(async {
            let job = mapped(&client, job).await;
            map_content(&client, &job).await
        })
    };
    let rough = content(&server, job);
    drop(server);
    let server = Server::start(&folder.join("calm"));
    let job = runtime.block_on(submit(&server.client(), &photos));
    let calm = content(&server, job);
    for name in ["dense.ply", "mesh.ply", "map.glb", "freespace.bin"] {
        assert!(calm.contains_key(name), "{name}");
    }
    assert_eq!(rough, calm);
}
