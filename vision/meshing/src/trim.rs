//! What no sample supports is cut off.
//!
//! A Poisson surface is closed: it spans a skin over space that nobody has seen. The density of the
//! samples says where.

use volery_scene::TriangleMesh;

use crate::Surface;
use crate::disjoint_sets::DisjointSets;
use crate::fans::{Fans, for_each_edge};

/// Options of [`trim`]. Areas are in square units of the cloud's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrimOptions {
    /// Least density of the samples relative to the median over the vertices.
    pub min_density_ratio: f64,
    /// A part without support stays if it is smaller: a small hole is filled.
    pub max_hole_area: f64,
    /// A part that is left goes if it is smaller: crumbs.
    pub min_component_area: f64,
}

impl Default for TrimOptions {
    fn default() -> Self {
        Self { min_density_ratio: 0.1, max_hole_area: 0.0, min_component_area: 0.0 }
    }
}

/// The supported part of a surface.
pub fn trim(surface: &Surface, options: &TrimOptions) -> Surface {
    let mesh = &surface.mesh;
    let mut sorted = surface.densities.clone();
    sorted.sort_unstable_by(f32::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let least = options.min_density_ratio as f32 * median;
    let fans = Fans::new(mesh.vertices.len(), &mesh.triangles);
    let mut keep: Vec<bool> = mesh
        .triangles
        .iter()
        .map(|triangle| triangle.iter().all(|&v| surface.densities[v as usize] >= least))
        .collect();
    for (part, area) in parts(mesh, &fans, &keep) {
        if !keep[part[0]] && area <= options.max_hole_area {
            part.iter().for_each(|&triangle| keep[triangle] = true);
        }
    }
    for (part, area) in parts(mesh, &fans, &keep) {
        if keep[part[0]] && area < options.min_component_area {
            part.iter().for_each(|&triangle| keep[triangle] = false);
        }
    }
    kept_part(surface, &keep)
}

/// Triangles of one label that hang together by edges, with their area.
fn parts(mesh: &TriangleMesh, fans: &Fans, labels: &[bool]) -> Vec<(Vec<usize>, f64)> {
    let mut sets = DisjointSets::new(mesh.triangles.len());
    for_each_edge(&mesh.triangles, fans, |_, a, b| {
        if let Some(b) = b
            && labels[a as usize] == labels[b as usize]
        {
            sets.join(a as usize, b as usize);
        }
    });
    let mut place = vec![usize::MAX; mesh.triangles.len()];
    let mut parts: Vec<(Vec<usize>, f64)> = Vec::new();
    for index in 0..mesh.triangles.len() {
        let part = &mut place[sets.root(index)];
        if *part == usize::MAX {
            *part = parts.len();
            parts.push((Vec::new(), 0.0));
        }
        parts[*part].0.push(index);
        parts[*part].1 += area(mesh, index);
    }
    parts
}

fn area(mesh: &TriangleMesh, triangle: usize) -> f64 {
    let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.vertices[v as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// The kept triangles with the vertices they use, in their order.
fn kept_part(surface: &Surface, keep: &[bool]) -> Surface {
    let mesh = &surface.mesh;
    let kept = || mesh.triangles.iter().zip(keep).filter(|(_, keep)| **keep).map(|(t, _)| *t);
    let mut used = vec![false; mesh.vertices.len()];
    kept().flatten().for_each(|v| used[v as usize] = true);
    let mut result = Surface::default();
    let mut place = vec![0; mesh.vertices.len()];
    for v in (0..mesh.vertices.len()).filter(|&v| used[v]) {
        place[v] = result.mesh.vertices.len() as u32;
        result.mesh.vertices.push(mesh.vertices[v]);
        result.densities.push(surface.densities[v]);
        result.mesh.colors.extend(mesh.colors.get(v));
    }
    result.mesh.triangles = kept().map(|t| t.map(|v| place[v as usize])).collect();
    result
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use volery_scene::NoProgress;

    use super::*;
    use crate::test_shapes::*;
    use crate::{PoissonOptions, reconstruct_surface};

    /// A window of 1 x 1 m in the far wall.
    fn in_window(p: &Point3<f64>) -> bool {
        p.y > 2.9 && (1.0..2.0).contains(&p.x) && (1.0..2.0).contains(&p.z)
    }

    fn room_with_window() -> Surface {
        let cloud = room(40_000, 1, |p| !in_window(p));
        let options = PoissonOptions { depth: 7, ..PoissonOptions::default() };
        reconstruct_surface(&cloud, &options, &NoProgress).unwrap()
    }

    /// How far a point lies inside of the window's frame.
    fn depth_in_window(p: &Point3<f64>) -> f64 {
        if p.y < 2.5 {
            return 0.0;
        }
        [p.x - 1.0, 2.0 - p.x, p.z - 1.0, 2.0 - p.z].into_iter().fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn no_skin_is_left_over_a_window_and_no_wall_is_lost() {
        let closed = room_with_window();
        let deepest = |surface: &Surface| {
            surface.mesh.vertices.iter().map(depth_in_window).fold(0.0, f64::max)
        };
        // The leaves over the window have sides of up to 0.28 m.
        assert!(deepest(&closed) > 0.3, "{}", deepest(&closed));
        let open = trim(&closed, &TrimOptions::default());
        // The density is known to about two of the cells that it is counted on.
        let cell = 1.1 * 4.0 / 32.0;
        assert!(deepest(&open) < 2.0 * cell, "{}", deepest(&open));
        let seen = |p: &Point3<f64>| open.mesh.vertices.iter().any(|v| (v - p).norm() < 0.1);
        for point in positions(&room(500, 2, |p| !in_window(p))) {
            assert!(seen(&point), "no wall at {point}");
        }
        assert!(rms(&open.mesh, distance_to_room) < 0.02);
    }

    #[test]
    fn small_holes_stay_filled_and_crumbs_go() {
        let closed = room_with_window();
        let filled = trim(&closed, &TrimOptions { max_hole_area: 1.5, ..TrimOptions::default() });
        assert_eq!(filled, closed);
        let nothing =
            trim(&closed, &TrimOptions { min_component_area: 100.0, ..TrimOptions::default() });
        assert_eq!(nothing, Surface::default());
        assert_eq!(trim(&Surface::default(), &TrimOptions::default()), Surface::default());
    }
}
