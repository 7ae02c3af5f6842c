//! A GLB of ours in another frame.

use std::collections::BTreeSet;

use nalgebra::{Point3, Similarity3};
use serde_json::{Value, json};

use super::{container, gltf};

/// Bytes of the header of the file and of a chunk.
const FILE_HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// Why a GLB was not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("not a GLB that this software wrote")]
pub struct ForeignGlb;

/// The same meshes with all positions moved: `x_in_new = new_from_map * x`.
///
/// # Errors
///
/// [`ForeignGlb`] for bytes that `write_glb` and its kin do not write.
pub fn move_glb(bytes: &[u8], new_from_map: &Similarity3<f64>) -> Result<Vec<u8>, ForeignGlb> {
    let (mut document, mut binary) = parts(bytes).ok_or(ForeignGlb)?;
    for accessor in position_accessors(&document) {
        move_positions(&mut document, &mut binary, accessor, new_from_map).ok_or(ForeignGlb)?;
    }
    Ok(container(&document, binary))
}

/// The document and the binary data, as long as the buffer says.
pub(super) fn parts(bytes: &[u8]) -> Option<(Value, Vec<u8>)> {
    let word = |at: usize| {
        let bytes = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    };
    let is_glb = word(0)? == gltf::MAGIC && word(4)? == 2 && word(16)? == gltf::JSON_CHUNK;
    let json_end =
        is_glb.then_some(FILE_HEADER + CHUNK_HEADER)?.checked_add(word(FILE_HEADER)? as usize)?;
    let document: Value =
        serde_json::from_slice(bytes.get(FILE_HEADER + CHUNK_HEADER..json_end)?).ok()?;
    let Some(buffer) = document.get("buffers").and_then(|buffers| buffers.get(0)) else {
        return Some((document, Vec::new()));
    };
    // Nothing outside of the file is ever looked at.
    buffer.get("uri").is_none().then_some(())?;
    let length = usize::try_from(buffer.get("byteLength")?.as_u64()?).ok()?;
    let start = json_end.checked_add(CHUNK_HEADER)?;
    let binary = bytes.get(start..start.checked_add(length)?)?.to_vec();
    Some((document, binary))
}

fn position_accessors(document: &Value) -> BTreeSet<usize> {
    let meshes = document["meshes"].as_array().into_iter().flatten();
    let primitives = meshes.flat_map(|mesh| mesh["primitives"].as_array().into_iter().flatten());
    let accessors = primitives.filter_map(|part| part["attributes"]["POSITION"].as_u64());
    accessors.filter_map(|accessor| usize::try_from(accessor).ok()).collect()
}

fn move_positions(
    document: &mut Value,
    binary: &mut [u8],
    accessor: usize,
    new_from_map: &Similarity3<f64>,
) -> Option<()> {
    let described = document["accessors"].get(accessor)?;
    let is_ours = described["componentType"] == gltf::FLOAT && described["type"] == "VEC3";
    let view = &document["bufferViews"].get(described["bufferView"].as_u64()? as usize)?;
    let start = usize::try_from(view["byteOffset"].as_u64()?).ok()?;
    let count = usize::try_from(described["count"].as_u64()?).ok()?;
    let length = is_ours.then_some(count)?.checked_mul(12)?;
    (length as u64 <= view["byteLength"].as_u64()?).then_some(())?;
    let positions = binary.get_mut(start..start.checked_add(length)?)?;
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for bytes in positions.as_chunks_mut::<12>().0 {
        let values = [0, 4, 8].map(|at| [0, 1, 2, 3].map(|i| bytes[at + i]));
        let moved = new_from_map * Point3::from(values.map(|v| f64::from(f32::from_le_bytes(v))));
        moved.iter().all(|v| v.is_finite()).then_some(())?;
        for (axis, value) in moved.iter().map(|&v| v as f32).enumerate() {
            bounds[0][axis] = bounds[0][axis].min(value);
            bounds[1][axis] = bounds[1][axis].max(value);
            bytes[4 * axis..4 * axis + 4].copy_from_slice(&value.to_le_bytes());
        }
    }
    let described = document["accessors"].get_mut(accessor)?;
    described["min"] = json!(bounds[0]);
    described["max"] = json!(bounds[1]);
    Some(())
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use volery_scene::TriangleMesh;

    use super::*;
    use crate::{glb::tests::METRIC, write_glb_of_mesh};

    fn mesh(moved: Option<&Similarity3<f64>>) -> TriangleMesh {
        let vertices = [[0.0, 0.5, 1.0], [1.0, 0.0, -2.0], [0.25, 3.0, 4.0]].map(Point3::from);
        TriangleMesh {
            vertices: vertices.iter().map(|p| moved.map_or(*p, |moved| moved * p)).collect(),
            triangles: vec![[0, 1, 2]],
            colors: vec![[0; 3], [255; 3], [188; 3]],
        }
    }

    /// Moving the file is writing the moved mesh.
    #[test]
    fn a_moved_file_is_the_file_of_the_moved_mesh() {
        let quarter = Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let moved = Similarity3::new(Vector3::new(1.0, -2.0, 0.5), quarter, 2.0);
        let file = write_glb_of_mesh(&mesh(None), &METRIC);
        let expected = write_glb_of_mesh(&mesh(Some(&moved)), &METRIC);
        assert_eq!(move_glb(&file, &moved), Ok(expected));
    }

    #[test]
    fn other_files_are_refused() {
        let file = write_glb_of_mesh(&mesh(None), &METRIC);
        let same = Similarity3::identity();
        for end in 0..file.len() {
            assert_eq!(move_glb(&file[..end], &same), Err(ForeignGlb), "cut at {end}");
        }
        assert_eq!(move_glb(b"glTF", &same), Err(ForeignGlb));
        let empty = write_glb_of_mesh(&TriangleMesh::default(), &METRIC);
        assert_eq!(move_glb(&empty, &same), Ok(empty));
    }
}
