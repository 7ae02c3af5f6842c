//! The surfaces of a hall as triangles: the truth that reconstructed meshes are compared with.

use nalgebra::Vector2;
use volery_scene::TriangleMesh;

use crate::Hall;
use crate::hall::Surface;
use crate::texture::Footprint;

impl Hall {
    /// All surfaces as a mesh of triangles whose legs are `edge` meters at most, counterclockwise
    /// seen from the free space; vertices have the mean color of what lies around them.
    pub fn mesh(&self, edge: f64) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for surface in &self.surfaces {
            add(&mut mesh, surface, edge);
        }
        mesh
    }
}

fn add(mesh: &mut TriangleMesh, surface: &Surface, edge: f64) {
    let [nx, ny] = [surface.width, surface.height].map(|s| (s / edge).ceil().max(1.0) as u32);
    let [dx, dy] = [surface.width / f64::from(nx), surface.height / f64::from(ny)];
    let footprint =
        Footprint { along_x: Vector2::new(dx as f32, 0.0), along_y: Vector2::new(0.0, dy as f32) };
    let first = mesh.vertices.len() as u32;
    for j in 0..=ny {
        for i in 0..=nx {
            let [x, y] = [dx * f64::from(i), dy * f64::from(j)];
            let at = Vector2::new(x as f32, y as f32);
            let color = surface.texture.sample(at, &footprint);
            mesh.vertices.push(surface.origin + surface.u * x + surface.v * y);
            mesh.colors.push(color.map(|c| c.round().clamp(0.0, 255.0) as u8));
        }
    }
    // u × v points into the wall where v points down and u to the viewer's right.
    let faces_viewer = surface.u.cross(&surface.v).dot(&surface.normal) > 0.0;
    for j in 0..ny {
        for i in 0..nx {
            let a = first + j * (nx + 1) + i;
            let (b, c, d) = (a + 1, a + nx + 1, a + nx + 2);
            for [p, q, r] in [[a, b, c], [b, d, c]] {
                mesh.triangles.push(if faces_viewer { [p, q, r] } else { [p, r, q] });
            }
        }
    }
}

/// Signed area of a triangle along a direction, to tell its sides.
#[cfg(test)]
fn faces(mesh: &TriangleMesh, triangle: &[u32; 3], from: &nalgebra::Point3<f64>) -> bool {
    let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
    (b - a).cross(&(c - a)).dot(&(from - a)) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn walls_face_the_room_and_have_its_area() {
        let hall = Hall::furnished(Vector3::new(6.0, 5.0, 2.6), 0.02, 1);
        let mesh = hall.mesh(0.5);
        let middle = Point3::new(0.0, 0.0, 1.3);
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
            (b - a).cross(&(c - a)).norm() / 2.0
        };
        let is_shell = |t: &&[u32; 3]| {
            let on = |k: usize, at: f64| {
                t.iter().all(|&v| (mesh.vertices[v as usize][k] - at).abs() < 1e-9)
            };
            on(0, -3.0) || on(0, 3.0) || on(1, -2.5) || on(1, 2.5) || on(2, 0.0) || on(2, 2.6)
        };
        let shell: Vec<&[u32; 3]> = mesh.triangles.iter().filter(is_shell).collect();
        let total: f64 = shell.iter().map(|t| area(t)).sum();
        // Beams and columns may touch walls with faces of their own, but those are not seen.
        let walls = 2.0 * (6.0 * 5.0 + 6.0 * 2.6 + 5.0 * 2.6);
        assert!((total - walls).abs() < 1e-6, "{total}, {walls}");
        assert!(shell.iter().all(|t| faces(&mesh, t, &middle)));
        assert_eq!(mesh.colors.len(), mesh.vertices.len());
    }
}
