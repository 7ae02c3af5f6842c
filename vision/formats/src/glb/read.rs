//! A textured mesh back from a GLB of ours.

use nalgebra::Point3;
use serde_json::Value;
use volery_scene::{Texture, TexturedMesh};

use super::moved::{ForeignGlb, parts};
use super::{gltf, mesh::srgb_from_linear};
use crate::{DecodeLimits, decode_image};

/// Color of vertices without one.
const PLAIN: [u8; 3] = [160; 3];

/// Reads what [`super::write_glb_of_textured_mesh`] wrote, in map coordinates. The texture went
/// through JPEG.
///
/// # Errors
///
/// [`ForeignGlb`] for all other bytes, for points alone and for meshes without texture.
pub fn read_glb_of_textured_mesh(bytes: &[u8]) -> Result<TexturedMesh, ForeignGlb> {
    read(bytes).ok_or(ForeignGlb)
}

fn read(bytes: &[u8]) -> Option<TexturedMesh> {
    let (document, binary) = parts(bytes)?;
    let file = File { document: &document, binary: &binary };
    let picture = file.view(document["images"].get(0)?["bufferView"].as_u64()?)?;
    let picture = decode_image(picture, &DecodeLimits::default()).ok()?.color?;
    let texture = Texture {
        width: picture.width(),
        height: picture.height(),
        pixels: picture.to_rgb().as_chunks::<3>().0.to_vec(),
    };
    let mut all = TexturedMesh { texture, ..TexturedMesh::default() };
    for primitive in document["meshes"].get(0)?["primitives"].as_array()? {
        let attributes = &primitive["attributes"];
        let first = u32::try_from(all.mesh.vertices.len()).ok()?;
        let positions = file.floats::<3>(&attributes["POSITION"])?;
        let num = positions.len();
        if !positions.as_flattened().iter().all(|v| v.is_finite()) {
            return None;
        }
        all.mesh.vertices.extend(positions.iter().map(|p| Point3::from(p.map(f64::from))));
        let uvs = &attributes["TEXCOORD_0"];
        let is_textured = !uvs.is_null();
        let uvs = if is_textured { file.floats::<2>(uvs)? } else { vec![[0.0; 2]; num] };
        uvs.as_flattened().iter().all(|v| v.is_finite()).then_some(())?;
        all.uvs.extend(uvs);
        let colors = &attributes["COLOR_0"];
        let colors = if colors.is_null() { vec![PLAIN; num] } else { file.colors(colors)? };
        all.mesh.colors.extend(colors);
        let corners = file.data(&primitive["indices"], gltf::UNSIGNED_INT, "SCALAR", 4)?;
        let corners = corners.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b));
        let corners: Option<Vec<u32>> =
            corners.map(|v| first.checked_add(v).filter(|_| (v as usize) < num)).collect();
        all.mesh.triangles.extend(corners?.as_chunks::<3>().0);
        if is_textured {
            // What is textured comes first.
            (first == 0).then_some(())?;
            all.num_textured = all.mesh.triangles.len();
        }
    }
    let num = all.mesh.vertices.len();
    (all.uvs.len() == num && all.mesh.colors.len() == num).then_some(all)
}

struct File<'a> {
    document: &'a Value,
    binary: &'a [u8],
}

impl<'a> File<'a> {
    fn view(&self, view: u64) -> Option<&'a [u8]> {
        let view = self.document["bufferViews"].get(usize::try_from(view).ok()?)?;
        let number = |name: &str| usize::try_from(view[name].as_u64()?).ok();
        let start = number("byteOffset")?;
        self.binary.get(start..start.checked_add(number("byteLength")?)?)
    }

    /// Bytes of an accessor whose elements have `size` bytes.
    fn data(&self, accessor: &Value, component: u32, kind: &str, size: usize) -> Option<&'a [u8]> {
        let accessor = self.document["accessors"].get(usize::try_from(accessor.as_u64()?).ok()?)?;
        let is_so = accessor["componentType"] == component && accessor["type"] == kind;
        let count = usize::try_from(accessor["count"].as_u64()?).ok()?;
        let length = is_so.then_some(count)?.checked_mul(size)?;
        self.view(accessor["bufferView"].as_u64()?)?.get(..length)
    }

    fn floats<const N: usize>(&self, accessor: &Value) -> Option<Vec<[f32; N]>> {
        let data = self.data(accessor, gltf::FLOAT, &format!("VEC{N}"), 4 * N)?;
        let values: Vec<f32> =
            data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        Some(values.as_chunks::<N>().0.to_vec())
    }

    fn colors(&self, accessor: &Value) -> Option<Vec<[u8; 3]>> {
        let data = self.data(accessor, gltf::UNSIGNED_BYTE, "VEC4", 4)?;
        let color = |c: &[u8; 4]| [c[0], c[1], c[2]].map(srgb_from_linear);
        Some(data.as_chunks::<4>().0.iter().map(color).collect())
    }
}

#[cfg(test)]
mod tests {
    use volery_scene::TriangleMesh;

    use super::*;
    use crate::{glb::tests::METRIC, write_glb_of_textured_mesh};

    fn textured() -> TexturedMesh {
        let corner = |i: u32| Point3::new(f64::from(i), f64::from(i * i), 0.5);
        TexturedMesh {
            mesh: TriangleMesh {
                vertices: (0..7).map(corner).collect(),
                triangles: vec![[0, 1, 2], [1, 3, 2], [4, 5, 6]],
                colors: [PLAIN, PLAIN, PLAIN, PLAIN, [90; 3], [200; 3], [255; 3]].into(),
            },
            uvs: vec![
                [0.25, 0.5],
                [0.5, 0.5],
                [1.0, 0.0],
                [0.0, 1.0],
                [0.0; 2],
                [0.0; 2],
                [0.0; 2],
            ],
            num_textured: 2,
            texture: Texture { width: 16, height: 8, pixels: vec![[200, 100, 50]; 128] },
        }
    }

    #[test]
    fn textured_meshes_come_back() {
        let written = textured();
        let glb = write_glb_of_textured_mesh(&written, &METRIC, 95).unwrap();
        let read = read_glb_of_textured_mesh(&glb).unwrap();
        assert_eq!(read.mesh.vertices, written.mesh.vertices);
        assert_eq!(read.mesh.triangles, written.mesh.triangles);
        assert_eq!((read.uvs, read.num_textured), (written.uvs, 2));
        assert_eq!((read.texture.width, read.texture.height), (16, 8));
        let near = |a: &[u8; 3], b: &[u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) < 5);
        assert!(read.texture.pixels.iter().all(|c| near(c, &[200, 100, 50])));
        assert!(read.mesh.colors.iter().zip(&written.mesh.colors).all(|(a, b)| near(a, b)));
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let glb = write_glb_of_textured_mesh(&textured(), &METRIC, 95).unwrap();
        for end in (0..glb.len()).step_by(7) {
            assert_eq!(read_glb_of_textured_mesh(&glb[..end]), Err(ForeignGlb), "cut at {end}");
        }
        let mut unseen = textured();
        unseen.num_textured = 0;
        let bare = write_glb_of_textured_mesh(&unseen, &METRIC, 95).unwrap();
        assert_eq!(read_glb_of_textured_mesh(&bare), Err(ForeignGlb));
    }
}
