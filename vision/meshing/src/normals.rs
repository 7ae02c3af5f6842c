//! Normals of points, and points that are not of the surface.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use rayon::prelude::*;
use volery_geometry::kd_tree::{KdTree, Neighbor};

use crate::MeshingError;

/// The plane through a point needs two neighbors.
const MIN_NEIGHBORS: usize = 2;

/// Unit normals of the planes through the `num_neighbors` nearest points of each point, turned
/// toward the camera that saw it.
///
/// The normal is the axis of least variance of the neighborhood. Where the neighborhood is a line
/// it is one of those across it.
///
/// * `camera_of`: position of a camera that saw the point of an index.
///
/// # Errors
///
/// [`MeshingError`] for less than three points, numbers that are not finite, and fewer than two
/// neighbors.
///
/// # Source
///
/// Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface Reconstruction from Unorganized
/// Points", SIGGRAPH 1992, section 3.2.
pub fn estimate_normals(
    points: &[Point3<f64>],
    num_neighbors: usize,
    camera_of: impl Fn(usize) -> Point3<f64> + Sync,
) -> Result<Vec<Vector3<f32>>, MeshingError> {
    let tree = tree_of(points, num_neighbors)?;
    let normal = |found: &mut Vec<Neighbor>, index: usize| {
        let point = points[index];
        tree.nearest(&point, num_neighbors + 1, found);
        let axis = least_axis(points, found);
        let to_camera = camera_of(index) - point;
        let normal = if axis.dot(&to_camera) < 0.0 { -axis } else { axis };
        normal.cast()
    };
    Ok((0..points.len()).into_par_iter().map_init(Vec::new, normal).collect())
}

fn least_axis(points: &[Point3<f64>], neighbors: &[Neighbor]) -> Vector3<f64> {
    let at = |neighbor: &Neighbor| points[neighbor.index as usize].coords;
    let mean = neighbors.iter().map(at).sum::<Vector3<f64>>() / neighbors.len() as f64;
    let scatter: Matrix3<f64> = neighbors
        .iter()
        .map(|neighbor| {
            let offset = at(neighbor) - mean;
            offset * offset.transpose()
        })
        .sum();
    let eigen = SymmetricEigen::new(scatter);
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()
}

/// Which points lie as near to their neighbors as points of this cloud do.
///
/// A point is an outlier if its mean distance to its `num_neighbors` nearest is above the mean of
/// all points by more than `max_sigmas` standard deviations.
///
/// # Errors
///
/// As [`estimate_normals`].
///
/// # Source
///
/// Rusu, Marton, Blodow, Dolha and Beetz, "Towards 3D Point Cloud Based Object Maps for Household
/// Environments", RAS 2008.
pub fn statistical_inliers(
    points: &[Point3<f64>],
    num_neighbors: usize,
    max_sigmas: f64,
) -> Result<Vec<bool>, MeshingError> {
    let tree = tree_of(points, num_neighbors)?;
    let mean_distance = |found: &mut Vec<Neighbor>, point: &Point3<f64>| {
        // The first is the point itself, at distance 0.
        tree.nearest(point, num_neighbors + 1, found);
        let sum: f64 = found.iter().map(|neighbor| neighbor.distance_squared.sqrt()).sum();
        sum / num_neighbors.min(points.len() - 1) as f64
    };
    let distances: Vec<f64> = points.par_iter().map_init(Vec::new, mean_distance).collect();
    let n = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / n;
    let variance = distances.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / n;
    let most = mean + max_sigmas * variance.sqrt();
    Ok(distances.into_iter().map(|distance| distance <= most).collect())
}

fn tree_of(points: &[Point3<f64>], num_neighbors: usize) -> Result<KdTree, MeshingError> {
    if points.len() <= MIN_NEIGHBORS {
        return Err(MeshingError::TooFewPoints { got: points.len() });
    }
    if num_neighbors < MIN_NEIGHBORS {
        return Err(MeshingError::Option { name: "num_neighbors", got: num_neighbors as f64 });
    }
    if u32::try_from(points.len()).is_err() {
        return Err(MeshingError::TooManyPoints { got: points.len() });
    }
    if let Some(index) = points.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(MeshingError::NotFinite { index });
    }
    Ok(KdTree::new(points))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::*;

    #[test]
    fn normals_of_a_sphere_point_to_the_camera() {
        let cloud = with_noise(sphere(5000, 1), 0.002, 2);
        let points = positions(&cloud);
        // Cameras outside see the outside, one in the middle the inside.
        for (scale, sign) in [(3.0, 1.0), (0.0, -1.0)] {
            let normals = estimate_normals(&points, 16, |i| points[i] * scale).unwrap();
            let worst = normals
                .iter()
                .zip(&cloud.points)
                .map(|(found, truth)| sign * found.dot(&truth.normal))
                .fold(f32::INFINITY, f32::min);
            assert!(worst > 15_f32.to_radians().cos(), "{worst}");
        }
    }

    /// A plane has an exact answer; so has the side of it on which the camera is.
    #[test]
    fn the_normal_of_a_plane_is_exact() {
        let normal = Vector3::new(1.0, 2.0, -2.0) / 3.0;
        let (u, v) = (Vector3::new(2.0, -1.0, 0.0), Vector3::new(2.0, 4.0, 5.0));
        let points: Vec<Point3<f64>> = (0..100)
            .map(|i| Point3::from(u * f64::from(i % 10) + v * 0.3 * f64::from(i / 10)))
            .collect();
        for side in [-1.0, 1.0] {
            let camera = points[55] + normal * side;
            for found in estimate_normals(&points, 8, |_| camera).unwrap() {
                assert!((found.cast() - normal * side).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn points_far_from_all_others_are_outliers() {
        let mut points = positions(&sphere(2000, 3));
        points.extend([Point3::new(0.0, 0.0, 0.2), Point3::new(3.0, 0.0, 0.0)]);
        let inliers = statistical_inliers(&points, 8, 4.0).unwrap();
        assert_eq!(inliers[2000..], [false, false]);
        let kept = inliers[..2000].iter().filter(|&&inlier| inlier).count();
        assert!(kept > 1990, "{kept}");
    }

    #[test]
    fn bad_input_is_named() {
        let points = vec![Point3::new(0.0, 0.0, 0.0); 2];
        let few = MeshingError::TooFewPoints { got: 2 };
        assert_eq!(estimate_normals(&points, 8, |_| points[0]), Err(few));
        assert_eq!(statistical_inliers(&[], 8, 1.0), Err(MeshingError::TooFewPoints { got: 0 }));
        let nan = [points[0], points[0], Point3::new(f64::NAN, 0.0, 0.0)];
        assert_eq!(
            estimate_normals(&nan, 8, |_| nan[0]),
            Err(MeshingError::NotFinite { index: 2 })
        );
        let line: Vec<_> = (0..9).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        assert!(estimate_normals(&line, 1, |_| line[0]).is_err());
        let normals = estimate_normals(&line, 4, |_| Point3::new(0.0, 0.0, 9.0)).unwrap();
        assert!(normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-6 && n.x.abs() < 1e-6));
    }
}
