//! `volery reconstruct` and `volery localize` as a user runs them.

mod support;

use std::fs;

use support::{Folder, hall_photos, map_bytes, position_error, utf8, volery, volery_json};

/// Photos to a metric map and back: poses to centimeters, equal bytes for equal seeds, queries
/// found, photos of nothing not found.
#[test]
fn a_hall_is_mapped_and_photos_find_their_place() {
    let folder = Folder::new("hall");
    let hall = hall_photos(&folder.0);
    let (scan, telemetry) = (folder.join("scan"), folder.join("telemetry.csv"));
    let camera = folder.join("camera.json");
    let map = folder.join("map");
    let reconstruct = |out: &str| {
        volery_json(&[
            "reconstruct",
            utf8(&scan),
            "-o",
            out,
            "--camera",
            utf8(&camera),
            "--telemetry",
            utf8(&telemetry),
            "--seed",
            "5",
            "--stages",
            "sfm",
            "--json",
        ])
    };
    let (summary, _) = reconstruct(utf8(&map));
    assert_eq!(summary["num_registered"], hall.scan.len(), "{summary:#}");
    let (num_poses, error) = position_error(&hall, &map.join("poses.csv"));
    assert_eq!(num_poses, hall.scan.len());
    assert!(error < 0.02, "position error {error} m");
    for file in ["colmap/images.txt", "sparse.ply", "map.glb", "transforms.json", "report.html"] {
        assert!(map.join(file).exists(), "{file}");
    }

    let again = folder.join("again");
    reconstruct(utf8(&again));
    assert!(map_bytes(&map) == map_bytes(&again), "equal runs give equal bytes");

    let poses = folder.join("poses.csv");
    let query = folder.join("query");
    let white = folder.join("query/white.png");
    image::save_buffer(&white, &[255; 640 * 480], 640, 480, image::ColorType::L8).unwrap();
    fs::write(folder.join("query/broken.jpg"), b"not a photo").unwrap();
    let (answer, exit) =
        volery_json(&["localize", utf8(&map), utf8(&query), "-o", utf8(&poses), "--json"]);
    assert_eq!(exit, 3, "one file cannot be read: {answer:#}");
    let images = answer["images"].as_array().unwrap();
    let of = |name: &str| images.iter().find(|image| image["image"] == name).unwrap();
    assert_eq!(of("white.png")["status"], "not_found");
    assert_eq!(of("broken.jpg")["error"]["code"], "not_an_image");
    let num_ok = images.iter().filter(|image| image["status"] == "ok").count();
    assert!(num_ok * 4 >= hall.queries.len() * 3, "{answer:#}");
    let rows = fs::read_to_string(&poses).unwrap().lines().count() - 1;
    assert_eq!(rows, num_ok, "only images answered ok get a row");
}

/// Every bad input has a named error, and the process survives it.
#[test]
fn bad_inputs_have_names() {
    let folder = Folder::new("bad");
    let photos = folder.join("photos");
    let out = folder.join("out");
    let renew = || {
        let _ = fs::remove_dir_all(&photos);
        fs::create_dir_all(&photos).unwrap();
    };
    let code = || {
        let (answer, exit) =
            volery_json(&["reconstruct", utf8(&photos), "-o", utf8(&out), "--json"]);
        assert!(exit == 1 || exit == 2, "{answer:#}");
        answer["error"]["code"].as_str().unwrap().to_owned()
    };
    let save = |name: &str, pixels: &[u8]| {
        let path = photos.join(name);
        image::save_buffer(path, pixels, 160, 120, image::ColorType::L8).unwrap();
    };
    let noise = |seed: u32| -> Vec<u8> {
        let mut state = seed;
        (0..160 * 120)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            })
            .collect()
    };

    renew();
    assert_eq!(code(), "no_images");

    save("a.png", &noise(1));
    assert_eq!(code(), "too_few_images");

    save("b.png", &noise(1));
    assert_eq!(code(), "too_few_images", "duplicates count once");

    save("b.png", &noise(2));
    assert_eq!(code(), "no_overlap");

    renew();
    for name in ["a.png", "b.png", "c.png"] {
        let mut white = vec![255; 160 * 120];
        white[0] = name.as_bytes()[0];
        save(name, &white);
    }
    assert_eq!(code(), "too_few_features");

    renew();
    fs::write(photos.join("text.jpg"), "this is no photo").unwrap();
    fs::write(photos.join("empty.jpg"), "").unwrap();
    save("whole.png", &noise(3));
    let bytes = fs::read(photos.join("whole.png")).unwrap();
    fs::write(photos.join("cut.png"), &bytes[..bytes.len() / 2]).unwrap();
    let mut huge = bytes.clone();
    huge[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    fs::write(photos.join("huge.png"), &huge).unwrap();
    assert_eq!(code(), "too_few_images");
    let report = fs::read(out.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    for image in report["images"].as_array().unwrap() {
        let (name, detail) = (image["name"].as_str().unwrap(), image["detail"].as_str());
        let expected = match name {
            "text.jpg" => "not_an_image",
            "empty.jpg" => "empty_file",
            "cut.png" => "truncated",
            "huge.png" => "too_large",
            _ => continue,
        };
        assert!(detail.unwrap().starts_with(expected), "{name}: {detail:?}");
    }
    assert!(!out.join("map.json").exists(), "no map is left behind");
}

#[test]
fn wrong_usage_is_exit_code_2() {
    let folder = Folder::new("usage");
    let out = folder.join("out");
    for args in [
        &["reconstruct"][..],
        &["reconstruct", "/nowhere/at/all", "-o", utf8(&out)],
        &["reconstruct", utf8(&folder.0), "-o", utf8(&out), "--known-distance", "a,b"],
        &["localize", utf8(&out)],
        &["frobnicate"],
    ] {
        assert_eq!(volery(args).status.code(), Some(2), "{args:?}");
    }
}
