//! Photos in, a map out, a photo finds its pose in it.

use std::fs;

use uuid::Uuid;
use volery_api::LocalizeStatus;
use volery_client::{Client, LocalizeQuery};

use crate::server::{Scanned, mapped, submit};

/// The decoder of untrusted bytes makes it, and it is a picture of the size asked for.
async fn check_thumbnail(client: &Client, set: Uuid) {
    let photo = &client.images(set).await.unwrap()[0];
    let png = client.image_thumbnail(photo.id, Some(128)).await.unwrap();
    let picture = image::load_from_memory(&png).unwrap();
    assert_eq!(picture.width().max(picture.height()), 128);
    let ratio = |width: u32, height: u32| f64::from(width) / f64::from(height);
    let (of_photo, of_picture) =
        (ratio(photo.width, photo.height), ratio(picture.width(), picture.height()));
    assert!((of_photo / of_picture - 1.0).abs() < 0.01, "{of_photo} {of_picture}");
}

/// Upload, job with its events, localization.
#[test]
fn photos_become_a_map_and_a_photo_finds_its_pose() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let Scanned { client, hall, set, folder, .. } = &Scanned::new("journey").await;
        check_thumbnail(client, *set).await;
        let job = submit(client, *set).await;
        let mut last = 0;
        let watched = client
            .watch_job(job.id, |event| {
                assert_eq!(event.seq, last + 1, "events come in order, each once");
                last = event.seq;
            })
            .await
            .unwrap();
        let job = mapped(client, job.id).await;
        assert_eq!(watched.state, job.state);

        let map = job.outputs.unwrap().map_id;
        let ask = |image| {
            let query = LocalizeQuery { image, ..LocalizeQuery::default() };
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
