//! The service as a user meets it: the program, REST, and the way it bears being killed.

mod support;

use std::{
    fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use support::{Folder, hall_photos, map_bytes, utf8};
use volery_api::{CreateJob, Job, JobState, LocalizeStatus};
use volery_client::{Client, LocalizeQuery, UploadFile};
use volery_pipeline::CameraSpec;
use volery_synthetic::DemoHall;

/// `volery serve` in a child process that dies with this handle.
struct Server {
    child: Child,
    url: String,
    token: Option<String>,
}

impl Server {
    fn start(data: &Path) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_volery"))
            .args(["serve", "--data", utf8(data), "--listen", "127.0.0.1:0"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        let first = lines.next().expect("the server says where it listens");
        let url = first.rsplit(' ').next().unwrap().to_owned();
        // The token comes at the first start over a data folder only.
        let is_new = !data.join("token").exists();
        let token = is_new.then(|| {
            let line = lines.next().expect("the first start prints a token");
            line.rsplit(' ').next().unwrap().to_owned()
        });
        if let Some(token) = &token {
            fs::write(data.join("token"), token).unwrap();
        }
        let token = token.or_else(|| fs::read_to_string(data.join("token")).ok());
        Self { child, url, token }
    }

    fn client(&self) -> Client {
        Client::new(&self.url, self.token.as_deref()).unwrap()
    }

    fn kill(&mut self) {
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

async fn submit(client: &Client, hall: &DemoHall, folder: &Path) -> Job {
    let spec = CameraSpec::from(hall.camera());
    let camera = volery_api::Camera {
        model: spec.model.name().to_owned(),
        width: spec.width,
        height: spec.height,
        params: spec.params,
    };
    let camera = client.create_camera("test", camera).await.unwrap();
    let set = client.create_imageset("hall", Some(camera.id)).await.unwrap();
    let files: Vec<UploadFile> =
        hall.scan.iter().map(|s| folder.join("scan").join(&s.name).as_path().into()).collect();
    let results = client.upload_files(set.id, &files, |_, _| {}).await.unwrap();
    assert!(results.iter().all(|r| r.image_id.is_some()), "{results:?}");
    let request = CreateJob { imageset_ids: vec![set.id], seed: 9, ..CreateJob::default() };
    client.create_job(&request).await.unwrap()
}

async fn export_all(client: &Client, job: &Job, to: &Path) {
    let outputs = job.outputs.clone().unwrap();
    fs::create_dir_all(to).unwrap();
    for name in ["poses.csv", "sparse.ply", "map.glb", "transforms.json", "localization.bin"] {
        let bytes = client.export(outputs.map_id, name, Some(outputs.version)).await.unwrap();
        fs::write(to.join(name), bytes).unwrap();
    }
}

/// Upload, job, events, export, localization; then the same job in a server that is killed again
/// and again: it goes on after every start and ends with the same bytes.
#[test]
fn a_job_survives_kills_and_ends_with_the_same_map() {
    let folder = Folder::new("service");
    let hall = hall_photos(&folder.0);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let (calm, rough) = (folder.join("calm"), folder.join("rough"));

    let data = folder.join("calm-data");
    let server = Server::start(&data);
    let client = server.client();
    let undisturbed = runtime.block_on(async {
        let start = Instant::now();
        let job = submit(&client, &hall, &folder.0).await;
        let mut last = 0;
        let job = client
            .watch_job(job.id, |event| {
                assert_eq!(event.seq, last + 1, "events come in order, each once");
                last = event.seq;
            })
            .await
            .unwrap();
        assert!(matches!(job.state, JobState::Succeeded | JobState::Partial), "{job:?}");
        let elapsed = start.elapsed();
        export_all(&client, &job, &calm).await;

        let map = job.outputs.unwrap().map_id;
        let shot = &hall.queries[0];
        let image = fs::read(folder.join("query").join(&shot.name)).unwrap();
        let query = LocalizeQuery { image, ..LocalizeQuery::default() };
        let answer = client.localize(map, &query).await.unwrap();
        assert_ne!(answer.localization.status, LocalizeStatus::Ambiguous);
        let nonsense = LocalizeQuery { image: b"no photo".to_vec(), ..LocalizeQuery::default() };
        let refused = client.localize(map, &nonsense).await.unwrap_err();
        assert_eq!(refused.code(), "not_an_image");
        elapsed
    });
    drop(server);

    let data = folder.join("rough-data");
    let mut server = Server::start(&data);
    let client = server.client();
    let job = runtime.block_on(submit(&client, &hall, &folder.0));
    // Instants spread over the job by the golden ratio.
    let mut phase: f64 = 0.3;
    for _ in 0..NUM_KILLS {
        phase = (phase + 0.618_034) % 1.0;
        std::thread::sleep(undisturbed.mul_f64(0.05 + 0.3 * phase));
        server.kill();
        server = Server::start(&data);
    }
    let client = server.client();
    runtime.block_on(async {
        let deadline = Instant::now() + MAX_WAIT;
        let job = loop {
            let job = client.job(job.id).await.unwrap();
            if job.state.is_final() {
                break job;
            }
            assert!(Instant::now() < deadline, "the job does not end: {job:?}");
            tokio::time::sleep(Duration::from_millis(200)).await;
        };
        assert!(matches!(job.state, JobState::Succeeded | JobState::Partial), "{job:?}");
        export_all(&client, &job, &rough).await;
    });
    assert!(map_bytes(&calm) == map_bytes(&rough), "the map is the same bit for bit");
}

/// Kills of one job. A crash of the service costs a job no attempt, one of its worker does.
const NUM_KILLS: usize = 5;

/// For the job to end after the last start.
const MAX_WAIT: Duration = Duration::from_secs(180);
