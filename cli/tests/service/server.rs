//! `volery serve` as a child process, and what every test asks of it.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use serde_json::Value;
use uuid::Uuid;
use volery_api::{CreateJob, Job, JobState, StageGroup};
use volery_client::{Client, UploadFile};
use volery_geometry::Camera;
use volery_synthetic::DemoHall;

use crate::support::{Folder, hall_photos, utf8};

/// For a job to end.
const MAX_WAIT: Duration = Duration::from_secs(300);

/// Between two looks at a job.
const GLANCE: Duration = Duration::from_millis(2);

/// `volery serve` in a child process that dies with this handle.
pub(crate) struct Server {
    child: Child,
    pub(crate) url: String,
    pub(crate) token: String,
}

impl Server {
    pub(crate) fn start(data: &Path) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_volery"))
            .args(["serve", "--json", "--data", utf8(data), "--listen", "127.0.0.1:0"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).expect("the server says where it listens");
        let url = said["url"].as_str().unwrap().to_owned();
        // The token comes at the first start over a data folder only.
        let kept = data.join("token");
        if let Some(token) = said["admin_token"].as_str() {
            fs::write(&kept, token).unwrap();
        }
        let token = fs::read_to_string(&kept).unwrap();
        Self { child, url, token }
    }

    pub(crate) fn client(&self) -> Client {
        Client::new(&self.url, Some(&self.token)).unwrap()
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// As hard as it goes.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Photos of a set and their camera, where it is known.
pub(crate) struct Photos {
    pub(crate) files: Vec<UploadFile>,
    pub(crate) camera: Option<Camera>,
}

impl Photos {
    /// All files of a folder.
    pub(crate) fn in_folder(folder: &Path, camera: Option<Camera>) -> Self {
        let mut paths: Vec<_> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        Self { files: paths.iter().map(|path| path.as_path().into()).collect(), camera }
    }
}

pub(crate) fn api_camera(camera: &Camera) -> volery_api::Camera {
    volery_api::Camera {
        model: camera.model.name().to_owned(),
        width: camera.width,
        height: camera.height,
        params: camera.params().to_vec(),
    }
}

/// A service that has the photos of a hall.
pub(crate) struct Scanned {
    pub(crate) server: Server,
    pub(crate) client: Client,
    pub(crate) hall: DemoHall,
    /// The uploaded photos.
    pub(crate) set: Uuid,
    /// Last, to go when nobody uses it any more.
    pub(crate) folder: Folder,
}

impl Scanned {
    pub(crate) async fn new(name: &str) -> Self {
        let folder = Folder::new(name);
        let hall = hall_photos(&folder.0);
        let server = Server::start(&folder.join("data"));
        let client = server.client();
        let photos = Photos::in_folder(&folder.join("scan"), Some(*hall.camera()));
        let set = upload(&client, &photos).await;
        Self { server, client, hall, set, folder }
    }
}

/// A set with `photos`, all of which must be taken.
pub(crate) async fn upload(client: &Client, photos: &Photos) -> Uuid {
    let camera = match &photos.camera {
        Some(camera) => Some(client.create_camera("test", api_camera(camera)).await.unwrap().id),
        None => None,
    };
    let set = client.create_imageset("photos", camera).await.unwrap();
    let results = client.upload_files(set.id, &photos.files, |_, _| {}).await.unwrap();
    assert!(results.iter().all(|result| result.image_id.is_some()), "{results:?}");
    set.id
}

pub(crate) async fn submit(client: &Client, set: Uuid) -> Job {
    let request = CreateJob {
        imageset_ids: vec![set],
        seed: 9,
        stages: vec![StageGroup::Sfm],
        ..CreateJob::default()
    };
    client.create_job(&request).await.unwrap()
}

/// Looks at a job again and again until `enough` says so or it has ended.
pub(crate) async fn glance_until(
    client: &Client,
    id: Uuid,
    mut enough: impl FnMut(&Job) -> bool,
) -> Job {
    let deadline = Instant::now() + MAX_WAIT;
    loop {
        let job = client.job(id).await.unwrap();
        if enough(&job) || job.state.is_final() {
            return job;
        }
        assert!(Instant::now() < deadline, "the job does not end: {job:?}");
        tokio::time::sleep(GLANCE).await;
    }
}

/// The end of a job that must bring a map.
pub(crate) async fn mapped(client: &Client, id: Uuid) -> Job {
    let job = glance_until(client, id, |_| false).await;
    assert!(matches!(job.state, JobState::Succeeded | JobState::Partial), "{job:?}");
    job
}

/// The map of a job as bytes: the hash of every file but the reports, and the report without its
/// times.
pub(crate) async fn map_content(client: &Client, job: &Job) -> BTreeMap<String, String> {
    let outputs = job.outputs.clone().expect("a job with a map");
    let versions = client.map_versions(outputs.map_id).await.unwrap();
    let version = versions.into_iter().find(|v| v.version == outputs.version).unwrap();
    let mut content: BTreeMap<String, String> = version
        .files
        .into_iter()
        .filter(|file| !file.path.starts_with("report."))
        .map(|file| (file.path, file.sha256))
        .collect();
    let report = client.export(outputs.map_id, "report.json", Some(outputs.version)).await.unwrap();
    let mut report = serde_json::from_slice(&report).unwrap();
    drop_times(&mut report);
    content.insert("report.json".to_owned(), report.to_string());
    content
}

/// Takes out what no two runs share: times, memory, and what came from the cache.
fn drop_times(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Object(fields) => {
            for name in ["wall_s", "cpu_s", "peak_rss_mib", "cached"] {
                fields.remove(name);
            }
            fields.values_mut().for_each(drop_times);
        }
        serde_json::Value::Array(items) => items.iter_mut().for_each(drop_times),
        _ => {}
    }
}
