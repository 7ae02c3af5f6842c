//! A surface with its texture as binary glTF 2.0.

use serde_json::{Value, json};
use volery_scene::TexturedMesh;

use super::mesh::{linear_from_srgb, surface_document};
use super::{Buffer, GlbMap, container, gltf};
use crate::{WriteJpegError, write_jpeg};

/// Writes a textured mesh in map coordinates as a GLB with the texture as JPEG of a quality from 1
/// to 100; the root node turns it to glTF's axes. `asset.extras` is as [`GlbMap`] says.
///
/// The materials are unlit: the light of the room is in the photos. What no photo shows is a
/// primitive of its own whose material is named `unseen`; it has the colors of the vertices.
///
/// # Errors
///
/// [`WriteJpegError`] if the texture has no pixels or too many.
pub fn write_glb_of_textured_mesh(
    textured: &TexturedMesh,
    map: &GlbMap<'_>,
    quality: u8,
) -> Result<Vec<u8>, WriteJpegError> {
    let mesh = &textured.mesh;
    let (seen, unseen) = mesh.triangles.split_at(textured.num_textured);
    let mut document = surface_document(map);
    if mesh.triangles.is_empty() {
        return Ok(container(&document, Vec::new()));
    }
    let mut buffer = Buffer::default();
    let (mut primitives, mut materials) = (Vec::<Value>::new(), Vec::<Value>::new());
    // The vertices of what is seen come first.
    let num_seen = seen.iter().flatten().max().map_or(0, |&v| v as usize + 1);
    if !seen.is_empty() {
        let position = buffer.positions(&mesh.vertices[..num_seen]);
        let uv = buffer.uvs(&textured.uvs[..num_seen]);
        primitives.push(json!({
            "attributes": { "POSITION": position, "TEXCOORD_0": uv },
            "indices": buffer.indices(seen),
            "material": materials.len(),
        }));
        materials.push(json!({
            "name": "photos",
            "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": 0 },
                "metallicFactor": 0.0,
                "roughnessFactor": 1.0,
            },
            "extensions": { "KHR_materials_unlit": {} },
        }));
        let image = buffer.image(&write_jpeg(&textured.texture, quality)?);
        document["images"] = json!([{ "bufferView": image, "mimeType": "image/jpeg" }]);
        document["samplers"] = json!([{
            "magFilter": gltf::LINEAR,
            "minFilter": gltf::LINEAR_MIPMAP_LINEAR,
            "wrapS": gltf::CLAMP_TO_EDGE,
            "wrapT": gltf::CLAMP_TO_EDGE,
        }]);
        document["textures"] = json!([{ "sampler": 0, "source": 0 }]);
    }
    if !unseen.is_empty() {
        let first = unseen.iter().flatten().min().map_or(0, |&v| v as usize);
        let shift = |t: &[u32; 3]| t.map(|v| v - first as u32);
        let triangles: Vec<[u32; 3]> = unseen.iter().map(shift).collect();
        let mut attributes = json!({ "POSITION": buffer.positions(&mesh.vertices[first..]) });
        if mesh.colors.len() == mesh.vertices.len() {
            let colors = mesh.colors[first..].iter().map(|c| c.map(linear_from_srgb));
            attributes["COLOR_0"] = json!(buffer.colors(&colors.collect::<Vec<_>>()));
        }
        primitives.push(json!({
            "attributes": attributes,
            "indices": buffer.indices(&triangles),
            "material": materials.len(),
        }));
        materials.push(json!({
            "name": "unseen",
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            "extensions": { "KHR_materials_unlit": {} },
        }));
    }
    document["nodes"][0]["mesh"] = json!(0);
    document["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    document["meshes"] = json!([{ "name": "surface", "primitives": primitives }]);
    document["materials"] = json!(materials);
    document["accessors"] = json!(buffer.accessors);
    document["bufferViews"] = json!(buffer.views);
    document["buffers"] = json!([{ "byteLength": buffer.bytes.len() }]);
    Ok(container(&document, buffer.bytes))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use volery_scene::{Texture, TriangleMesh};

    use super::*;
    use crate::{DecodeLimits, decode_image, glb::tests::METRIC};

    fn textured() -> TexturedMesh {
        let corner = |i: u32| Point3::new(f64::from(i), f64::from(i * i), 1.0);
        TexturedMesh {
            mesh: TriangleMesh {
                vertices: (0..7).map(corner).collect(),
                triangles: vec![[0, 1, 2], [1, 3, 2], [4, 5, 6]],
                colors: (0..7).map(|i| [30 * i; 3]).collect(),
            },
            uvs: (0..7).map(|i| [i as f32 / 7.0, 0.5]).collect(),
            num_textured: 2,
            texture: Texture { width: 8, height: 4, pixels: vec![[200, 100, 50]; 32] },
        }
    }

    fn document(glb: &[u8]) -> (Value, &[u8]) {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let document = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        (document, glb.get(28 + length..).unwrap_or_default())
    }

    #[test]
    fn seen_and_unseen_have_their_own_primitives() {
        let glb = write_glb_of_textured_mesh(&textured(), &METRIC, 90).unwrap();
        let (document, binary) = document(&glb);
        let [seen, unseen] = [0, 1].map(|i| &document["meshes"][0]["primitives"][i]);
        let accessor = |index: &Value| &document["accessors"][index.as_u64().unwrap() as usize];
        assert_eq!(accessor(&seen["attributes"]["TEXCOORD_0"])["count"], 4);
        assert_eq!(accessor(&seen["attributes"]["TEXCOORD_0"])["type"], "VEC2");
        assert_eq!(accessor(&seen["indices"])["count"], 6);
        assert_eq!(accessor(&unseen["attributes"]["POSITION"])["count"], 3);
        assert_eq!(accessor(&unseen["attributes"]["POSITION"])["min"], json!([4.0, 16.0, 1.0]));
        assert_eq!(accessor(&unseen["attributes"]["COLOR_0"])["count"], 3);
        assert!(seen["attributes"].get("COLOR_0").is_none());
        let texture = &document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
        assert_eq!(texture["index"], 0);
        let view = document["images"][0]["bufferView"].as_u64().unwrap() as usize;
        let view = &document["bufferViews"][view];
        let [start, len] = ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap() as usize);
        let picture = decode_image(&binary[start..start + len], &DecodeLimits::default()).unwrap();
        let [r, g, b] = picture.rgb_at(3.0, 2.0);
        assert!(r.abs_diff(200) < 4 && g.abs_diff(100) < 4 && b.abs_diff(50) < 4);
        for view in document["bufferViews"].as_array().unwrap() {
            assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
        }
    }

    #[test]
    fn little_is_valid_too() {
        let empty = write_glb_of_textured_mesh(&TexturedMesh::default(), &METRIC, 90).unwrap();
        assert!(document(&empty).0.get("meshes").is_none());
        let mut unseen = textured();
        unseen.num_textured = 0;
        let glb = write_glb_of_textured_mesh(&unseen, &METRIC, 90).unwrap();
        let (document, _) = document(&glb);
        assert!(document.get("images").is_none());
        assert_eq!(document["materials"][0]["name"], "unseen");
        let mut broken = textured();
        broken.texture.pixels.pop();
        assert!(write_glb_of_textured_mesh(&broken, &METRIC, 90).is_err());
    }
}
