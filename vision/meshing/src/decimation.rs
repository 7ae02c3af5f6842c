//! Fewer triangles by quadric edge collapse.

use nalgebra::{Point3, Vector3};
use volery_scene::{Cancelled, Progress, TriangleMesh};

use crate::fans::{Fans, for_each_edge};

mod quadric;
mod queue;

use quadric::Quadric;
use queue::{Candidate, Queue};

/// Planes through open edges count so much more than those of triangles, so that borders stay.
const BORDER_WEIGHT: f64 = 10.0;
/// A triangle may turn at most so far in one collapse: the cosine.
const MIN_NORMAL_COSINE: f64 = 0.3;
/// Candidates between two questions whether to stop.
const CHECK_INTERVAL: usize = 1 << 14;

/// Collapses the edges that cost least until `num_triangles` are left, or no edge can go without
/// folding the surface over or changing its genus. A closed surface stays closed.
///
/// # Errors
///
/// [`Cancelled`] when asked to stop.
///
/// # Source
///
/// Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", SIGGRAPH 1997; the
/// link condition of Dey, Edelsbrunner, Guha and Nekhayev, 1999.
pub fn decimate(
    mesh: &TriangleMesh,
    num_triangles: usize,
    progress: &dyn Progress,
) -> Result<TriangleMesh, Cancelled> {
    let mut work = Work::new(mesh);
    let mut num_candidates = 0;
    while work.num_triangles > num_triangles {
        let Some(candidate) = work.queue.pop() else { break };
        if num_candidates % CHECK_INTERVAL == 0 {
            progress.check()?;
        }
        num_candidates += 1;
        work.try_collapse(candidate);
    }
    Ok(work.into_mesh())
}

struct Work<'a> {
    mesh: &'a TriangleMesh,
    origin: Point3<f64>,
    positions: Vec<Vector3<f64>>,
    quadrics: Vec<Quadric>,
    /// Grows when a vertex moves: older candidates are void.
    versions: Vec<u32>,
    /// Gone triangles have `[u32::MAX; 3]`.
    triangles: Vec<[u32; 3]>,
    fans: Fans,
    num_triangles: usize,
    queue: Queue,
    marks: Marks,
    neighbors: Vec<u32>,
}

const GONE: [u32; 3] = [u32::MAX; 3];

impl<'a> Work<'a> {
    fn new(mesh: &'a TriangleMesh) -> Self {
        let origin = mesh.vertices.first().copied().unwrap_or_default();
        let positions: Vec<_> = mesh.vertices.iter().map(|v| v - origin).collect();
        let mut work = Self {
            mesh,
            origin,
            quadrics: vec![Quadric::ZERO; positions.len()],
            versions: vec![0; positions.len()],
            marks: Marks { marks: vec![0; positions.len()], last: 0 },
            fans: Fans::new(positions.len(), &mesh.triangles),
            positions,
            triangles: mesh.triangles.clone(),
            num_triangles: mesh.triangles.len(),
            queue: Queue::new(),
            neighbors: Vec::new(),
        };
        work.sum_quadrics();
        work
    }

    fn sum_quadrics(&mut self) {
        for &triangle in &self.mesh.triangles {
            let normal = self.area_vector(triangle);
            let area = 0.5 * normal.norm();
            if let Some(unit) = normal.try_normalize(0.0) {
                let point = self.positions[triangle[0] as usize];
                let quadric = Quadric::of_plane(point, unit, area / 3.0);
                triangle.iter().for_each(|&v| self.quadrics[v as usize].add(&quadric));
            }
        }
        let (mut all, mut open) = (Vec::with_capacity(2 * self.positions.len()), Vec::new());
        let mut last = None;
        for_each_edge(&self.mesh.triangles, &self.fans, |edge, triangle, other| {
            if other.is_none() {
                open.push((edge, self.mesh.triangles[triangle as usize]));
            }
            if last != Some(edge) {
                all.push(edge);
            }
            last = Some(edge);
        });
        open.iter().for_each(|&(edge, triangle)| self.hold_border(edge, triangle));
        all.into_iter().for_each(|edge| self.offer(edge));
    }

    /// A plane through an open edge, upright on its triangle.
    fn hold_border(&mut self, [a, b]: [u32; 2], triangle: [u32; 3]) {
        let along = self.positions[b as usize] - self.positions[a as usize];
        if let Some(normal) = along.cross(&self.area_vector(triangle)).try_normalize(0.0) {
            let weight = BORDER_WEIGHT * along.norm_squared();
            let quadric = Quadric::of_plane(self.positions[a as usize], normal, weight);
            self.quadrics[a as usize].add(&quadric);
            self.quadrics[b as usize].add(&quadric);
        }
    }

    /// Normal times twice the area.
    fn area_vector(&self, triangle: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
        (b - a).cross(&(c - a))
    }

    /// Where the ends of an edge would go, and at what cost.
    fn target(&self, [a, b]: [u32; 2]) -> (Vector3<f64>, f64) {
        let mut quadric = self.quadrics[a as usize];
        quadric.add(&self.quadrics[b as usize]);
        let (pa, pb) = (self.positions[a as usize], self.positions[b as usize]);
        let middle = 0.5 * (pa + pb);
        let length_squared = (pb - pa).norm_squared();
        let mut best = quadric.minimum_near(middle);
        // A minimum far from the edge is one of nearly parallel planes.
        if (best - middle).norm_squared() > 4.0 * length_squared {
            best = middle;
            for end in [pa, pb] {
                if quadric.at(end) < quadric.at(best) {
                    best = end;
                }
            }
        }
        // Of edges that cost nothing the short ones go first.
        (best, quadric.at(best) + 1e-12 * length_squared)
    }

    fn offer(&mut self, edge: [u32; 2]) {
        let (_, cost) = self.target(edge);
        self.queue.push(cost as f32, Candidate { edge, version: self.version(edge) });
    }

    fn version(&self, edge: [u32; 2]) -> u32 {
        let [a, b] = edge.map(|v| self.versions[v as usize]);
        a.wrapping_add(b)
    }

    fn try_collapse(&mut self, candidate: Candidate) {
        let edge @ [a, b] = candidate.edge;
        if self.version(edge) != candidate.version || !self.keeps_shape(a, b) {
            return;
        }
        let (target, _) = self.target(edge);
        if self.folds(a, b, target) || self.folds(b, a, target) {
            return;
        }
        self.positions[a as usize] = target;
        let quadric = self.quadrics[b as usize];
        self.quadrics[a as usize].add(&quadric);
        self.join(a, b);
        let newest = self.versions[a as usize].max(self.versions[b as usize]) + 1;
        self.versions[a as usize] = newest;
        let mark = self.marks.fresh(1);
        self.find_neighbors(a, mark);
        for i in 0..self.neighbors.len() {
            let neighbor = self.neighbors[i];
            self.offer([a.min(neighbor), a.max(neighbor)]);
        }
    }

    /// Makes `b` to `a`; the triangles of both are gone.
    fn join(&mut self, a: u32, b: u32) {
        let mut shared = [u32::MAX; 2];
        let mut num_shared = 0;
        for &t in self.fans.of(b) {
            let triangle = &mut self.triangles[t as usize];
            if triangle.contains(&a) {
                shared[num_shared] = t;
                num_shared += 1;
            } else {
                triangle.iter_mut().filter(|v| **v == b).for_each(|v| *v = a);
            }
        }
        for &t in &shared[..num_shared] {
            for v in std::mem::replace(&mut self.triangles[t as usize], GONE) {
                self.fans.remove(v, t);
            }
        }
        self.num_triangles -= num_shared;
        self.fans.take(a, b);
    }

    /// Other corners of a vertex' triangles, marked.
    fn find_neighbors(&mut self, vertex: u32, mark: u32) {
        self.neighbors.clear();
        for &t in self.fans.of(vertex) {
            for v in self.triangles[t as usize] {
                if v != vertex && self.marks.set(v, mark) {
                    self.neighbors.push(v);
                }
            }
        }
    }

    /// The link condition: the ends share no neighbors but those across their common triangles,
    /// an inner edge does not join two borders, and a tetrahedron stays one.
    fn keeps_shape(&mut self, a: u32, b: u32) -> bool {
        let near_a = self.marks.fresh(3);
        let [near_b, near_both] = [near_a + 1, near_a + 2];
        self.find_neighbors(a, near_a);
        let (mut num_a, mut num_b, mut num_common, mut shared) = (self.neighbors.len(), 0, 0, 0);
        for &t in self.fans.of(b) {
            let triangle = self.triangles[t as usize];
            shared += usize::from(triangle.contains(&a));
            for v in triangle.into_iter().filter(|&v| v != b) {
                if self.marks.get(v) == near_a {
                    num_common += 1;
                    num_b += 1;
                    self.marks.set(v, near_both);
                } else if self.marks.get(v) != near_both {
                    num_b += usize::from(self.marks.set(v, near_b));
                }
            }
        }
        let on_border = |v: u32, num_neighbors| num_neighbors != self.fans.of(v).len();
        let joins_borders = shared == 2 && on_border(a, num_a) && on_border(b, num_b);
        // Neither end counts as a neighbor of the other.
        num_a = num_a.saturating_sub(1);
        num_b = num_b.saturating_sub(1);
        (1..=2).contains(&shared)
            && num_common == shared
            && !joins_borders
            && num_a + num_b - num_common >= 3
    }

    /// Whether a triangle of `vertex` without `other` would turn too far.
    fn folds(&self, vertex: u32, other: u32, target: Vector3<f64>) -> bool {
        self.fans.of(vertex).iter().any(|&t| {
            let triangle = self.triangles[t as usize];
            if triangle.contains(&other) {
                return false;
            }
            let at = |v: u32| if v == vertex { target } else { self.positions[v as usize] };
            let [x, y, z] = triangle.map(at);
            let (before, after) = (self.area_vector(triangle), (y - x).cross(&(z - x)));
            // A triangle without area may turn as it likes, but none may lose its area.
            let (was, is) = (before.norm_squared(), after.norm_squared());
            is <= 1e-6 * was || before.dot(&after) < MIN_NORMAL_COSINE * (was * is).sqrt()
        })
    }

    fn into_mesh(self) -> TriangleMesh {
        let mut place = vec![u32::MAX; self.positions.len()];
        let mut result = TriangleMesh::default();
        for triangle in self.triangles.into_iter().filter(|&triangle| triangle != GONE) {
            result.triangles.push(triangle.map(|v| {
                let v = v as usize;
                if place[v] == u32::MAX {
                    place[v] = result.vertices.len() as u32;
                    result.vertices.push(self.origin + self.positions[v]);
                    result.colors.extend(self.mesh.colors.get(v));
                }
                place[v]
            }));
        }
        result
    }
}

/// A set of vertices that is emptied by counting on.
struct Marks {
    marks: Vec<u32>,
    last: u32,
}

impl Marks {
    /// The first of `count` marks that no vertex has.
    fn fresh(&mut self, count: u32) -> u32 {
        if self.last > u32::MAX - count {
            self.marks.fill(0);
            self.last = 0;
        }
        self.last += count;
        self.last - (count - 1)
    }

    fn get(&self, vertex: u32) -> u32 {
        self.marks[vertex as usize]
    }

    /// Whether it had another mark.
    fn set(&mut self, vertex: u32, mark: u32) -> bool {
        std::mem::replace(&mut self.marks[vertex as usize], mark) != mark
    }
}

#[cfg(test)]
mod tests {
    use volery_scene::NoProgress;

    use super::*;
    use crate::test_shapes::*;
    use crate::{PoissonOptions, reconstruct_surface};

    fn mesh_of(cloud: &volery_scene::PointCloud, depth: u32) -> TriangleMesh {
        let options = PoissonOptions { depth, ..PoissonOptions::default() };
        reconstruct_surface(cloud, &options, &NoProgress).unwrap().mesh
    }

    #[test]
    fn a_torus_keeps_its_hole_and_its_place_in_a_tenth_of_the_triangles() {
        let full = mesh_of(&torus(40_000, 1.0, 1), 7);
        let count = full.triangles.len() / 10;
        let small = decimate(&full, count, &NoProgress).unwrap();
        assert!(small.triangles.len() <= count && small.triangles.len() + 2 >= count);
        assert!(is_closed(&small));
        assert_eq!(euler_number(&small), 0);
        assert!((volume(&small) / volume(&full) - 1.0).abs() < 0.005);
        let error = rms(&small, distance_to_torus);
        assert!(error < 0.004, "{error}");
    }

    /// A flat wall needs few triangles, and its open border stays where it is.
    #[test]
    fn a_flat_patch_keeps_its_border() {
        let side = 20;
        let mut patch = TriangleMesh::default();
        for y in 0..=side {
            patch.vertices.extend((0..=side).map(|x| Point3::new(f64::from(x), f64::from(y), 0.0)));
        }
        for y in 0..side as u32 {
            for x in 0..side as u32 {
                let a = y * (side as u32 + 1) + x;
                let (b, c) = (a + 1, a + side as u32 + 1);
                patch.triangles.extend([[a, b, c], [b, c + 1, c]]);
            }
        }
        let small = decimate(&patch, 10, &NoProgress).unwrap();
        assert!(small.triangles.len() <= 10, "{}", small.triangles.len());
        let area: f64 = small
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| small.vertices[v as usize]);
                let normal = (b - a).cross(&(c - a));
                assert!(normal.z > 0.0);
                0.5 * normal.norm()
            })
            .sum();
        assert!((area - f64::from(side * side)).abs() < 1e-6, "{area}");
    }

    #[test]
    fn little_is_left_as_it_is() {
        let empty = TriangleMesh::default();
        assert_eq!(decimate(&empty, 0, &NoProgress).unwrap(), empty);
        let tetrahedron = TriangleMesh {
            vertices: vec![
                Point3::new(0.0, 0.0, 0.0),
                Point3::new(1.0, 0.0, 0.0),
                Point3::new(0.0, 1.0, 0.0),
                Point3::new(0.0, 0.0, 1.0),
            ],
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
            colors: Vec::new(),
        };
        let kept = decimate(&tetrahedron, 0, &NoProgress).unwrap();
        assert!(is_closed(&kept) && kept.triangles.len() == 4);
    }
}
