//! Triangle meshes as PLY.

use std::fmt::Write;

use volery_scene::TriangleMesh;

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

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::ply::read_ply;

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
        let read = read_ply(&bytes).unwrap();
        assert_eq!((read.points, read.colors), (mesh.vertices.clone(), mesh.colors.clone()));
        assert_eq!(bytes[bytes.len() - 13..], [3, 2, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        mesh.colors.clear();
        let bare = write_ply_of_mesh(&mesh);
        assert_eq!(read_ply(&bare).unwrap().points, mesh.vertices);
    }
}
