//! Fewer triangles by quadric edge collapse.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

use nalgebra::{Matrix3, Point3, Vector3};
use volery_scene::{Cancelled, Progress, TriangleMesh};

/// Planes through open edges count so much more than those of triangles, so that borders stay.
const BORDER_WEIGHT: f64 = 10.0;
/// A triangle may turn at most so far in one collapse: the cosine.
const MIN_NORMAL_COSINE: f64 = 0.3;
/// Curvature below which a quadric has no point of its own: relative to its trace.
const MIN_RELATIVE_CURVATURE: f64 = 1e-3;
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
    let mut num_collapses = 0;
    while work.num_triangles > num_triangles {
        let Some(candidate) = work.queue.pop() else { break };
        if num_collapses % CHECK_INTERVAL == 0 {
            progress.check()?;
        }
        num_collapses += 1;
        work.try_collapse(&candidate);
    }
    Ok(work.into_mesh())
}

/// The sum of squared distances to weighted planes, `xᵀ A x + 2 bᵀ x + c`, about a local origin.
#[derive(Debug, Clone, Copy)]
struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    c: f64,
}

impl Quadric {
    const ZERO: Self = Self {
        a: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        b: Vector3::new(0.0, 0.0, 0.0),
        c: 0.0,
    };

    /// Of the plane through `point` with a unit `normal`.
    fn of_plane(point: Vector3<f64>, normal: Vector3<f64>, weight: f64) -> Self {
        let offset = -normal.dot(&point);
        Self {
            a: normal * normal.transpose() * weight,
            b: normal * (offset * weight),
            c: offset * offset * weight,
        }
    }

    fn add(&mut self, other: &Self) {
        self.a += other.a;
        self.b += other.b;
        self.c += other.c;
    }

    fn at(&self, x: Vector3<f64>) -> f64 {
        (x.dot(&(self.a * x)) + 2.0 * self.b.dot(&x) + self.c).max(0.0)
    }

    /// The point nearest to all planes; `None` where they leave it free.
    fn minimum(&self) -> Option<Vector3<f64>> {
        let eigen = self.a.symmetric_eigen();
        let least = eigen.eigenvalues.min();
        if least <= MIN_RELATIVE_CURVATURE * self.a.trace() {
            return None;
        }
        self.a.cholesky().map(|factor| -factor.solve(&self.b))
    }
}

/// An edge that may go, as it was when its cost was found.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    cost: f64,
    edge: [u32; 2],
    versions: [u32; 2],
    target: Vector3<f64>,
}

impl Ord for Candidate {
    /// The cheapest is the greatest; ties by number, so that the order is always the same.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.edge.cmp(&self.edge))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

struct Work<'a> {
    mesh: &'a TriangleMesh,
    origin: Point3<f64>,
    positions: Vec<Vector3<f64>>,
    quadrics: Vec<Quadric>,
    /// Grows when a vertex moves: older candidates are void.
    versions: Vec<u32>,
    /// Gone triangles have `[u32::MAX; 3]`.
    triangles: Vec<[u32; 3]>,
    /// Per vertex, its triangles.
    around: Vec<Vec<u32>>,
    num_triangles: usize,
    queue: BinaryHeap<Candidate>,
}

const GONE: [u32; 3] = [u32::MAX; 3];

impl<'a> Work<'a> {
    fn new(mesh: &'a TriangleMesh) -> Self {
        let origin = mesh.vertices.first().copied().unwrap_or_default();
        let positions: Vec<_> = mesh.vertices.iter().map(|v| v - origin).collect();
        let mut around = vec![Vec::new(); positions.len()];
        for (index, triangle) in mesh.triangles.iter().enumerate() {
            triangle.iter().for_each(|&v| around[v as usize].push(index as u32));
        }
        let mut work = Self {
            mesh,
            origin,
            quadrics: vec![Quadric::ZERO; positions.len()],
            versions: vec![0; positions.len()],
            positions,
            triangles: mesh.triangles.clone(),
            around,
            num_triangles: mesh.triangles.len(),
            queue: BinaryHeap::new(),
        };
        work.sum_quadrics();
        work
    }

    fn sum_quadrics(&mut self) {
        let mut uses: HashMap<[u32; 2], u32> = HashMap::with_capacity(2 * self.triangles.len());
        for &triangle in &self.mesh.triangles {
            let normal = self.area_vector(triangle);
            let area = 0.5 * normal.norm();
            if let Some(unit) = normal.try_normalize(0.0) {
                let point = self.positions[triangle[0] as usize];
                let quadric = Quadric::of_plane(point, unit, area / 3.0);
                triangle.iter().for_each(|&v| self.quadrics[v as usize].add(&quadric));
            }
            for edge in edges(triangle) {
                *uses.entry(edge).or_default() += 1;
            }
        }
        let mut all: Vec<[u32; 2]> = uses.keys().copied().collect();
        all.sort_unstable();
        for &triangle in &self.mesh.triangles {
            for edge in edges(triangle).into_iter().filter(|edge| uses[edge] == 1) {
                self.hold_border(edge, triangle);
            }
        }
        self.queue = all.into_iter().map(|edge| self.candidate(edge)).collect();
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

    fn candidate(&self, edge: [u32; 2]) -> Candidate {
        let [a, b] = edge.map(|v| v as usize);
        let mut quadric = self.quadrics[a];
        quadric.add(&self.quadrics[b]);
        let (pa, pb) = (self.positions[a], self.positions[b]);
        let middle = 0.5 * (pa + pb);
        let length = (pb - pa).norm();
        // A minimum far from the edge is one of nearly parallel planes.
        let own = quadric.minimum().filter(|m| (m - middle).norm() <= 2.0 * length);
        let target = own.unwrap_or_else(|| {
            let best = |x: Vector3<f64>, y: Vector3<f64>| {
                if quadric.at(y) < quadric.at(x) { y } else { x }
            };
            best(best(middle, pa), pb)
        });
        // Of edges that cost nothing the short ones go first.
        let cost = quadric.at(target) + 1e-12 * length * length;
        Candidate { cost, edge, versions: [self.versions[a], self.versions[b]], target }
    }

    fn try_collapse(&mut self, candidate: &Candidate) {
        let [a, b] = candidate.edge;
        let versions = [self.versions[a as usize], self.versions[b as usize]];
        if versions != candidate.versions || !self.keeps_shape(a, b) {
            return;
        }
        if self.folds(a, b, candidate.target) || self.folds(b, a, candidate.target) {
            return;
        }
        self.positions[a as usize] = candidate.target;
        let quadric = self.quadrics[b as usize];
        self.quadrics[a as usize].add(&quadric);
        for index in std::mem::take(&mut self.around[b as usize]) {
            let triangle = self.triangles[index as usize];
            if triangle.contains(&a) {
                self.triangles[index as usize] = GONE;
                self.num_triangles -= 1;
                for v in triangle {
                    self.around[v as usize].retain(|&t| t != index);
                }
            } else {
                self.triangles[index as usize] = triangle.map(|v| if v == b { a } else { v });
                self.around[a as usize].push(index);
            }
        }
        self.versions[a as usize] += 1;
        self.versions[b as usize] = u32::MAX;
        for neighbor in self.neighbors(a) {
            let candidate = self.candidate([a.min(neighbor), a.max(neighbor)]);
            self.queue.push(candidate);
        }
    }

    /// Other corners of a vertex' triangles, sorted.
    fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let triangles = self.around[vertex as usize].iter();
        let mut found: Vec<u32> =
            triangles.flat_map(|&t| self.triangles[t as usize]).filter(|&v| v != vertex).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// The link condition: the ends share no neighbors but those across their common triangles,
    /// an inner edge does not join two borders, and a tetrahedron stays one.
    fn keeps_shape(&self, a: u32, b: u32) -> bool {
        let shared = self.around[a as usize]
            .iter()
            .filter(|&&t| self.triangles[t as usize].contains(&b))
            .count();
        let (of_a, of_b) = (self.neighbors(a), self.neighbors(b));
        let common = of_a.iter().filter(|v| of_b.binary_search(v).is_ok()).count();
        let on_border =
            |v: u32, neighbors: &[u32]| neighbors.len() != self.around[v as usize].len();
        let joins_borders = shared == 2 && on_border(a, &of_a) && on_border(b, &of_b);
        (1..=2).contains(&shared)
            && common == shared
            && !joins_borders
            && of_a.len() + of_b.len() - common - 2 >= 3
    }

    /// Whether a triangle of `vertex` without `other` would turn too far.
    fn folds(&self, vertex: u32, other: u32, target: Vector3<f64>) -> bool {
        self.around[vertex as usize].iter().any(|&t| {
            let triangle = self.triangles[t as usize];
            if triangle.contains(&other) {
                return false;
            }
            let at = |v: u32| if v == vertex { target } else { self.positions[v as usize] };
            let [x, y, z] = triangle.map(at);
            let (before, after) = (self.area_vector(triangle), (y - x).cross(&(z - x)));
            // A triangle without area may turn as it likes, but none may lose its area.
            after.norm() <= 1e-3 * before.norm()
                || before.dot(&after) < MIN_NORMAL_COSINE * before.norm() * after.norm()
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

fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a.min(b), a.max(b)], [b.min(c), b.max(c)], [c.min(a), c.max(a)]]
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
