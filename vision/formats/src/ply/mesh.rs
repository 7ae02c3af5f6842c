//! Triangle meshes as PLY.

use std::fmt::Write;

use volery_scene::TriangleMesh;

use super::{Encoding, PlyError, Scalar, read_header, read_ply};

/// Writes binary little endian: x, y, z as 32-bit floats, red, green, blue if the mesh has colors,
/// and faces as lists of 32-bit indices.
pub fn write_ply_of_mesh(mesh: &TriangleMesh) -> Vec<u8> {
    let has_colors = mesh.colors.len() == mesh.vertices.len();
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    let _ = writeln!(header, "element vertex {}", mesh.vertices.len());
    header.push_str("property float x\nproperty float y\nproperty float z\n");
    if has_colors {
        header.push_str("property uchar red\nproperty uchar green\nproperty uchar blue\n");
    }
    let _ = writeln!(header, "element face {}", mesh.triangles.len());
    header.push_str("property list uchar uint vertex_indices\nend_header\n");
    let mut bytes = header.into_bytes();
    bytes.reserve(mesh.vertices.len() * 15 + mesh.triangles.len() * 13);
    for (index, vertex) in mesh.vertices.iter().enumerate() {
        bytes.extend(vertex.iter().flat_map(|&v| (v as f32).to_le_bytes()));
        if has_colors {
            bytes.extend(mesh.colors[index]);
        }
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

/// Reads a binary little-endian mesh of triangles, whatever integers its lists are made of; nothing
/// may follow the faces, and they have no other property.
///
/// # Errors
///
/// As [`read_ply`], and [`PlyError::Header`] for faces that are no triangles of the vertices.
pub fn read_ply_of_mesh(bytes: &[u8]) -> Result<TriangleMesh, PlyError> {
    let cloud = read_ply(bytes)?;
    let (layout, data) = read_header(bytes)?;
    let error = |text: &str| PlyError::Header(text.to_owned());
    let header = String::from_utf8_lossy(&bytes[..bytes.len() - data.len()]);
    let list = face_list(&header).filter(|_| layout.encoding == Encoding::LittleEndian);
    let (num_triangles, [of_count, of_corner]) =
        list.ok_or_else(|| error("faces that are not understood"))?;
    let stride = of_count.size() + 3 * of_corner.size();
    let faces = &data[layout.num_vertices * layout.stride()..];
    if num_triangles.checked_mul(stride) != Some(faces.len()) {
        return Err(error("another number of triangles than promised"));
    }
    let triangle = |record: &[u8]| {
        let (count, corners) = record.split_at(of_count.size());
        let corner = |k: usize| {
            let value = of_corner.read(padded(&corners[k * of_corner.size()..], of_corner));
            (0.0..cloud.points.len() as f64).contains(&value).then_some(value as u32)
        };
        let [a, b, c] = [0, 1, 2].map(corner);
        (of_count.read(padded(count, of_count)) == 3.0).then_some([a?, b?, c?])
    };
    let triangles: Option<_> = faces.chunks_exact(stride).map(triangle).collect();
    Ok(TriangleMesh {
        vertices: cloud.points,
        triangles: triangles.ok_or_else(|| error("a face that is no triangle of the vertices"))?,
        colors: if layout.rgb.is_some() { cloud.colors } else { Vec::new() },
    })
}

/// Number of faces, and types of a list's length and of its elements.
fn face_list(header: &str) -> Option<(usize, [Scalar; 2])> {
    let mut lines = header.lines().map(str::trim).filter(|line| !line.starts_with("comment"));
    let count = lines.find_map(|line| line.strip_prefix("element face "))?.trim().parse().ok()?;
    let words: Vec<&str> = lines.next()?.split_ascii_whitespace().collect();
    let ["property", "list", length, element, "vertex_indices" | "vertex_index"] = words[..] else {
        return None;
    };
    let types = [Scalar::from_name(length)?, Scalar::from_name(element)?];
    let is_integer = |scalar: &Scalar| !matches!(scalar, Scalar::F32 | Scalar::F64);
    (lines.next()? == "end_header" && types.iter().all(is_integer)).then_some((count, types))
}

/// The first bytes of a value, as [`Scalar::read`] takes them.
fn padded(bytes: &[u8], scalar: Scalar) -> [u8; 8] {
    let mut raw = [0; 8];
    raw[..scalar.size()].copy_from_slice(&bytes[..scalar.size()]);
    raw
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn vertices_come_back_and_faces_have_their_bytes() {
        let mut mesh = TriangleMesh {
            vertices: [[0.0, 0.5, 1.0], [1.0, 0.0, -2.0], [0.25, 3.0, 4.0]]
                .map(Point3::from)
                .into(),
            triangles: vec![[0, 1, 2], [2, 1, 0]],
            colors: vec![[1, 2, 3], [4, 5, 6], [255, 0, 7]],
        };
        let bytes = write_ply_of_mesh(&mesh);
        assert_eq!(read_ply_of_mesh(&bytes), Ok(mesh.clone()));
        assert_eq!(bytes[bytes.len() - 13..], [3, 2, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        mesh.colors.clear();
        assert_eq!(read_ply_of_mesh(&write_ply_of_mesh(&mesh)), Ok(mesh));
        for end in 0..bytes.len() {
            assert!(read_ply_of_mesh(&bytes[..end]).is_err(), "cut at {end}");
        }
        for (at, lie) in [(bytes.len() - 13, 4), (bytes.len() - 4, 3)] {
            let mut lying = bytes.clone();
            lying[at] = lie;
            assert!(read_ply_of_mesh(&lying).is_err(), "{lie} at {at}");
        }
    }

    /// Meshes of others count corners and name them by other integers.
    #[test]
    fn lists_of_other_integers_are_read() {
        let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let file = |list: &str, faces: &[u8]| {
            let mut bytes = format!(
                "ply\nformat binary_little_endian 1.0\n{vertices}element face 1\n{list}\nend_header\n"
            )
            .into_bytes();
            bytes.extend(
                [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
                    .map(f32::to_le_bytes)
                    .as_flattened(),
            );
            bytes.extend(faces);
            read_ply_of_mesh(&bytes).map(|mesh| mesh.triangles)
        };
        let word = [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0];
        assert_eq!(file("property list uchar int vertex_indices", &word), Ok(vec![[0, 1, 2]]));
        let long = [3, 0, 0, 0, 2, 0, 1, 0, 0, 0];
        assert_eq!(file("property list int ushort vertex_index", &long), Ok(vec![[2, 1, 0]]));
        assert_eq!(
            file("property list uint8 char vertex_index", &[3, 0, 1, 2]),
            Ok(vec![[0, 1, 2]])
        );
        for (list, faces) in [
            ("property list uchar float vertex_indices", &word[..]),
            ("property list uchar int other", &word),
            ("property list uchar char vertex_index", &[3, 0, 1, 255]),
            ("property list uchar char vertex_index", &[4, 0, 1, 2]),
            ("property list uchar char vertex_index\nproperty uchar flags", &[3, 0, 1, 2, 9]),
        ] {
            assert!(matches!(file(list, faces), Err(PlyError::Header(_))), "{list}");
        }
    }
}
