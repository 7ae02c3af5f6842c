//! Maps: versions, exports, alignment, localization.

use crate::support::{Server, photo};
use serde_json::{Value, json};

#[tokio::test]
async fn exports_have_tags_and_ranges() {
    let server = Server::start().await;
    let client = &server.client;
    let map = client.map().await;
    let path = format!("/v1/maps/{map}/export/sparse.ply");
    let whole = client.get(&path).await.expect(200);
    assert_eq!(whole.body, b"0123456789");
    let etag = whole.header("etag").unwrap().to_owned();
    let known = client.send("GET", &path, &[("If-None-Match", &etag)], b"").await.expect(304);
    assert!(known.body.is_empty());
    client.send("GET", &path, &[("If-None-Match", "\"other\"")], b"").await.expect(200);

    let part = client.send("GET", &path, &[("Range", "bytes=2-4")], b"").await.expect(206);
    assert_eq!(part.body, b"234");
    assert_eq!(part.header("content-range"), Some("bytes 2-4/10"));
    let outside = client.send("GET", &path, &[("Range", "bytes=10-")], b"").await.expect(416);
    assert_eq!(outside.code(), "range_not_satisfiable");
    let changed = [("Range", "bytes=2-4"), ("If-Range", "\"other\"")];
    client.send("GET", &path, &changed, b"").await.expect(200);
    let same = [("Range", "bytes=2-4"), ("If-Range", &etag[..])];
    client.send("GET", &path, &same, b"").await.expect(206);

    for (name, start) in [
        ("poses.csv", &b"image,"[..]),
        ("dense.ply", b"many points"),
        ("freespace.bin", b"VOLOCC01"),
        ("mesh.ply", b"a surface"),
        ("colmap.zip", b"PK"),
        ("colmap_bin.zip", b"PK"),
        ("map.glb", b"exported"),
        ("transforms.json", b"exported"),
        ("report.html", b"<p>"),
    ] {
        let path = format!("/v1/maps/{map}/export/{name}");
        let first = client.get(&path).await.expect(200);
        assert!(first.body.starts_with(start), "{name}");
        let again = client.get(&path).await.expect(200);
        assert_eq!(first.header("etag"), again.header("etag"), "{name}: equal maps, equal bytes");
    }
    let zones = client.get(&format!("/v1/maps/{map}/export/zones.zip")).await.expect(200);
    let zones = zip::ZipArchive::new(std::io::Cursor::new(zones.body)).unwrap();
    assert_eq!(zones.file_names().collect::<Vec<_>>(), ["zones/1/poses.csv"]);
    let grid = client.get(&format!("/v1/maps/{map}/freespace")).await.expect(200);
    assert!(grid.body.starts_with(b"VOLOCC01"));
    let none = client.get(&format!("/v1/maps/{map}/export/secret.txt")).await.expect(404);
    assert_eq!(none.code(), "not_found");
    for path in ["..%2f..%2fvolery.db", "%2e%2e/%2e%2e/volery.db"] {
        client.get(&format!("/v1/maps/{map}/export/{path}")).await.expect(404);
    }
    let html = client.get(&format!("/v1/maps/{map}/export/report.html")).await;
    assert!(html.header("content-security-policy").unwrap().starts_with("sandbox"));
}

#[tokio::test]
async fn an_alignment_is_a_new_version_and_the_old_one_stays() {
    let server = Server::start().await;
    let client = &server.client;
    let map = client.map().await;
    let path = format!("/v1/maps/{map}/align");
    let align = json!({"known_distance": {"image_a": "a.jpg", "image_b": "b.jpg", "meters": 3.0}});
    let key = [("Idempotency-Key", "scale")];
    let made = client.json("POST", &path, &key, align.clone()).await.expect(201).json();
    assert_eq!(made["version"]["version"], 2);
    assert_eq!(made["version"]["parent_version"], 1);
    assert_eq!(made["version"]["info"]["scale"]["metric"], true);
    assert_eq!(made["residuals"]["rms_m"], 0.01);
    let again = client.json("POST", &path, &key, align).await.expect(201).json();
    assert_eq!(again, made, "the same key makes no third version");

    let old = client.get(&format!("/v1/maps/{map}/export/map.json?version=1")).await.expect(200);
    assert_eq!(old.json()["scale"]["metric"], false);
    let versions = client.get(&format!("/v1/maps/{map}/versions")).await.json();
    assert_eq!(versions["items"].as_array().unwrap().len(), 2);
    let back = client.post(&format!("/v1/maps/{map}/activate"), json!({"version": 1})).await;
    assert_eq!(back.expect(200).json()["active_version"], 1);
    client.post(&format!("/v1/maps/{map}/activate"), json!({"version": 9})).await.expect(404);

    for (align, code) in [
        (
            json!({"sim3": {"rotation": [2, 0, 0, 0], "translation": [0, 0, 0], "scale": 1}}),
            "bad_alignment",
        ),
        (
            json!({"known_distance": {"image_a": "a", "image_b": "b", "meters": -1}}),
            "bad_alignment",
        ),
        (json!({"control_points": []}), "bad_alignment"),
        (json!({"magic": {}}), "invalid_body"),
        (
            json!({"sim3": {"rotation": [1, 0, 0, 0], "translation": [0, 0, 0], "scale": 1,
            "scael": 2}}),
            "unknown_field",
        ),
    ] {
        assert_eq!(client.post(&path, align).await.expect(422).code(), code);
    }
}

#[tokio::test]
async fn views_are_drawn_and_bad_cameras_refused() {
    let server = Server::start().await;
    let client = &server.client;
    let map = client.map().await;
    let path = format!("/v1/maps/{map}/render");
    let pose = json!({"position": [1, 2, 3], "orientation": [1, 0, 0, 0]});
    for (what, media_type) in
        [("color", "image/png"), ("depth", "image/png"), ("depth_f32", "application/octet-stream")]
    {
        let answer = client.post(&path, json!({"pose": pose, "what": what})).await.expect(200);
        assert_eq!(answer.header("content-type"), Some(media_type));
        assert_eq!(answer.header("x-surface"), Some("mesh"));
        assert_eq!(answer.body, format!("a \"{what}\" picture").into_bytes());
    }
    let camera = |width: u32, focal: f64| {
        json!({"model": "SIMPLE_PINHOLE", "width": width, "height": 48,
            "params": [focal, width / 2, 24]})
    };
    let with = |camera: Value| json!({"pose": pose, "camera": camera});
    client.post(&path, with(camera(64, 50.0))).await.expect(200);
    let refused = client.post(&path, with(camera(64, -1.0))).await.expect(422);
    assert_eq!(refused.code(), "bad_camera");
    let refused = client.post(&path, with(camera(9999, 50.0))).await;
    assert!(refused.status >= 400 && refused.status < 500 && refused.code() == "too_large");
    client.post(&path, json!({"pose": pose, "zoom": 2})).await.expect(422);
    client.post(&path, json!({})).await.expect(422);
    let nowhere = format!("/v1/maps/{}/render", uuid::Uuid::nil());
    client.post(&nowhere, json!({"pose": pose})).await.expect(404);
}

#[tokio::test]
async fn a_photo_is_answered_with_a_pose_or_a_reason() {
    let server = Server::start().await;
    let client = &server.client;
    let map = client.map().await;
    let path = format!("/v1/maps/{map}/localize");
    let jpeg = [("Content-Type", "image/jpeg")];
    let answer = client.send("POST", &path, &jpeg, &photo("here")).await.expect(200).json();
    assert_eq!(answer["status"], "ok");
    assert_eq!(answer["frame"], "map");
    assert_eq!((&answer["map_id"], &answer["map_version"]), (&json!(map), &json!(1)));
    assert_eq!(answer["pose"]["position"], json!([1.0, 2.0, 3.0]));
    assert!(answer["timings"]["total_ms"].as_f64().unwrap() > 0.0);

    let template = format!("{path}?method=template");
    client.send("POST", &template, &jpeg, &photo("here")).await.expect(200);
    let unknown = format!("{path}?method=guess");
    client.send("POST", &unknown, &jpeg, &photo("here")).await.expect(422);

    let answer = client.send("POST", &path, &jpeg, &photo("nowhere")).await.expect(200).json();
    assert_eq!(answer["status"], "not_found");
    assert_eq!(answer["reason"], "too_few_matches");
    assert_eq!(answer["pose"], Value::Null);

    let camera = json!({"model": "PINHOLE", "width": 640, "height": 480,
        "params": [500, 500, 320, 240]})
    .to_string();
    let with_camera = [("Content-Type", "image/jpeg"), ("X-Camera", &camera[..])];
    client.send("POST", &path, &with_camera, &photo("here")).await.expect(200);
    let form = [("Content-Type", "multipart/form-data; boundary=cut")];
    let part = |name: &str, text: &str| {
        format!("--cut\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\n{text}\r\n")
    };
    let mut body = part("camera", &camera).into_bytes();
    body.extend(part("prior", r#"{"yaw":{"yaw":0.5,"sigma":0.1}}"#).into_bytes());
    body.extend(b"--cut\r\nContent-Disposition: form-data; name=\"image\"\r\n\r\n");
    body.extend([photo("here"), b"\r\n--cut--\r\n".to_vec()].concat());
    client.send("POST", &path, &form, &body).await.expect(200);

    let cut = client.send("POST", &path, &jpeg, &photo("truncated")).await.expect(422);
    assert_eq!(cut.code(), "truncated");
    let died = client.send("POST", &path, &jpeg, &photo("die")).await.expect(503);
    assert_eq!(died.code(), "worker_died");
    client.send("POST", &path, &jpeg, &photo("here")).await.expect(200);
    assert_eq!(client.send("POST", &path, &jpeg, b"").await.expect(422).code(), "empty_file");
}

/// Without a length the limit must hold while the body comes: it is kept in memory.
#[tokio::test]
async fn a_photo_without_a_length_is_limited_too() {
    let server = Server::start_with(|config| {
        config.limits.image_bytes = 1000;
        config.limits.json_bytes = 1000;
    })
    .await;
    let map = server.client.map().await;
    let token = server.client.token.clone().unwrap();
    let mut chunked = format!(
        "POST /v1/maps/{map}/localize HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n\
         Connection: close\r\nContent-Type: image/jpeg\r\nTransfer-Encoding: chunked\r\n\r\nbb8\r\n"
    )
    .into_bytes();
    chunked.extend([&[0; 3000][..], b"\r\n0\r\n\r\n"].concat());
    assert_eq!(server.client.raw(chunked).await.expect(413).code(), "too_large");
}

#[tokio::test]
async fn poses_of_a_map_are_listed() {
    let server = Server::start().await;
    let client = &server.client;
    let map = client.map().await;
    let cameras = client.get(&format!("/v1/maps/{map}/cameras")).await.expect(200).json();
    assert_eq!(cameras["images"][0]["image"], "a.jpg");
    assert_eq!(cameras["images"][0]["pose"]["position"], json!([1.0, 2.0, 3.0]));
    let path = format!("/v1/maps/{map}");
    let renamed = client.json("PATCH", &path, &[], json!({"name": "yard"}));
    assert_eq!(renamed.await.expect(200).json()["name"], "yard");
    // An archive is made from the files of a folder; it goes with the map.
    client.get(&format!("/v1/maps/{map}/export/colmap.zip")).await.expect(200);
    let folder = server.folder.0.join("data/maps").join(&map);
    assert!(folder.exists());
    client.delete(&format!("/v1/maps/{map}")).await.expect(204);
    client.get(&format!("/v1/maps/{map}")).await.expect(404);
    assert!(!folder.exists());
}

#[tokio::test]
async fn questions_beyond_the_queue_are_turned_away() {
    let server = Server::start_with(|config| {
        config.workers.localizers = 1;
        config.workers.waiting = 1;
    })
    .await;
    let map = server.client.map().await;
    let asked: Vec<_> = (0..5)
        .map(|_| {
            let (client, path) = (server.client.clone(), format!("/v1/maps/{map}/localize"));
            tokio::spawn(async move {
                let jpeg = [("Content-Type", "image/jpeg")];
                client.send("POST", &path, &jpeg, &photo("slow")).await
            })
        })
        .collect();
    let (mut answered, mut refused) = (0, 0);
    for answer in asked {
        let answer = answer.await.unwrap();
        if answer.status == 200 {
            answered += 1;
        } else {
            assert_eq!(answer.expect(503).code(), "worker_busy");
            refused += 1;
        }
    }
    assert!(answered >= 2 && refused >= 1, "{answered} answered, {refused} refused");
}

/// A photo that two maps know about as well has no place; a much weaker second map is no matter.
#[tokio::test]
async fn of_several_maps_the_best_answers_unless_two_are_as_good() {
    let server = Server::start().await;
    let client = &server.client;
    let mut maps = Vec::new();
    for name in ["elsewhere.jpg", "inliers 20.jpg", "inliers 80.jpg", "inliers 90.jpg"] {
        let job = client.reconstruct(&[name, "b.jpg"]).await;
        let job = client.finished(&job).await;
        maps.push(job["outputs"]["map_id"].as_str().unwrap().to_owned());
    }
    let jpeg = [("Content-Type", "image/jpeg")];
    for (asked, status, best, reason) in [
        (vec![0, 1, 2], "ok", 2, Value::Null),
        (vec![2, 1], "ok", 2, Value::Null),
        (vec![1], "ok", 1, Value::Null),
        (vec![2, 3, 1], "ambiguous", 3, json!("several_maps")),
        (vec![0], "not_found", 0, json!("too_few_matches")),
    ] {
        let ids: Vec<_> = asked.iter().map(|&i: &usize| maps[i].as_str()).collect();
        let path = format!("/v1/localize?map_ids={}", ids.join(","));
        let answer = client.send("POST", &path, &jpeg, &photo("here")).await.expect(200).json();
        assert_eq!(answer["status"], status, "{answer:#}");
        assert_eq!(answer["map_id"], maps[best]);
        assert_eq!(answer["reason"], reason);
        assert_eq!(answer["pose"].is_null(), status != "ok");
        let answers = answer["answers"].as_array().unwrap().iter();
        let of: Vec<_> = answers.clone().map(|answer| answer["map_id"].as_str().unwrap()).collect();
        assert_eq!(of, ids, "in the order asked");
        for (answer, map) in answers.zip(asked) {
            assert_eq!(answer["status"], if map == 0 { "not_found" } else { "ok" });
        }
    }

    let form = [("Content-Type", "multipart/form-data; boundary=cut")];
    let head = format!(
        "--cut\r\nContent-Disposition: form-data; name=\"map_ids\"\r\n\r\n{}, {}\r\n\
         --cut\r\nContent-Disposition: form-data; name=\"image\"\r\n\r\n",
        maps[0], maps[2]
    );
    let body = [head.as_bytes(), &photo("here"), b"\r\n--cut--\r\n"].concat();
    let answer = client.send("POST", "/v1/localize", &form, &body).await.expect(200).json();
    assert_eq!((&answer["status"], &answer["map_id"]), (&json!("ok"), &json!(maps[2])));
    let one = format!("/v1/maps/{}/localize", maps[2]);
    let refused = client.send("POST", &one, &form, &body).await.expect(422);
    assert_eq!(refused.code(), "unknown_field");

    let nowhere = "01900000-0000-7000-8000-000000000000";
    let many: Vec<_> =
        (0..9).map(|i| nowhere.replace("01900000", &format!("0190000{i}"))).collect();
    for (query, status, code) in [
        (String::new(), 422, "bad_map_ids"),
        ("?map_ids=".to_owned(), 422, "bad_map_ids"),
        ("?map_ids=hall".to_owned(), 422, "bad_map_ids"),
        (format!("?map_ids={0},{0}", maps[2]), 422, "bad_map_ids"),
        (format!("?map_ids={}", many.join(",")), 422, "bad_map_ids"),
        (format!("?map_ids={},{nowhere}", maps[2]), 404, "not_found"),
        (format!("?maps={}", maps[2]), 422, "unknown_field"),
    ] {
        let path = format!("/v1/localize{query}");
        let answer = client.send("POST", &path, &jpeg, &photo("here")).await.expect(status);
        assert_eq!(answer.code(), code, "{query}");
    }
}
