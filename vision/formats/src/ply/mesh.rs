//! Triangle meshes as PLY.

use std::fmt::Write;

use volery_scene::TriangleMesh;

use super::{Encoding, PlyError, read_header, read_ply};

/// Bytes of a triangle: the number of its corners and their indices.
const TRIANGLE_BYTES: usize = 13;

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

/// Reads what [`write_ply_of_mesh`] writes; other layouts of faces are refused.
///
/// # Errors
///
/// As [`read_ply`], and [`PlyError::Header`] for faces that are no triangles of the vertices.
pub fn read_ply_of_mesh(bytes: &[u8]) -> Result<TriangleMesh, PlyError> {
    let cloud = read_ply(bytes)?;
    let (layout, data) = read_header(bytes)?;
    let error = |text: &str| PlyError::Header(text.to_owned());
    let start = bytes.len() - data.len();
    let header = String::from_utf8_lossy(&bytes[..start]);
    let list = "property list uchar uint vertex_indices";
    let count = header.lines().find_map(|line| line.trim().strip_prefix("element face "));
    let num_triangles: usize = count
        .filter(|_| layout.encoding == Encoding::LittleEndian && header.contains(list))
        .and_then(|count| count.trim().parse().ok())
        .ok_or_else(|| error("faces that are not understood"))?;
    let faces = &data[layout.num_vertices * layout.stride()..];
    if num_triangles != faces.len() / TRIANGLE_BYTES || faces.len() % TRIANGLE_BYTES != 0 {
        return Err(error("another number of triangles than promised"));
    }
    let triangle = |record: &[u8; TRIANGLE_BYTES]| {
        let corner = |k: usize| {
            let bytes = [1, 2, 3, 4].map(|i| record[4 * k + i]);
            Some(u32::from_le_bytes(bytes)).filter(|&v| (v as usize) < cloud.points.len())
        };
        let [a, b, c] = [0, 1, 2].map(corner);
        (record[0] == 3).then_some([a?, b?, c?])
    };
    let triangles: Option<_> = faces.as_chunks::<TRIANGLE_BYTES>().0.iter().map(triangle).collect();
    Ok(TriangleMesh {
        vertices: cloud.points,
        triangles: triangles.ok_or_else(|| error("a face that is no triangle of the vertices"))?,
        colors: if layout.rgb.is_some() { cloud.colors } else { Vec::new() },
    })
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
}
