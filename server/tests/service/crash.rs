//! The service dies without a word, again and again; nothing that it answered is lost.

use std::{
    collections::BTreeMap,
    net::SocketAddr,
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use crate::support::{Client, Folder, photo};
use serde_json::Value;

const DATA: &str = "VOLERY_TEST_DATA";
/// A worker program other than the fake one, for tries by hand.
const PROGRAM: &str = "VOLERY_TEST_WORKER";
const KILLS: u32 = 12;

/// Not a test by itself: the service that the test below kills.
#[tokio::test(flavor = "multi_thread")]
async fn service_to_be_killed() {
    let Ok(data) = std::env::var(DATA) else { return };
    let data = Path::new(&data);
    let mut config = crate::support::config(data);
    config.jobs.keep_work_folders = true;
    if let Some(program) = std::env::var_os(PROGRAM) {
        config.worker_program = program.into();
    }
    let server = volery_server::start(config).await.unwrap();
    if let Some(token) = &server.admin_token {
        std::fs::write(data.join("token"), token).unwrap();
    }
    std::fs::write(data.join("address.new"), server.addr.to_string()).unwrap();
    std::fs::rename(data.join("address.new"), data.join("address")).unwrap();
    std::future::pending::<()>().await;
}

/// Killed with its handle, as hard as it goes.
struct Service(Child);

impl Drop for Service {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

async fn start(data: &Path) -> (Service, Client) {
    // It may not be there yet.
    let _ = std::fs::remove_file(data.join("address"));
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "crash::service_to_be_killed", "--nocapture"])
        .env(DATA, data)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let service = Service(child);
    let start = Instant::now();
    let addr: SocketAddr = loop {
        if let Ok(addr) = std::fs::read_to_string(data.join("address")) {
            break addr.parse().unwrap();
        }
        assert!(start.elapsed() < Duration::from_secs(30), "the service does not start");
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    let token = std::fs::read_to_string(data.join("token")).unwrap();
    (service, Client { addr, token: Some(token) })
}

/// Path and hash of every file of the map of a job.
async fn files(client: &Client, job: &Value) -> BTreeMap<String, String> {
    let map = job["outputs"]["map_id"].as_str().unwrap();
    let map = client.get(&format!("/v1/maps/{map}")).await.expect(200).json();
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let files = map["active"]["files"].as_array().unwrap().iter();
    files.map(|file| (text(&file["path"]), text(&file["sha256"]))).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_answered_is_lost_and_the_job_ends_with_the_same_map() {
    let names = ["slow-1.jpg", "slow-2.jpg", "slow-3.jpg"];
    let folder = Folder::new();
    let (service, client) = start(&folder.0).await;
    let undisturbed = client.reconstruct(&names).await;
    let undisturbed = client.finished(&undisturbed).await;
    let expected = files(&client, &undisturbed).await;
    let job = client.reconstruct(&names).await;
    let set = client.imageset(&["first.jpg"]).await;
    let mut kept = vec!["first.jpg".to_owned()];
    drop(service);

    for kill in 0..KILLS {
        let (service, client) = start(&folder.0).await;
        let path = format!("/v1/imagesets/{set}/images");
        let until = Instant::now() + Duration::from_millis(u64::from(kill * 37 % 120));
        let mut number = 0;
        while Instant::now() < until {
            let name = format!("{kill}-{number}.jpg");
            let headers = [("Content-Type", "image/jpeg"), ("X-Image-Name", &name[..])];
            client.send("POST", &path, &headers, &photo(&name)).await.expect(200);
            kept.push(name);
            number += 1;
        }
        drop(service);
    }

    let (_service, client) = start(&folder.0).await;
    let job = client.finished(&job).await;
    assert_eq!(job["state"], "succeeded", "{job:#}");
    assert_eq!(job["attempt"], 1, "deaths of the service are not the job's");
    assert_eq!(files(&client, &job).await, expected);
    let page = client.get(&format!("/v1/imagesets/{set}/images?limit=1000")).await.json();
    let images = page["items"].as_array().unwrap();
    let stored: Vec<_> = images.iter().map(|image| image["name"].as_str().unwrap()).collect();
    for name in &kept {
        let at = stored.iter().position(|stored| stored == name);
        let image = &images[at.unwrap_or_else(|| panic!("{name} is lost"))];
        let path = format!("/v1/images/{}/bytes", image["id"].as_str().unwrap());
        assert_eq!(client.get(&path).await.expect(200).body, photo(name));
    }
    let units = std::fs::read_to_string(
        folder.0.join("jobs").join(job["id"].as_str().unwrap()).join("units"),
    )
    .unwrap();
    let units: Vec<_> = units.lines().collect();
    let repeated = units.len() - units.iter().collect::<std::collections::BTreeSet<_>>().len();
    assert!(repeated <= KILLS as usize + 1, "{repeated} units were done twice");
    println!("{KILLS} kills, {} uploads, 0 lost", kept.len());
}
