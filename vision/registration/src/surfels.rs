//! Zones as evenly spread pieces of surface.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;
use volery_geometry::KdTree;
use volery_scene::PointCloud;

use crate::RegistrationError;

/// Fewer pieces of surface hold no zone.
const MIN_SURFELS: usize = 100;
/// Bits of a cell's number per axis, and the largest number that has neighbors on both sides.
const AXIS_BITS: u32 = 21;
const MAX_CELL: f64 = ((1 << AXIS_BITS) - 2) as f64;
/// Added to the variances of a neighborhood, squared cells: the normals that came with the points
/// decide where it is a line or a single point.
const LEAST_VARIANCE: f64 = 1e-4;

/// A piece of surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surfel {
    /// Mean of its points, moved along the normal onto the plane of those around it: with one or
    /// two points to a cell that halves the error of a registration.
    pub position: Point3<f64>,
    /// Unit, into the free space.
    pub normal: Vector3<f64>,
}

/// The surface of a zone, one piece per cell of a grid.
#[derive(Debug, Clone)]
pub struct Surfels {
    pieces: Vec<Surfel>,
    tree: KdTree,
    cell: f64,
}

impl Surfels {
    /// Means of the points in cubes with edges of `cell`, with the normals of the planes through
    /// the points of the 27 cubes around each.
    ///
    /// # Errors
    ///
    /// [`RegistrationError`] for numbers that are not finite, a cell that is not positive or too
    /// small for the extent, and for less than a hundred cells.
    pub fn new(cloud: &PointCloud, cell: f64) -> Result<Self, RegistrationError> {
        let is_finite = |v: &[f32]| v.iter().all(|v| v.is_finite());
        let not_finite = cloud.points.iter().position(|p| {
            !is_finite(p.position.coords.as_slice()) || !is_finite(p.normal.as_slice())
        });
        if let Some(index) = not_finite {
            return Err(RegistrationError::NotFinite { index });
        }
        let points: Vec<Surfel> = cloud
            .points
            .iter()
            .map(|p| Surfel { position: p.position.cast(), normal: p.normal.cast() })
            .collect();
        let cells = Cells::new(&points, cell)?;
        let pieces = cells.planes(&points);
        if pieces.len() < MIN_SURFELS {
            return Err(RegistrationError::TooFewPoints { got: pieces.len(), needed: MIN_SURFELS });
        }
        Ok(Self::from_pieces(pieces, cell))
    }

    fn from_pieces(pieces: Vec<Surfel>, cell: f64) -> Self {
        let positions: Vec<Point3<f64>> = pieces.iter().map(|s| s.position).collect();
        Self { pieces, tree: KdTree::new(&positions), cell }
    }

    /// One piece per cube with edges of `cell`: the one nearest to the mean of its cube.
    ///
    /// # Errors
    ///
    /// [`RegistrationError::Option`] for a cell that is not positive.
    pub fn thinned(&self, cell: f64) -> Result<Self, RegistrationError> {
        let cells = Cells::new(&self.pieces, cell)?;
        let nearest = |members: &[(u64, u32)]| {
            let at = |member: &(u64, u32)| self.pieces[member.1 as usize];
            let sum: Vector3<f64> = members.iter().map(|m| at(m).position.coords).sum();
            let mean = Point3::from(sum / members.len() as f64);
            let off = |m: &&(u64, u32)| (at(m).position - mean).norm_squared();
            members.iter().min_by(|a, b| off(a).total_cmp(&off(b))).map(at)
        };
        let pieces = cells.members.chunk_by(|a, b| a.0 == b.0).filter_map(nearest).collect();
        Ok(Self::from_pieces(pieces, cell))
    }

    /// The pieces, in the order of the grid: every n-th is a fair sample.
    pub fn pieces(&self) -> &[Surfel] {
        &self.pieces
    }

    /// Their positions in a tree.
    pub fn tree(&self) -> &KdTree {
        &self.tree
    }

    /// Edge of the cubes.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Mean position.
    pub fn center(&self) -> Point3<f64> {
        center(self.pieces.iter().map(|s| s.position))
    }
}

/// The mean of some points; the origin for none.
pub(crate) fn center(points: impl ExactSizeIterator<Item = Point3<f64>>) -> Point3<f64> {
    let n = points.len().max(1) as f64;
    Point3::from(points.map(|p| p.coords).sum::<Vector3<f64>>() / n)
}

/// Points by the cubes they fall into.
struct Cells {
    /// Cube and index of each point, sorted.
    members: Vec<(u64, u32)>,
    cell: f64,
}

impl Cells {
    fn new(points: &[Surfel], cell: f64) -> Result<Self, RegistrationError> {
        let mut low = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut high = -low;
        for point in points {
            low = low.inf(&point.position);
            high = high.sup(&point.position);
        }
        let fits = points.is_empty() || (high - low).max() / cell < MAX_CELL;
        if !(cell > 0.0 && cell.is_finite() && fits) {
            return Err(RegistrationError::Option { name: "cell", got: cell });
        }
        let key = |p: &Point3<f64>| {
            // From 1, so that every cube has a lower neighbor.
            let axis = |k: usize| ((p[k] - low[k]) / cell) as u64 + 1;
            axis(0) << (2 * AXIS_BITS) | axis(1) << AXIS_BITS | axis(2)
        };
        let mut members: Vec<(u64, u32)> =
            points.iter().enumerate().map(|(i, s)| (key(&s.position), i as u32)).collect();
        members.sort_unstable();
        Ok(Self { members, cell })
    }

    fn planes(&self, points: &[Surfel]) -> Vec<Surfel> {
        let origin = points.first().map_or(Point3::origin(), |s| s.position);
        let (keys, sums): (Vec<u64>, Vec<Moments>) = self
            .members
            .chunk_by(|a, b| a.0 == b.0)
            .map(|members| {
                let mut sum = Moments::default();
                members.iter().for_each(|m| sum.add(&points[m.1 as usize], &origin));
                (members[0].0, sum)
            })
            .unzip();
        let around = around(&keys);
        let least = LEAST_VARIANCE * self.cell * self.cell;
        let plane = |(own, ranges): (&Moments, &[(u32, u32); 9])| {
            let mut sum = Moments::default();
            for &(start, end) in ranges {
                sums[start as usize..end as usize].iter().for_each(|s| sum.merge(s));
            }
            let normal = sum.normal(&own.normal, least)?;
            let (mean, around) = (own.sum / own.count, sum.sum / sum.count);
            let position = origin + mean - normal * normal.dot(&(mean - around));
            Some(Surfel { position, normal })
        };
        sums.par_iter().zip(&around).map(plane).collect::<Vec<_>>().into_iter().flatten().collect()
    }
}

/// For each of the sorted cubes, the ranges of those in the nine columns of three around it.
fn around(keys: &[u64]) -> Vec<[(u32, u32); 9]> {
    let mut cursors = [0; 9];
    let step = |n: u64, axis: u32| n << (axis * AXIS_BITS);
    keys.iter()
        .map(|&key| {
            std::array::from_fn(|column| {
                let (dx, dy) = (column as u64 / 3, column as u64 % 3);
                // The column starts one cube lower on every axis.
                let first = key + step(dx, 2) + step(dy, 1) - step(1, 2) - step(1, 1) - 1;
                let cursor = &mut cursors[column];
                while keys.get(*cursor).is_some_and(|&k| k < first) {
                    *cursor += 1;
                }
                let num = keys[*cursor..].iter().take_while(|&&k| k <= first + 2).count();
                (*cursor as u32, (*cursor + num) as u32)
            })
        })
        .collect()
}

/// Sums over points, from a common origin.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: Vector3<f64>,
    outer: Matrix3<f64>,
    normal: Vector3<f64>,
}

impl Moments {
    fn add(&mut self, point: &Surfel, origin: &Point3<f64>) {
        let p = point.position - origin;
        self.count += 1.0;
        self.sum += p;
        self.outer += p * p.transpose();
        self.normal += point.normal;
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.outer += other.outer;
    }

    /// The axis of least variance, by inverse iteration from the mean of the given normals, so
    /// that it keeps their side.
    fn normal(&self, start: &Vector3<f64>, least: f64) -> Option<Vector3<f64>> {
        let mean = self.sum / self.count;
        let covariance =
            self.outer / self.count - mean * mean.transpose() + Matrix3::identity() * least;
        let columns = [covariance.column(0), covariance.column(1), covariance.column(2)];
        let rows = [
            columns[1].cross(&columns[2]),
            columns[2].cross(&columns[0]),
            columns[0].cross(&columns[1]),
        ];
        let mut normal = start.try_normalize(1e-9)?;
        for _ in 0..3 {
            // The inverse of a symmetric matrix, but for its determinant.
            let next = Vector3::from_fn(|k, _| rows[k].dot(&normal));
            normal = next.try_normalize(f64::MIN_POSITIVE)?;
        }
        Some(normal)
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;
    use volery_scene::OrientedPoint;

    use super::*;

    fn cloud(points: impl Iterator<Item = (Point3<f64>, Vector3<f64>)>) -> PointCloud {
        let points = points.map(|(p, n)| OrientedPoint {
            position: p.cast(),
            normal: n.cast(),
            color: [0; 3],
            confidence: 255,
            inferred: false,
        });
        PointCloud { points: points.collect() }
    }

    /// Pieces of a sphere with noise lie on it; their normals are better than those given and on
    /// their side.
    #[test]
    fn planes_of_a_sphere_face_as_its_points_do() {
        let mut rng = Rng::new(1);
        for side in [-1.0, 1.0] {
            let sphere: Vec<_> = (0..40_000)
                .map(|_| {
                    let n = rng.normal3().normalize();
                    let p = Point3::from(n * 2.0) + rng.normal3() * 0.003;
                    (p, (n * side + rng.normal3() * 0.1).normalize())
                })
                .collect();
            let surfels = Surfels::new(&cloud(sphere.into_iter()), 0.1).unwrap();
            // Area by area of a cell: at least one cell per face-on square.
            assert!(surfels.pieces().len() > 5000);
            for piece in surfels.pieces() {
                let out = piece.position.coords.normalize();
                assert!((piece.position.coords.norm() - 2.0).abs() < 0.015);
                assert!(piece.normal.dot(&out) * side > 6_f64.to_radians().cos());
            }
        }
    }

    /// The neighborhood found by walking is the one found by looking at all cubes.
    #[test]
    fn neighbors_are_the_27_cubes() {
        let mut rng = Rng::new(2);
        let points: Vec<Surfel> = (0..400)
            .map(|_| Surfel { position: Point3::from(rng.normal3()), normal: Vector3::z() })
            .collect();
        let cells = Cells::new(&points, 0.35).unwrap();
        let keys: Vec<u64> = cells.members.chunk_by(|a, b| a.0 == b.0).map(|m| m[0].0).collect();
        let axes = |key: u64| [key >> 42, key >> 21 & 0x1f_ffff, key & 0x1f_ffff];
        for (key, ranges) in keys.iter().zip(around(&keys)) {
            let mut found: Vec<u64> =
                ranges.iter().flat_map(|&(a, b)| &keys[a as usize..b as usize]).copied().collect();
            found.sort_unstable();
            let is_near =
                |k: &&u64| axes(**k).iter().zip(axes(*key)).all(|(a, b)| a.abs_diff(b) <= 1);
            let plain: Vec<u64> = keys.iter().filter(is_near).copied().collect();
            assert_eq!(found, plain);
        }
    }

    #[test]
    fn thinning_keeps_pieces_of_the_zone() {
        let mut rng = Rng::new(3);
        let plane = (0..20_000)
            .map(|_| (Point3::new(rng.range(0.0, 4.0), rng.range(0.0, 4.0), 1.0), Vector3::z()));
        let surfels = Surfels::new(&cloud(plane), 0.1).unwrap();
        let thin = surfels.thinned(0.4).unwrap();
        assert!((100..=121).contains(&thin.pieces().len()), "{}", thin.pieces().len());
        assert!(thin.pieces().iter().all(|piece| surfels.pieces().contains(piece)));
        assert!(surfels.thinned(0.0).is_err());
    }

    #[test]
    fn bad_input_is_named() {
        let few = cloud((0..50).map(|i| (Point3::new(f64::from(i), 0.0, 0.0), Vector3::z())));
        let error = Surfels::new(&few, 0.1).unwrap_err();
        assert_eq!(error, RegistrationError::TooFewPoints { got: 50, needed: MIN_SURFELS });
        assert!(Surfels::new(&PointCloud::default(), 0.1).is_err());
        for cell in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9] {
            let error = Surfels::new(&few, cell).unwrap_err();
            assert!(matches!(error, RegistrationError::Option { name: "cell", .. }));
        }
        let nan = cloud((0..9).map(|_| (Point3::new(f64::NAN, 0.0, 0.0), Vector3::z())));
        assert_eq!(Surfels::new(&nan, 0.1).unwrap_err(), RegistrationError::NotFinite { index: 0 });
    }
}
