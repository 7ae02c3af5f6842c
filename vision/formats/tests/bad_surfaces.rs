//! PLY and GLB files that lie: each is refused, and none costs memory that it does not bring.

use nalgebra::{Point3, Similarity3, Vector3};
use serde_json::{Value, json};
use volery_formats::{
    GlbMap, move_glb, read_glb_of_textured_mesh, read_ply, read_ply_of_cloud, read_ply_of_mesh,
    write_glb_of_textured_mesh, write_ply_of_cloud, write_ply_of_mesh,
};
use volery_scene::{OrientedPoint, PointCloud, Texture, TexturedMesh, TriangleMesh};

fn mesh() -> TriangleMesh {
    let corner = |i: u32| Point3::new(f64::from(i), f64::from(i * i), 0.5);
    TriangleMesh {
        vertices: (0..4).map(corner).collect(),
        triangles: vec![[0, 1, 2], [1, 3, 2]],
        colors: vec![[9; 3]; 4],
    }
}

fn cloud() -> PointCloud {
    let point = OrientedPoint {
        position: Point3::new(1.0, 2.0, 3.0),
        normal: Vector3::z(),
        color: [1, 2, 3],
        confidence: 128,
        inferred: false,
    };
    PointCloud { points: vec![point; 3] }
}

/// The text of the header replaced, the data kept.
fn with_header(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.contains(from), "{header}");
    [header.replacen(from, to, 1).as_bytes(), &bytes[end..]].concat()
}

#[test]
fn plys_that_lie_are_refused() {
    let (good, points) = (write_ply_of_mesh(&mesh()), write_ply_of_cloud(&cloud()));
    assert!(read_ply_of_mesh(&good).is_ok() && read_ply_of_cloud(&points).is_ok());
    for count in ["5", "18446744073709551615", "4611686018427387905", "-1", "4e0", "99999999999"] {
        let lying = with_header(&good, "vertex 4", &format!("vertex {count}"));
        assert!(read_ply_of_mesh(&lying).is_err(), "{count} vertices");
        let lying = with_header(&good, "face 2", &format!("face {count}"));
        assert!(read_ply_of_mesh(&lying).is_err(), "{count} faces");
        let lying = with_header(&points, "vertex 3", &format!("vertex {count}"));
        assert!(read_ply_of_cloud(&lying).is_err(), "{count} points");
        assert!(read_ply(&lying).is_err(), "{count} points");
    }
    for (from, to) in [
        ("property float x", "property float w"),
        ("property float x", "property list uchar float x"),
        ("property float x", "property quad x"),
        ("binary_little_endian", "binary_middle_endian"),
        ("end_header\n", "end_head\n"),
    ] {
        assert!(read_ply_of_mesh(&with_header(&good, from, to)).is_err(), "{to}");
        assert!(read_ply_of_cloud(&with_header(&points, from, to)).is_err(), "{to}");
    }
    for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for bytes in [&good, &points] {
            let mut bytes = bytes.clone();
            let start = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            bytes[start + 4..start + 8].copy_from_slice(&odd.to_le_bytes());
            assert!(read_ply(&bytes).is_err(), "{odd}");
            assert!(read_ply_of_mesh(&bytes).is_err() && read_ply_of_cloud(&bytes).is_err());
        }
    }
    for bytes in [&good, &points] {
        for end in 0..bytes.len() {
            let cut = &bytes[..end];
            assert!(read_ply_of_mesh(cut).is_err() && read_ply_of_cloud(cut).is_err(), "{end}");
        }
    }
}

/// A document and its binary data as a file.
fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let words = [2, 28 + text.len() + binary.len(), text.len(), 0x4e4f_534a];
    bytes.extend(words.iter().flat_map(|w| (*w as u32).to_le_bytes()));
    bytes.extend(text);
    bytes.extend([binary.len(), 0x004e_4942].iter().flat_map(|w| (*w as u32).to_le_bytes()));
    bytes.extend(binary);
    bytes
}

#[test]
fn glbs_that_lie_are_refused() {
    let textured = TexturedMesh {
        mesh: mesh(),
        uvs: vec![[0.5; 2]; 4],
        num_textured: 2,
        texture: Texture { width: 8, height: 8, pixels: vec![[100; 3]; 64] },
    };
    let map = GlbMap { id: Some("m"), is_metric: true, origin: None };
    let good = write_glb_of_textured_mesh(&textured, &map, 90).unwrap();
    let length = u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&good[20..20 + length]).unwrap();
    let binary = &good[28 + length..];
    let same = Similarity3::identity();
    assert!(read_glb_of_textured_mesh(&glb(&document, binary)).is_ok());
    assert!(move_glb(&glb(&document, binary), &same).is_ok());

    let primitive = "/meshes/0/primitives/0";
    let accessor = |name: &str| {
        let index = document.pointer(&format!("{primitive}/{name}")).unwrap();
        format!("/accessors/{index}")
    };
    let (position, indices) = (accessor("attributes/POSITION"), accessor("indices"));
    let image = document["images"][0]["bufferView"].as_u64().unwrap();
    let huge = json!(u64::MAX);
    for (at, value) in [
        ("/buffers/0/byteLength".to_owned(), huge.clone()),
        ("/buffers/0/byteLength".to_owned(), json!(-1)),
        ("/buffers/0/uri".to_owned(), json!("http://127.0.0.1/data.bin")),
        ("/images/0".to_owned(), json!({ "uri": "file:///etc/passwd" })),
        ("/images/0/bufferView".to_owned(), json!(99)),
        (format!("/bufferViews/{image}/byteOffset"), huge.clone()),
        (format!("/bufferViews/{image}/byteLength"), json!(3)),
        (format!("{position}/count"), huge.clone()),
        (format!("{position}/count"), json!(5)),
        (format!("{position}/bufferView"), huge.clone()),
        (format!("{position}/componentType"), json!(5121)),
        (format!("{position}/type"), json!("MAT4")),
        (format!("{indices}/count"), huge.clone()),
        (format!("{indices}/componentType"), json!(5126)),
        (format!("{primitive}/indices"), json!(99)),
        (format!("{primitive}/attributes/POSITION"), json!(99)),
        ("/meshes".to_owned(), json!("none")),
    ] {
        let mut lying = document.clone();
        let (parent, name) = at.rsplit_once('/').unwrap();
        let parent = lying.pointer_mut(parent).unwrap();
        match parent.as_array_mut() {
            Some(items) => items[name.parse::<usize>().unwrap()] = value.clone(),
            None => parent[name] = value.clone(),
        }
        let bytes = glb(&lying, binary);
        assert!(read_glb_of_textured_mesh(&bytes).is_err(), "{at} {value}");
        // It only looks at positions: it may do without the rest, and must not panic.
        let moved = move_glb(&bytes, &same);
        assert!(moved.is_err() || !at.starts_with(&position), "{at} {value}");
    }
    let offset_of = |accessor: &str| {
        let view = document.pointer(&format!("{accessor}/bufferView")).unwrap().as_u64().unwrap();
        document["bufferViews"][view as usize]["byteOffset"].as_u64().unwrap() as usize
    };
    for (accessor, odd) in [(&position, f32::NAN.to_le_bytes()), (&indices, 4_u32.to_le_bytes())] {
        let mut odd_binary = binary.to_vec();
        let at = offset_of(accessor);
        odd_binary[at..at + 4].copy_from_slice(&odd);
        assert!(read_glb_of_textured_mesh(&glb(&document, &odd_binary)).is_err(), "{accessor}");
    }
    for end in 0..good.len() {
        assert!(read_glb_of_textured_mesh(&good[..end]).is_err(), "cut at {end}");
    }
}
