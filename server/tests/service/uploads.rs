//! Photos in: each answers for itself, and what is answered is kept.

use std::io::Write;

use crate::support::{Answer, Client, Server, multipart, photo};
use serde_json::{Value, json};
use zip::write::SimpleFileOptions;

async fn empty_set(client: &Client) -> String {
    let set = client.post("/v1/imagesets", json!({"name": "hall"})).await.expect(201);
    set.json()["id"].as_str().unwrap().to_owned()
}

fn statuses(report: &Value) -> Vec<(String, String)> {
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let results = report["results"].as_array().unwrap().iter();
    results
        .map(|result| match text(&result["status"]).as_str() {
            "rejected" => (text(&result["name"]), text(&result["code"])),
            status => (text(&result["name"]), status.to_owned()),
        })
        .collect()
}

#[track_caller]
fn assert_statuses(answer: &Answer, expected: &[(&str, &str)]) {
    let expected: Vec<_> =
        expected.iter().map(|(name, status)| ((*name).to_owned(), (*status).to_owned())).collect();
    assert_eq!(statuses(&answer.json()), expected);
}

#[tokio::test]
async fn each_file_of_an_upload_answers_for_itself() {
    let server = Server::start_with(|config| config.limits.image_bytes = 100).await;
    let client = &server.client;
    let set = empty_set(client).await;
    let mut huge_png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    huge_png.extend([60_000_u32.to_be_bytes(), 60_000_u32.to_be_bytes()].concat());
    let (a, long) = (photo("a"), photo(&"x".repeat(200)));
    let answer = client
        .upload(
            &set,
            &[
                ("a.jpg", &a),
                ("copy.jpg", &a),
                ("a.jpg", &photo("other bytes")),
                ("zero.jpg", b""),
                ("text.jpg", b"hello"),
                ("cut.jpg", &photo("truncated")),
                ("huge.png", &huge_png),
                ("long.jpg", &long),
                ("bomb.jpg", &photo("die")),
                ("slow.jpg", &photo("hang")),
                ("../up.jpg", &photo("up")),
                ("b.jpg", &photo("b")),
            ],
        )
        .await
        .expect(207);
    assert_statuses(
        &answer,
        &[
            ("a.jpg", "stored"),
            ("copy.jpg", "duplicate"),
            ("a.jpg", "name_taken"),
            ("zero.jpg", "empty_file"),
            ("text.jpg", "not_an_image"),
            ("cut.jpg", "truncated"),
            ("huge.png", "too_large"),
            ("long.jpg", "too_large"),
            ("bomb.jpg", "undecodable"),
            ("slow.jpg", "undecodable"),
            ("../up.jpg", "unsafe_name"),
            ("b.jpg", "stored"),
        ],
    );
    let report = answer.json();
    assert_eq!((&report["stored"], &report["duplicates"]), (&json!(2), &json!(1)));
    assert_eq!(report["rejected"], 9);
    let set = client.get(&format!("/v1/imagesets/{set}")).await.json();
    assert_eq!(set["num_images"], 2);
    let left = std::fs::read_dir(server.folder.0.join("data/tmp")).unwrap().count();
    assert_eq!(left, 0, "no temporary files stay");
}

#[tokio::test]
async fn one_photo_may_come_as_it_is() {
    let server = Server::start().await;
    let client = &server.client;
    let set = empty_set(client).await;
    let path = format!("/v1/imagesets/{set}/images");
    let headers = [
        ("Content-Type", "image/jpeg"),
        ("X-Image-Name", "a.jpg"),
        ("X-Pose-Prior", r#"{"attitude":{"yaw":1.5}}"#),
        ("X-Capture-Time-Ns", "123"),
    ];
    let report = client.send("POST", &path, &headers, &photo("a")).await.expect(200).json();
    let id = report["results"][0]["image_id"].as_str().unwrap().to_owned();
    let image = client.get(&format!("/v1/images/{id}")).await.expect(200).json();
    assert_eq!(image["name"], "a.jpg");
    assert_eq!(image["capture_time_ns"], 123);
    assert_eq!(image["prior"]["attitude"]["yaw"], 1.5);
    let bytes = client.get(&format!("/v1/images/{id}/bytes")).await.expect(200);
    assert_eq!(bytes.body, photo("a"));

    let jpeg = [("Content-Type", "image/jpeg")];
    let rejected = client.send("POST", &path, &jpeg, b"text").await.expect(422);
    assert_eq!(rejected.code(), "not_an_image");
    let odd = [("Content-Type", "image/jpeg"), ("X-Pose-Prior", r#"{"yaw":1}"#)];
    let odd = client.send("POST", &path, &odd, &photo("b")).await.expect(422);
    assert_eq!(odd.code(), "unknown_field");
    client.delete(&format!("/v1/images/{id}")).await.expect(204);
    client.get(&format!("/v1/images/{id}")).await.expect(404);
}

#[tokio::test]
async fn bodies_over_the_limit_and_broken_bodies_are_named() {
    let server = Server::start_with(|config| {
        config.limits.upload_bytes = 2000;
        config.limits.image_bytes = 1000;
    })
    .await;
    let client = &server.client;
    let set = empty_set(client).await;
    let path = format!("/v1/imagesets/{set}/images");
    let long = vec![0; 3000];
    client.upload(&set, &[("a.jpg", &long)]).await.expect(413);
    let jpeg = [("Content-Type", "image/jpeg")];
    assert_eq!(client.send("POST", &path, &jpeg, &long).await.expect(413).code(), "too_large");
    // Without a length, the limit is met on the way.
    let token = client.token.clone().unwrap();
    let mut chunked = format!(
        "POST {path} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\nConnection: close\r\n\
         Content-Type: image/jpeg\r\nTransfer-Encoding: chunked\r\n\r\nbb8\r\n"
    )
    .into_bytes();
    chunked.extend([&long[..], b"\r\n0\r\n\r\n"].concat());
    assert_eq!(client.raw(chunked).await.expect(413).code(), "too_large");

    let form = [("Content-Type", "multipart/form-data; boundary=cut")];
    let mut cut = multipart(&[("a.jpg", &photo("a"))]);
    cut.truncate(cut.len() - 6);
    assert_eq!(client.send("POST", &path, &form, &cut).await.expect(400).code(), "bad_request");
    let none = client.send("POST", &path, &form, b"--cut--\r\n").await.expect(422);
    assert_eq!(none.code(), "no_files");
    let text = [("Content-Type", "text/plain")];
    client.send("POST", &path, &text, b"x").await.expect(415);
    client.upload("01900000-0000-7000-8000-000000000000", &[]).await.expect(404);
}

fn archive(entries: impl FnOnce(&mut zip::ZipWriter<std::io::Cursor<Vec<u8>>>)) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    entries(&mut zip);
    zip.finish().unwrap().into_inner()
}

#[tokio::test]
async fn archives_are_unpacked_with_suspicion() {
    let server = Server::start_with(|config| config.limits.archive_entries = 10).await;
    let client = &server.client;
    let set = empty_set(client).await;
    let path = format!("/v1/imagesets/{set}/archive");
    let zip = [("Content-Type", "application/zip")];
    let options = SimpleFileOptions::default();
    let body = archive(|zip| {
        zip.add_directory("flight", options).unwrap();
        for (name, bytes) in [
            ("flight/a.jpg", photo("a")),
            ("flight/notes.txt", b"hello".to_vec()),
            ("../../etc/b.jpg", photo("b")),
            ("zeros.jpg", [photo("z"), vec![0; 8 << 20]].concat()),
        ] {
            zip.start_file(name, options).unwrap();
            zip.write_all(&bytes).unwrap();
        }
        zip.add_symlink("link.jpg", "/etc/passwd", options).unwrap();
    });
    let answer = client.send("POST", &path, &zip, &body).await.expect(207);
    assert_statuses(
        &answer,
        &[
            ("flight/a.jpg", "stored"),
            ("flight/notes.txt", "not_an_image"),
            ("../../etc/b.jpg", "unsafe_name"),
            ("zeros.jpg", "archive_ratio"),
            ("link.jpg", "archive_link"),
        ],
    );
    let many = archive(|zip| {
        for number in 0..11 {
            zip.start_file(format!("{number}.jpg"), options).unwrap();
        }
    });
    let many = client.send("POST", &path, &zip, &many).await.expect(422);
    assert_eq!(many.code(), "too_many_entries");
    let none = client.send("POST", &path, &zip, b"PK no").await.expect(422);
    assert_eq!(none.code(), "not_an_archive");
    let cut = client.send("POST", &path, &zip, &body[..body.len() / 2]).await.expect(422);
    assert_eq!(cut.code(), "not_an_archive");
}

#[tokio::test]
async fn priors_come_as_json_and_as_telemetry() {
    let server = Server::start().await;
    let client = &server.client;
    let set = client.imageset(&["a.jpg", "b.jpg"]).await;
    let path = format!("/v1/imagesets/{set}/priors");
    let priors = json!({"priors": {"a.jpg": {"position": {"position": [1, 2, 3], "sigma": 0.05}},
        "z.jpg": {}}});
    let report = client.json("PUT", &path, &[], priors).await.expect(200).json();
    assert_eq!(report, json!({"updated": 1, "unknown": ["z.jpg"]}));
    let csv = [("Content-Type", "text/csv")];
    let telemetry = b"image,time_s,yaw_deg,pitch_deg,roll_deg,height_m\nb.jpg,0.5,90,1,2,1.5\n";
    let report = client.send("PUT", &path, &csv, telemetry).await.expect(200).json();
    assert_eq!(report["updated"], 1);
    let images = client.get(&format!("/v1/imagesets/{set}/images")).await.json();
    assert_eq!(images["items"][0]["prior"]["position"]["sigma"], 0.05);
    assert_eq!(images["items"][1]["prior"]["height"]["height"], 1.5);
    // As everywhere: half an attitude is none, other columns are nobody's business.
    let telemetry = b"image,yaw_deg,x_m,y_m,z_m,battery\nb.jpg,90,1,2,3,0.9\n";
    client.send("PUT", &path, &csv, telemetry).await.expect(200);
    let images = client.get(&format!("/v1/imagesets/{set}/images")).await.json();
    assert_eq!(images["items"][1]["prior"]["attitude"], json!(null));
    assert_eq!(images["items"][1]["prior"]["position"]["position"], json!([1.0, 2.0, 3.0]));
    for odd in ["", "time_s\n1\n", "image,time_s\na\n", "image,time_s\na,x\n"] {
        let answer = client.send("PUT", &path, &csv, odd.as_bytes()).await.expect(422);
        assert_eq!(answer.code(), "bad_telemetry", "{odd:?}");
    }

    for (body, code) in [
        (json!({"priors": {"a.jpg": {"yaw": 1}}}), "unknown_field"),
        (json!({"priors": {"a.jpg": {"height": {"height": 1, "sigma": 0}}}}), "bad_prior"),
    ] {
        assert_eq!(client.json("PUT", &path, &[], body).await.expect(422).code(), code);
    }
}

/// Poses and cameras of a model join what is known of the photos, and reach the job.
#[tokio::test]
async fn a_model_of_another_program_gives_photos_their_poses() {
    // A model is an upload, not a document.
    let server = Server::start_with(|config| config.limits.json_bytes = 1000).await;
    let client = &server.client;
    let set = client.imageset(&["a.jpg", "b.jpg"]).await;
    let priors = json!({"priors": {"a.jpg": {"height": {"height": 1.5, "sigma": 0.1}}}});
    client.json("PUT", &format!("/v1/imagesets/{set}/priors"), &[], priors).await.expect(200);

    let path = format!("/v1/imagesets/{set}/model");
    let zip = [("Content-Type", "application/zip")];
    let notes = "b.jpg ".repeat(1000);
    let body = archive(|zip| {
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored);
        for (name, text) in
            [("sparse/0/cameras.txt", "1"), ("sparse/0/images.txt", "a.jpg"), ("notes.txt", &notes)]
        {
            zip.start_file(name, options).unwrap();
            zip.write_all(text.as_bytes()).unwrap();
        }
    });
    let report = client.send("PUT", &path, &zip, &body).await.expect(200).json();
    assert_eq!(report, json!({"updated": 1, "unknown": ["z.jpg"], "missing": ["b.jpg"]}));
    let images = client.get(&format!("/v1/imagesets/{set}/images")).await.json();
    let prior = &images["items"][0]["prior"];
    assert_eq!(prior["height"]["height"], 1.5, "what was known stays");
    assert_eq!(prior["pose"]["position"], json!([1.0, 2.0, 3.0]));
    assert_eq!(prior["camera"]["model"], "PINHOLE");
    assert!(images["items"][1]["prior"].is_null());

    let json_type = [("Content-Type", "application/json")];
    let report = client.send("PUT", &path, &json_type, b"b.jpg").await.expect(200).json();
    assert_eq!(report["missing"], json!(["a.jpg"]));
    for (kind, body, code) in
        [(&zip, &b"PK no"[..], "not_an_archive"), (&json_type, b"senseless", "bad_model")]
    {
        assert_eq!(client.send("PUT", &path, kind, body).await.expect(422).code(), code);
    }
    let text = [("Content-Type", "text/plain")];
    client.send("PUT", &path, &text, b"").await.expect(415);
}

#[tokio::test]
async fn lists_come_in_pages_without_gaps_or_repeats() {
    let server = Server::start().await;
    let client = &server.client;
    let names: Vec<_> = (0..7).map(|number| format!("{number}.jpg")).collect();
    let set = client.imageset(&names.iter().map(String::as_str).collect::<Vec<_>>()).await;
    let mut seen = Vec::new();
    let mut cursor = String::new();
    loop {
        let path = format!("/v1/imagesets/{set}/images?limit=3{cursor}");
        let page = client.get(&path).await.expect(200).json();
        let items = page["items"].as_array().unwrap();
        assert!(items.len() <= 3);
        seen.extend(items.iter().map(|image| image["name"].as_str().unwrap().to_owned()));
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(seen, names);
}

#[tokio::test]
async fn the_same_key_makes_the_same_thing() {
    let server = Server::start().await;
    let client = &server.client;
    let key = [("Idempotency-Key", "once")];
    let hall = json!({"name": "hall"});
    let make = |body: serde_json::Value| client.json("POST", "/v1/imagesets", &key, body);
    let first = make(hall.clone()).await.expect(201).json();
    let second = make(hall).await.expect(201).json();
    assert_eq!(first["id"], second["id"]);
    let other = make(json!({"name": "other"})).await.expect(409);
    assert_eq!(other.code(), "idempotency_key_reused");
    assert_eq!(client.get("/v1/imagesets").await.json()["items"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn a_thumbnail_is_made_once_per_size() {
    let server = Server::start_with(|config| config.workers.decoders = 1).await;
    let client = &server.client;
    let set = client.imageset(&["a.jpg"]).await;
    let images = client.get(&format!("/v1/imagesets/{set}/images")).await.json();
    let path = format!("/v1/images/{}/thumbnail", images["items"][0]["id"].as_str().unwrap());
    let first = client.get(&path).await.expect(200);
    assert_eq!(first.body, b"256 pixels, answer 2", "the first answer was the check");
    assert_eq!(first.header("content-type"), Some("image/png"));
    assert_eq!(client.get(&path).await.expect(200).body, first.body);
    let small = client.get(&format!("{path}?size=64")).await.expect(200);
    assert_eq!(small.body, b"64 pixels, answer 3");
    let etag = first.header("etag").unwrap();
    assert_ne!(small.header("etag"), Some(etag));
    client.send("GET", &path, &[("If-None-Match", etag)], b"").await.expect(304);
    for (query, code) in
        [("size=0", "bad_size"), ("size=4096", "bad_size"), ("site=64", "unknown_field")]
    {
        assert_eq!(client.get(&format!("{path}?{query}")).await.expect(422).code(), code);
    }
    let nowhere = "/v1/images/01900000-0000-7000-8000-000000000000/thumbnail";
    assert_eq!(client.get(nowhere).await.expect(404).code(), "not_found");
    client.with_token(None).get(&path).await.expect(401);
    client.delete(path.strip_suffix("/thumbnail").unwrap()).await.expect(204);
    client.get(&path).await.expect(404);
}

/// A photo that kills the decoder is an answer; the next photo has its thumbnail.
#[tokio::test]
async fn a_decoder_that_dies_of_a_thumbnail_is_replaced() {
    let server = Server::start().await;
    let client = &server.client;
    let set = client.imageset(&["fatal when small.jpg", "b.jpg"]).await;
    let images = client.get(&format!("/v1/imagesets/{set}/images")).await.json();
    let path = |i: usize| {
        let id = images["items"][i]["id"].as_str().unwrap();
        format!("/v1/images/{id}/thumbnail")
    };
    assert_eq!(client.get(&path(0)).await.expect(503).code(), "worker_died");
    client.get(&path(1)).await.expect(200);
}
