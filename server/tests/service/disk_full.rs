//! A disk without space: what comes is refused, what is there answers, and jobs wait for space.

use std::{fs::File, path::Path, time::Duration};

use serde_json::{Value, json};

use crate::support::{Client, Server, photo};

/// What the tests beside this one may write or delete meanwhile. Bytes.
const MARGIN: u64 = 1 << 30;

fn free_bytes(folder: &Path) -> u64 {
    let stat = rustix::fs::statvfs(folder).unwrap();
    stat.f_bavail * stat.f_frsize
}

/// Takes space until it is deleted.
fn fill(path: &Path) {
    let file = File::create(path).unwrap();
    let mode = rustix::fs::FallocateFlags::empty();
    rustix::fs::fallocate(&file, mode, 0, 2 * MARGIN)
        .expect("the disk of temporary files has 2 GiB");
}

async fn disk(client: &Client) -> Value {
    let health = client.get("/readyz").await.json();
    let checks = health["checks"].as_array().unwrap().clone();
    checks.into_iter().find(|check| check["name"] == "disk").unwrap()
}

#[tokio::test]
async fn a_full_disk_loses_nothing_and_jobs_wait() {
    let free = free_bytes(&std::env::temp_dir());
    let server = Server::start_with(|config| {
        config.limits.disk_reserve_bytes = free.saturating_sub(MARGIN);
    })
    .await;
    let client = &server.client;
    let set = client.imageset(&["a.jpg", "b.jpg"]).await;
    let map = client.map().await;
    let slow = client.reconstruct(&["slow a.jpg", "slow b.jpg"]).await;
    client.wait_for(&slow, &["running"]).await;

    let filler = server.folder.0.join("filler");
    fill(&filler);
    assert_eq!(disk(client).await["ok"], false);
    let refused = client.upload(&set, &[("c.jpg", &photo("c"))]).await;
    assert_eq!(refused.expect(507).code(), "disk_full");
    let job = json!({"imageset_ids": [set]});
    let waiting = client.post("/v1/jobs", job).await.expect(202).json();
    let waiting = waiting["id"].as_str().unwrap();

    // The one that ran has nowhere to put its map, and keeps what it has made.
    let kept = client.wait_for(&slow, &["queued"]).await;
    assert_eq!((&kept["error"]["code"], &kept["attempt"]), (&json!("disk_full"), &json!(0)));
    tokio::time::sleep(Duration::from_millis(2500)).await;
    for job in [waiting, &slow] {
        assert_eq!(client.job(job).await["state"], "queued");
    }
    let path = format!("/v1/maps/{map}/localize");
    let kind = [("Content-Type", "image/jpeg")];
    client.send("POST", &path, &kind, &photo("where")).await.expect(200);
    client.get(&format!("/v1/maps/{map}/export/sparse.ply")).await.expect(200);

    std::fs::remove_file(filler).unwrap();
    for job in [waiting, &slow] {
        let job = client.finished(job).await;
        assert_eq!((&job["state"], &job["error"]), (&json!("succeeded"), &Value::Null), "{job:#}");
    }
    assert_eq!(disk(client).await["ok"], true);
    client.upload(&set, &[("c.jpg", &photo("c"))]).await.expect(200);
}
