//! Delaunay triangulation of points on a grid.

/// The triangulation's frame reaches this far; points lie well inside.
const FRAME: i32 = 1 << 24;
/// Largest coordinate of a point, either sign.
pub(crate) const MAX_COORDINATE: i32 = 1 << 20;
/// Neighbor of an edge of the frame.
const NONE: u32 = u32::MAX;

type Point = [i32; 2];

#[derive(Debug, Clone, Copy)]
struct Triangle {
    /// Counterclockwise in axes x right, y up.
    vertices: [u32; 3],
    /// The triangle across the edge that lies opposite to each vertex.
    neighbors: [u32; 3],
    alive: bool,
}

/// Delaunay triangulation: no point lies inside of the circumcircle of a triangle. Equal points
/// count once. The arithmetic is exact.
///
/// * Returns indices of points, three per triangle, in one orientation.
///
/// # Panics
///
/// If a coordinate exceeds [`MAX_COORDINATE`].
///
/// # Source
///
/// Bowyer, "Computing Dirichlet tessellations", and Watson, "Computing the n-dimensional Delaunay
/// tessellation", both The Computer Journal 1981; points are found by walking.
pub(crate) fn delaunay(points: &[Point]) -> Vec<[u32; 3]> {
    let inside = |v: i32| v.abs() <= MAX_COORDINATE;
    assert!(points.iter().all(|p| inside(p[0]) && inside(p[1])), "a point is outside of the frame");
    let mut all = points.to_vec();
    all.extend([[-FRAME, -FRAME], [FRAME, -FRAME], [0, FRAME]]);
    let n = points.len() as u32;
    let frame = Triangle { vertices: [n, n + 1, n + 2], neighbors: [NONE; 3], alive: true };
    let mut mesh = Mesh { points: all, triangles: vec![frame], last: 0 };
    for index in near_each_other(points) {
        mesh.insert(index);
    }
    let whole = |t: &&Triangle| t.alive && t.vertices.iter().all(|&v| v < n);
    mesh.triangles.iter().filter(whole).map(|t| t.vertices).collect()
}

/// An order in which neighbors follow each other: bands of rows, run through in turns.
fn near_each_other(points: &[Point]) -> Vec<u32> {
    let range = |axis: usize| {
        let values = points.iter().map(move |p| p[axis]);
        (values.clone().min().unwrap_or(0), values.max().unwrap_or(0))
    };
    let (low, high) = range(1);
    let num_bands = ((points.len() as f64 / 4.0).sqrt() as i32).max(1);
    let height = (high - low) / num_bands + 1;
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_key(|&index| {
        let [x, y] = points[index as usize];
        let band = (y - low) / height;
        (band, if band % 2 == 0 { x } else { -x }, y, index)
    });
    order
}

struct Mesh {
    points: Vec<Point>,
    triangles: Vec<Triangle>,
    /// Where the last point went in.
    last: u32,
}

impl Mesh {
    fn insert(&mut self, index: u32) {
        let p = self.points[index as usize];
        let home = self.locate(p);
        let corners = self.triangles[home as usize].vertices;
        if corners.iter().any(|&v| self.points[v as usize] == p) {
            return;
        }
        // The cavity: all triangles whose circumcircle holds the point.
        let mut cavity = vec![home];
        self.triangles[home as usize].alive = false;
        let mut rim = Vec::new();
        let mut next = 0;
        while next < cavity.len() {
            let triangle = self.triangles[cavity[next] as usize];
            next += 1;
            for side in 0..3 {
                let across = triangle.neighbors[side];
                let edge = [triangle.vertices[(side + 1) % 3], triangle.vertices[(side + 2) % 3]];
                if across != NONE && !self.triangles[across as usize].alive {
                    continue;
                }
                if across != NONE && self.circle_holds(across, p) {
                    self.triangles[across as usize].alive = false;
                    cavity.push(across);
                } else {
                    rim.push((edge, across));
                }
            }
        }
        self.fill(index, &rim, &cavity);
    }

    /// Joins the point to the edges of the rim, in the places of the cavity's triangles first.
    fn fill(&mut self, index: u32, rim: &[([u32; 2], u32)], cavity: &[u32]) {
        let places: Vec<u32> = (0..rim.len())
            .map(|k| {
                cavity.get(k).copied().unwrap_or((self.triangles.len() + k - cavity.len()) as u32)
            })
            .collect();
        for (&(edge, across), &place) in rim.iter().zip(&places) {
            let starting_at = |vertex: u32| {
                let k = rim.iter().position(|(other, _)| other[0] == vertex);
                places[k.expect("the rim is closed")]
            };
            let ending_at = |vertex: u32| {
                let k = rim.iter().position(|(other, _)| other[1] == vertex);
                places[k.expect("the rim is closed")]
            };
            let triangle = Triangle {
                vertices: [index, edge[0], edge[1]],
                neighbors: [across, starting_at(edge[1]), ending_at(edge[0])],
                alive: true,
            };
            match self.triangles.get_mut(place as usize) {
                Some(slot) => *slot = triangle,
                None => self.triangles.push(triangle),
            }
            if across != NONE {
                let outside = &mut self.triangles[across as usize];
                let side = (0..3).find(|&s| !edge.contains(&outside.vertices[s]));
                outside.neighbors[side.expect("two vertices are shared")] = place;
            }
        }
        self.last = places[0];
    }

    /// The triangle that holds `p`, on its rim or inside, by walking towards it.
    fn locate(&self, p: Point) -> u32 {
        let mut at = self.last;
        loop {
            let triangle = &self.triangles[at as usize];
            let beyond = (0..3).find(|&side| {
                let [a, b] = [(side + 1) % 3, (side + 2) % 3]
                    .map(|k| self.points[triangle.vertices[k] as usize]);
                turn(a, b, p) < 0
            });
            match beyond {
                Some(side) => at = triangle.neighbors[side],
                None => return at,
            }
        }
    }

    fn circle_holds(&self, triangle: u32, p: Point) -> bool {
        let [a, b, c] = self.triangles[triangle as usize].vertices.map(|v| self.points[v as usize]);
        let row = |q: Point| {
            let [x, y] = [0, 1].map(|k| i128::from(q[k]) - i128::from(p[k]));
            [x, y, x * x + y * y]
        };
        let (a, b, c) = (row(a), row(b), row(c));
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
            > 0
    }
}

/// Twice the area of the triangle, positive if counterclockwise.
fn turn(a: Point, b: Point, c: Point) -> i64 {
    let d = |p: Point, q: Point, k: usize| i64::from(q[k]) - i64::from(p[k]);
    d(a, b, 0) * d(a, c, 1) - d(a, b, 1) * d(a, c, 0)
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    fn holds(points: &[Point], triangle: [u32; 3], p: Point) -> bool {
        let vertices = [0, 1, 2];
        let corners = triangle.map(|v| points[v as usize]).to_vec();
        let alive = Triangle { vertices, neighbors: [NONE; 3], alive: true };
        Mesh { points: corners, triangles: vec![alive], last: 0 }.circle_holds(0, p)
    }

    #[test]
    fn circumcircles_are_empty() {
        let mut rng = Rng::new(3);
        // A coarse grid: many points on one line or circle, some equal.
        for spread in [12, 40, 5000] {
            let points: Vec<Point> = (0..150)
                .map(|_| [rng.index(spread) as i32 - 5, rng.index(spread) as i32 - 9])
                .collect();
            let triangles = delaunay(&points);
            assert!(triangles.len() > 50);
            for &triangle in &triangles {
                let [a, b, c] = triangle.map(|v| points[v as usize]);
                assert!(turn(a, b, c) > 0);
                assert!(points.iter().all(|&p| !holds(&points, triangle, p)));
            }
        }
    }

    /// The triangles cover a full grid exactly once.
    #[test]
    fn areas_add_up() {
        let points: Vec<Point> = (0..400).map(|k| [16 * (k % 20), 16 * (k / 20)]).collect();
        let twice_area: i64 = delaunay(&points)
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| points[v as usize]);
                turn(a, b, c)
            })
            .sum();
        assert_eq!(twice_area, 2 * (19 * 16) * (19 * 16));
    }

    #[test]
    fn few_or_collinear_points_have_no_triangle() {
        assert!(delaunay(&[]).is_empty());
        assert!(delaunay(&[[3, 4]; 5]).is_empty());
        assert!(delaunay(&[[0, 0], [5, 5], [9, 9], [2, 2]]).is_empty());
    }
}
