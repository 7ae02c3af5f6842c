//! A surface as binary glTF 2.0.

use serde_json::{Value, json};
use volery_scene::TriangleMesh;

use super::{Buffer, GLTF_FROM_MAP, GlbMap, container};

/// A document whose only node turns map coordinates to glTF's axes.
pub(super) fn surface_document(map: &GlbMap<'_>) -> Value {
    json!({
        "asset": map.asset(),
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "map", "rotation": GLTF_FROM_MAP }],
    })
}

/// Writes a mesh in map coordinates as a GLB; the root node turns it to glTF's axes. Colors are
/// those of the vertices. `asset.extras` is as [`GlbMap`] says.
///
/// Both sides of the triangles are drawn: rooms are seen from inside.
pub fn write_glb_of_mesh(mesh: &TriangleMesh, map: &GlbMap<'_>) -> Vec<u8> {
    let mut document = surface_document(map);
    let mut buffer = Buffer::default();
    if !mesh.triangles.is_empty() {
        let mut attributes = json!({ "POSITION": buffer.positions(&mesh.vertices) });
        if mesh.colors.len() == mesh.vertices.len() {
            // glTF's vertex colors are linear, ours sRGB.
            let linear: Vec<[u8; 3]> =
                mesh.colors.iter().map(|c| c.map(linear_from_srgb)).collect();
            attributes["COLOR_0"] = json!(buffer.colors(&linear));
        }
        let indices = buffer.indices(&mesh.triangles);
        document["nodes"][0]["mesh"] = json!(0);
        document["meshes"] = json!([{
            "name": "surface",
            "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }],
        }]);
        document["materials"] = json!([{
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
        }]);
        document["accessors"] = json!(buffer.accessors);
        document["bufferViews"] = json!(buffer.views);
        document["buffers"] = json!([{ "byteLength": buffer.bytes.len() }]);
    }
    container(&document, buffer.bytes)
}

/// IEC 61966-2-1.
pub(super) fn linear_from_srgb(value: u8) -> u8 {
    let v = f64::from(value) / 255.0;
    let linear = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    (linear * 255.0).round() as u8
}

/// The inverse of [`linear_from_srgb`], as near as eight bits tell.
pub(super) fn srgb_from_linear(value: u8) -> u8 {
    let v = f64::from(value) / 255.0;
    let encoded = if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use serde_json::Value;

    use super::*;
    use crate::glb::tests::METRIC;

    fn document(glb: &[u8]) -> Value {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&glb[20..20 + length]).unwrap()
    }

    #[test]
    fn accessors_describe_the_mesh() {
        let mesh = TriangleMesh {
            vertices: [[0.0, 0.5, 1.0], [1.0, 0.0, -2.0], [0.25, 3.0, 4.0]]
                .map(Point3::from)
                .into(),
            triangles: vec![[0, 1, 2]],
            colors: vec![[0; 3], [255; 3], [188; 3]],
        };
        let bytes = write_glb_of_mesh(&mesh, &METRIC);
        let document = document(&bytes);
        let accessors = document["accessors"].as_array().unwrap();
        assert_eq!(accessors[0]["min"], json!([0.0, 0.0, -2.0]));
        assert_eq!(accessors[0]["max"], json!([1.0, 3.0, 4.0]));
        assert_eq!(accessors[2]["count"], 3);
        assert_eq!(accessors[2]["type"], "SCALAR");
        for view in document["bufferViews"].as_array().unwrap() {
            let end = view["byteOffset"].as_u64().unwrap() + view["byteLength"].as_u64().unwrap();
            assert!(end <= document["buffers"][0]["byteLength"].as_u64().unwrap());
        }
        let unknown = GlbMap { is_metric: false, ..METRIC };
        let empty = write_glb_of_mesh(&TriangleMesh::default(), &unknown);
        assert_eq!(u32::from_le_bytes(empty[8..12].try_into().unwrap()) as usize, empty.len());
    }

    /// Half of the light is 188 of 255 in sRGB.
    #[test]
    fn colors_are_linear() {
        assert_eq!([0, 255, 188, 10].map(linear_from_srgb), [0, 255, 128, 1]);
    }
}
