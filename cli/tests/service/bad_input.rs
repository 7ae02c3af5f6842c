//! Every kind of bad input: one table, each row with its stable code, and after each row everything
//! good that came before it or beside it is still there. A job cancelled in every stage is the
//! matter of `cancel.rs`.

use std::io::{Read, Write};

use reqwest::{Method, multipart};
use serde_json::{Value, json};
use uuid::Uuid;
use volery_api::{Camera as ApiCamera, CreateJob, JobState, Preset};
use volery_client::Client;
use volery_geometry::{Camera, CameraModel, Isometry3, Point3, Vector3};
use volery_synthetic::{CenterMotion, Hall, Renderer, Sensor, yaw_scan};

use crate::{
    server::{Server, api_camera, glance_until},
    support::{Folder, noise_png, png},
};

/// What is sent.
enum Input {
    /// A file of this name among good ones, in one multipart body.
    File(&'static str, Vec<u8>),
    /// An entry of this name among good ones, in one archive.
    Entry(&'static str, Vec<u8>),
    /// Image sets, each with its camera, and a job over all of them.
    Job(Vec<(Vec<Vec<u8>>, Option<ApiCamera>)>),
    /// Method, path and JSON body of a request with this token.
    Request(Method, &'static str, Value, String),
    /// A request that announces a photo of so many bytes.
    Length(u64),
}

/// A service with a set of photos that must outlive whatever comes.
struct Service {
    server: Server,
    client: Client,
    http: reqwest::Client,
    set: Uuid,
    num_good: u32,
}

impl Service {
    async fn new(server: Server) -> Self {
        let client = server.client();
        let set = client.create_imageset("good", None).await.unwrap().id;
        Self { server, client, http: reqwest::Client::new(), set, num_good: 0 }
    }

    /// Another good photo: name and bytes.
    fn good(&mut self) -> (String, Vec<u8>) {
        self.num_good += 1;
        (format!("good {}.png", self.num_good), noise_png(1000 + self.num_good))
    }

    fn request(&self, method: Method, path: &str) -> reqwest::RequestBuilder {
        self.http
            .request(method, format!("{}{path}", self.server.url))
            .bearer_auth(&self.server.token)
    }

    /// The code of what was refused, or what became of what was not.
    async fn answer(&mut self, input: Input) -> String {
        let set = self.set;
        match input {
            Input::File(name, bytes) => {
                let mut form = multipart::Form::new();
                for (name, bytes) in [self.good(), (name.to_owned(), bytes), self.good()] {
                    form = form.part("image", multipart::Part::bytes(bytes).file_name(name));
                }
                let path = format!("/v1/imagesets/{set}/images");
                middle_of(self.request(Method::POST, &path).multipart(form)).await
            }
            Input::Entry(name, bytes) => {
                let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
                for (name, bytes) in [self.good(), (name.to_owned(), bytes), self.good()] {
                    zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
                    zip.write_all(&bytes).unwrap();
                }
                let body = zip.finish().unwrap().into_inner();
                let path = format!("/v1/imagesets/{set}/archive");
                let request = self.request(Method::POST, &path);
                middle_of(request.header("Content-Type", "application/zip").body(body)).await
            }
            Input::Job(sets) => self.job(sets).await,
            Input::Request(method, path, body, token) => {
                let url = format!("{}{path}", self.server.url);
                let request = self.http.request(method, url).bearer_auth(token).json(&body);
                let problem: Value = request.send().await.unwrap().json().await.unwrap();
                problem["code"].as_str().unwrap_or_default().to_owned()
            }
            Input::Length(length) => {
                let address = self.server.url.strip_prefix("http://").unwrap();
                let mut stream = std::net::TcpStream::connect(address).unwrap();
                let head = format!(
                    "POST /v1/imagesets/{set}/images HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\
                     Authorization: Bearer {}\r\nContent-Type: image/jpeg\r\n\
                     Content-Length: {length}\r\n\r\n",
                    self.server.token
                );
                stream.write_all(head.as_bytes()).unwrap();
                let mut answer = String::new();
                stream.read_to_string(&mut answer).unwrap();
                assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
                let (_, body) = answer.split_once("\r\n\r\n").unwrap();
                let problem: Value = serde_json::from_str(body).unwrap();
                problem["code"].as_str().unwrap().to_owned()
            }
        }
    }

    async fn job(&self, sets: Vec<(Vec<Vec<u8>>, Option<ApiCamera>)>) -> String {
        let client = &self.client;
        let mut request = CreateJob { preset: Preset::Fast, ..CreateJob::default() };
        for (photos, camera) in sets {
            let camera = match camera {
                Some(camera) => Some(client.create_camera("test", camera).await.unwrap().id),
                None => None,
            };
            let set = client.create_imageset("bad", camera).await.unwrap().id;
            for (i, photo) in photos.into_iter().enumerate() {
                let name = format!("{i:02}.png");
                let result = client.upload_bytes(set, &name, photo, None).await.unwrap();
                assert!(result.image_id.is_some(), "{result:?}");
            }
            request.imageset_ids.push(set);
        }
        let job = client.create_job(&request).await.unwrap();
        let job = glance_until(client, job.id, |_| false).await;
        match (job.state, job.error, job.outputs) {
            (JobState::Failed, Some(error), None) => {
                assert!(error.hint.is_some(), "advice is due: {error:?}");
                self.check_report(job.id, &error.code).await;
                error.code
            }
            (JobState::Succeeded | JobState::Partial, _, Some(outputs)) => {
                let map = client.map_cameras(outputs.map_id).await.unwrap();
                format!("{} images of {} cameras", map.images.len(), map.cameras.len())
            }
            other => panic!("{other:?}"),
        }
    }

    /// The report of a failed job says the same, and of each photo why it has no pose.
    async fn check_report(&self, job: Uuid, code: &str) {
        let request = self.request(Method::GET, &format!("/v1/jobs/{job}/report"));
        let report: Value = request.send().await.unwrap().json().await.unwrap();
        assert_eq!(report["error"]["code"], code, "{report:#}");
        if code != "too_few_images" {
            let mut images = report["images"].as_array().unwrap().iter();
            assert!(images.all(|image| image["reason"] == code), "{report:#}");
        }
    }

    /// The bytes of every good photo so far.
    async fn check_good(&self, after: &str) {
        let images = self.client.images(self.set).await.unwrap();
        for number in 1..=self.num_good {
            let name = format!("good {number}.png");
            let image = images.iter().find(|image| image.name == name);
            let image = image.unwrap_or_else(|| panic!("{name} is lost after {after}"));
            let bytes = self.client.image_bytes(image.id).await.unwrap();
            assert!(bytes == noise_png(1000 + number), "{name} has changed after {after}");
        }
    }
}

/// Sends three files, of which the first and the last must be taken; the fate of the second.
async fn middle_of(request: reqwest::RequestBuilder) -> String {
    let report: Value = request.send().await.unwrap().json().await.unwrap();
    let results = report["results"].as_array().unwrap_or_else(|| panic!("{report:#}"));
    assert_eq!(results.len(), 3, "{report:#}");
    assert!([0, 2].iter().all(|&i: &usize| results[i]["status"] == "stored"), "{report:#}");
    let result = &results[1];
    let warned = result["warnings"].as_array().is_some_and(|warnings| !warnings.is_empty());
    match result["status"].as_str().unwrap() {
        "rejected" => result["code"].as_str().unwrap().to_owned(),
        "stored" if warned => "stored with a warning".to_owned(),
        status => status.to_owned(),
    }
}

fn jpeg() -> Vec<u8> {
    let pixels: Vec<u8> = (0..160 * 120_u32).map(|i| (i * i / 977) as u8).collect();
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 90)
        .encode(&pixels, 160, 120, image::ExtendedColorType::L8)
        .unwrap();
    bytes
}

/// A photo whose EXIF says that its focal length is `numerator / denominator` millimeters.
fn jpeg_with_focal(numerator: u32, denominator: u32) -> Vec<u8> {
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    let mut directory = |tag: u16, kind: u16, value: u32| {
        tiff.extend([1, 0]);
        tiff.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        tiff.extend([1_u32.to_le_bytes(), value.to_le_bytes(), [0; 4]].concat());
    };
    directory(0x8769, 4, 26); // The EXIF directory follows.
    directory(0x920a, 5, 44); // FocalLength; its value follows.
    tiff.extend([numerator.to_le_bytes(), denominator.to_le_bytes()].concat());
    let plain = jpeg();
    let length = (tiff.len() as u16 + 8).to_be_bytes();
    [&plain[..2], &[0xff, 0xe1], &length, b"Exif\0\0", &tiff, &plain[2..]].concat()
}

/// Photos of a hall.
fn photos(camera: &Camera, cam_from_world: &[Isometry3<f64>]) -> Vec<Vec<u8>> {
    let hall = Hall::furnished(Vector3::new(8.0, 7.0, 3.0), 0.008, 5);
    let renderer = Renderer::new(camera);
    let photo = |(i, pose)| {
        let photo = Sensor::default().expose(&renderer.render(&hall, pose), i as u64);
        png(photo.gray().pixels(), photo.width, photo.height)
    };
    cam_from_world.iter().enumerate().map(photo).collect()
}

fn every_other(poses: &[Isometry3<f64>], first: usize) -> Vec<Isometry3<f64>> {
    poses.iter().skip(first).step_by(2).copied().collect()
}

fn camera(width: u32, height: u32, focal_px: f64) -> Camera {
    Camera::from_focal(CameraModel::Pinhole, width, height, focal_px).unwrap()
}

/// What is wrong, the input, and the code that names it or what becomes of it.
fn table(expired: String, token: &str) -> Vec<(&'static str, Input, &'static str)> {
    use Input::{Entry, File, Job, Length, Request};
    let whole = jpeg();
    let cut = whole[..whole.len() / 2].to_vec();
    let closed = [&cut[..], &[0xff, 0xd9]].concat();
    let mut huge = noise_png(1);
    huge[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let white = |seed: u8| {
        let mut pixels = vec![255; 160 * 120];
        pixels[0] = seed;
        png(&pixels, 160, 120)
    };
    let center = Point3::new(0.0, 0.0, 1.5);
    let small = camera(400, 300, 300.0);
    let spin = yaw_scan(&center, 30, 0.2, CenterMotion::Spin, 5);
    let circle = yaw_scan(&center, 12, 0.15, CenterMotion::Circle { radius: 0.9 }, 5);
    let other = camera(480, 360, 300.0);
    let mixed = vec![
        (photos(&small, &every_other(&circle, 0)), Some(api_camera(&small))),
        (photos(&other, &every_other(&circle, 1)), Some(api_camera(&other))),
    ];
    let turned = photos(&small, &spin);
    let turning = vec![(turned.clone(), Some(api_camera(&small)))];
    let job = |photos| Job(vec![(photos, None)]);
    let get = |path, token| Request(Method::GET, path, Value::Null, token);
    vec![
        ("truncated JPEG", File("cut.jpg", cut), "truncated"),
        ("truncated JPEG with an end marker", File("closed.jpg", closed), "truncated"),
        ("PNG of 60000 x 60000", File("huge.png", huge.clone()), "too_large"),
        ("PNG of 60000 x 60000, zipped", Entry("huge.png", huge), "too_large"),
        ("zip bomb", Entry("zeros.jpg", vec![0; 16 << 20]), "archive_ratio"),
        ("zip entry outside", Entry("../../up.jpg", whole.clone()), "unsafe_name"),
        ("zip entry at the root", Entry("/up.jpg", whole.clone()), "unsafe_name"),
        ("text named .jpg", File("text.jpg", b"this is no photo".to_vec()), "not_an_image"),
        ("zero-byte file", File("zero.jpg", Vec::new()), "empty_file"),
        ("zero-byte file, zipped", Entry("zero.jpg", Vec::new()), "empty_file"),
        ("EXIF focal length 0", File("zero f.jpg", jpeg_with_focal(0, 1)), "stored with a warning"),
        ("EXIF focal length x/0", File("f.jpg", jpeg_with_focal(50, 0)), "stored with a warning"),
        ("duplicate photo", File("copy.png", noise_png(1001)), "duplicate"),
        ("two photos without overlap", job(photos(&small, &[spin[0], spin[15]])), "no_overlap"),
        ("30 photos of pure rotation", Job(turning), "no_parallax"),
        ("30 photos of pure rotation through an unknown lens", job(turned), "no_parallax"),
        ("all-white photos", job((0..3).map(white).collect()), "too_few_features"),
        ("one photo, many times", job(vec![noise_png(1); 3]), "too_few_images"),
        ("mixed cameras", Job(mixed), "12 images of 2 cameras"),
        ("body over the limit", Length((32 << 20) + 1), "too_large"),
        ("expired token", get("/v1/info", expired), "token_expired"),
        ("no token of ours", get("/v1/info", "vly_guess".to_owned()), "unauthorized"),
        (
            "unknown field",
            Request(
                Method::POST,
                "/v1/imagesets",
                json!({"name": "hall", "camera": "x"}),
                token.to_owned(),
            ),
            "unknown_field",
        ),
        ("unknown query field", get("/v1/jobs?limits=5", token.to_owned()), "unknown_field"),
    ]
}

#[test]
fn every_bad_input_has_its_code_and_harms_nothing() {
    let folder = Folder::new("bad-input");
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let mut service = Service::new(Server::start(&folder.join("data"))).await;
        let body = json!({"name": "short", "role": "admin", "expires_in_s": 0});
        let made = service.request(Method::POST, "/v1/tokens").json(&body).send().await.unwrap();
        let made: Value = made.json().await.unwrap();
        let expired = made["secret"].as_str().unwrap().to_owned();
        let token = service.server.token.clone();
        for (what, input, expected) in table(expired, &token) {
            assert_eq!(service.answer(input).await, expected, "{what}");
            service.check_good(what).await;
        }
    });
}
