//! Photos in, a map out, a photo finds its pose in it.

use std::fs;

use volery_api::LocalizeStatus;
use volery_client::LocalizeQuery;

use crate::{
    server::{Photos, Server, mapped, submit, upload},
    support::{Folder, hall_photos},
};

/// Upload, job with its events, localization.
#[test]
fn photos_become_a_map_and_a_photo_finds_its_pose() {
    let folder = Folder::new("journey");
    let hall = hall_photos(&folder.0);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let server = Server::start(&folder.join("data"));
    let client = server.client();
    runtime.block_on(async {
        let photos = Photos::in_folder(&folder.join("scan"), Some(*hall.camera()));
        let job = submit(&client, upload(&client, &photos).await).await;
        let mut last = 0;
        let watched = client
            .watch_job(job.id, |event| {
                assert_eq!(event.seq, last + 1, "events come in order, each once");
                last = event.seq;
            })
            .await
            .unwrap();
        let job = mapped(&client, job.id).await;
        assert_eq!(watched.state, job.state);

        let map = job.outputs.unwrap().map_id;
        let ask = |image| {
            let query = LocalizeQuery { image, ..LocalizeQuery::default() };
            let client = &client;
            async move { client.localize(map, &query).await }
        };
        let mut num_ok = 0;
        for shot in &hall.queries {
            let image = fs::read(folder.join("query").join(&shot.name)).unwrap();
            let answer = ask(image).await.unwrap();
            num_ok += usize::from(answer.localization.status == LocalizeStatus::Ok);
        }
        assert!(num_ok * 4 >= hall.queries.len() * 3, "{num_ok} of {}", hall.queries.len());
        assert_eq!(ask(b"no photo".to_vec()).await.unwrap_err().code(), "not_an_image");
    });
}
