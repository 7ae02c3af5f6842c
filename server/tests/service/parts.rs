//! Archives that come in parts.

use std::io::Write;

use crate::support::{Answer, Client, Server, photo};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

const BYTES: (&str, &str) = ("Content-Type", "application/octet-stream");

/// A zip archive with two photos.
fn archive() -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for name in ["a.jpg", "b.jpg"] {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&photo(name)).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn hash(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

async fn begin(client: &Client, size: usize, sha256: &str) -> (String, String) {
    let set = client.post("/v1/imagesets", json!({"name": "hall"})).await.expect(201).json();
    let set = set["id"].as_str().unwrap().to_owned();
    let request = json!({"imageset_id": set, "size": size, "sha256": sha256});
    let made = client.post("/v1/uploads", request).await.expect(201);
    (made.header("location").unwrap().to_owned(), set)
}

async fn append(client: &Client, upload: &str, offset: usize, part: &[u8]) -> Answer {
    let offset = offset.to_string();
    client.send("PATCH", upload, &[BYTES, ("Upload-Offset", &offset)], part).await
}

#[tokio::test]
async fn parts_become_an_archive_and_its_photos_come_once() {
    let server = Server::start().await;
    let client = &server.client;
    let bytes = archive();
    let (upload, set) = begin(client, bytes.len(), &hash(&bytes)).await;
    let (first, rest) = bytes.split_at(100);
    let told = append(client, &upload, 0, first).await.expect(200);
    assert_eq!((told.header("upload-offset"), &told.json()["offset"]), (Some("100"), &json!(100)));
    for wrong in [0, 99, 101] {
        let refused = append(client, &upload, wrong, rest).await.expect(409);
        assert_eq!(refused.code(), "wrong_offset");
    }
    let early = client.post(&format!("{upload}/complete"), json!({})).await.expect(409);
    assert_eq!(early.code(), "upload_incomplete");
    let beyond = [rest, b"more"].concat();
    assert_eq!(append(client, &upload, 100, &beyond).await.expect(413).code(), "too_large");
    let state = client.send("HEAD", &upload, &[], b"").await.expect(200);
    assert_eq!(state.header("upload-offset"), Some("100"), "what does not fit changes nothing");
    append(client, &upload, 100, rest).await.expect(200);
    let path = format!("{upload}/complete");
    let complete = || client.post(&path, json!({}));
    let report = complete().await.expect(200).json();
    assert_eq!(report["stored"], 2, "{report:#}");
    assert_eq!(complete().await.expect(200).json(), report, "asked again, it says the same");
    let images = client.get(&format!("/v1/imagesets/{set}/images")).await.expect(200).json();
    assert_eq!(images["items"].as_array().unwrap().len(), 2);
    assert_eq!(append(client, &upload, 0, b"x").await.expect(409).code(), "upload_finished");
    client.delete(&upload).await.expect(204);
    client.get(&upload).await.expect(404);
    client.delete(&upload).await.expect(404);
}

/// What came of a part whose connection broke is kept.
#[tokio::test]
async fn a_part_that_breaks_off_is_kept_as_far_as_it_came() {
    let server = Server::start().await;
    let client = &server.client;
    let bytes = archive();
    let (upload, _) = begin(client, bytes.len(), &hash(&bytes)).await;
    let (addr, token) = (client.addr, client.token.clone().unwrap());
    let head = format!(
        "PATCH {upload} HTTP/1.1\r\nHost: test\r\nAuthorization: Bearer {token}\r\n\
         Content-Type: application/octet-stream\r\nUpload-Offset: 0\r\nContent-Length: {}\r\n\r\n",
        bytes.len()
    );
    let sent = [head.as_bytes(), &bytes[..50]].concat();
    tokio::task::spawn_blocking(move || {
        let mut stream = std::net::TcpStream::connect(addr).unwrap();
        stream.write_all(&sent).unwrap();
    })
    .await
    .unwrap();
    let start = std::time::Instant::now();
    let offset = loop {
        let state = client.get(&upload).await.expect(200).json();
        let offset = state["offset"].as_u64().unwrap() as usize;
        if offset > 0 {
            break offset;
        }
        assert!(start.elapsed().as_secs() < 30, "nothing came");
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    };
    assert_eq!(offset, 50);
    while append(client, &upload, 50, &bytes[50..]).await.status == 409 {
        // The service has not noticed yet that the first one is gone.
        assert!(start.elapsed().as_secs() < 30, "still busy");
    }
    client.post(&format!("{upload}/complete"), json!({})).await.expect(200);
}

#[tokio::test]
async fn what_makes_no_sense_is_refused() {
    let server = Server::start().await;
    let client = &server.client;
    let bytes = archive();
    let (upload, set) = begin(client, bytes.len(), &hash(b"others")).await;
    append(client, &upload, 0, &bytes).await.expect(200);
    let wrong = client.post(&format!("{upload}/complete"), json!({})).await.expect(422);
    assert_eq!(wrong.code(), "wrong_hash");
    client.send("PATCH", &upload, &[BYTES], b"x").await.expect(400);
    let none = "00000000-0000-7000-8000-000000000000";
    let request = |set: &str, size: Value, sha256: &str| {
        client.post("/v1/uploads", json!({"imageset_id": set, "size": size, "sha256": sha256}))
    };
    let good = hash(&bytes);
    request(none, json!(10), &good).await.expect(404);
    request(&set, json!(0), &good).await.expect(413);
    request(&set, json!(1_u64 << 50), &good).await.expect(413);
    assert_eq!(request(&set, json!(10), "0f").await.expect(422).code(), "bad_hash");
}
