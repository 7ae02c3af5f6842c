//! Errors of estimated poses against the truth after a least-squares alignment.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Similarity3, Translation3, UnitQuaternion};
use volery_geometry::similarity_from_points;
use volery_scene::SparseModel;

/// Camera-to-world poses by image name.
pub type Poses = BTreeMap<String, Isometry3<f64>>;

/// Which part of the poses fixes the rotation of the alignment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alignment {
    /// The camera centers (Umeyama).
    Centers,
    /// The orientations: for paths that are short or nearly straight.
    Orientations,
    /// Nothing is moved: both are in one frame already.
    None,
}

/// Figures over the images that both have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evaluation {
    /// Images of the truth.
    pub num_images: usize,
    /// Those with an estimate.
    pub num_registered: usize,
    /// Root mean square of the position errors, in units of the truth.
    pub ate_rmse: f64,
    /// Median of the position errors.
    pub ate_median: f64,
    /// Greatest position error.
    pub ate_max: f64,
    /// Median of the rotation errors, degrees.
    pub rotation_median_deg: f64,
    /// Greatest rotation error, degrees.
    pub rotation_max_deg: f64,
    /// Scale of the alignment.
    pub scale: f64,
}

/// Camera-to-world poses of a model.
pub fn poses_of(model: &SparseModel) -> Poses {
    model.images.values().map(|i| (i.name.clone(), i.cam_from_world.inverse())).collect()
}

/// Compares `estimate` with `truth`; `None` with fewer than three common images or without an
/// alignment.
pub fn evaluate(estimate: &Poses, truth: &Poses, alignment: Alignment) -> Option<Evaluation> {
    let common: Vec<_> =
        truth.iter().filter_map(|(name, t)| estimate.get(name).map(|e| (*e, *t))).collect();
    if common.is_empty() {
        return None;
    }
    let truth_from_estimate = match alignment {
        Alignment::Centers => {
            let (source, target): (Vec<_>, Vec<_>) =
                common.iter().map(|(e, t)| (center(e), center(t))).unzip();
            similarity_from_points(&source, &target).ok()?
        }
        Alignment::Orientations => similarity_from_orientations(&common)?,
        Alignment::None => Similarity3::identity(),
    };
    let position: Vec<f64> =
        common.iter().map(|(e, t)| (truth_from_estimate * center(e) - center(t)).norm()).collect();
    let turn = truth_from_estimate.isometry.rotation;
    let rotation: Vec<f64> = common
        .iter()
        .map(|(e, t)| (turn * e.rotation).angle_to(&t.rotation).to_degrees())
        .collect();
    let n = common.len() as f64;
    Some(Evaluation {
        num_images: truth.len(),
        num_registered: common.len(),
        ate_rmse: (position.iter().map(|p| p * p).sum::<f64>() / n).sqrt(),
        ate_median: median(&position),
        ate_max: position.iter().copied().fold(0.0, f64::max),
        rotation_median_deg: median(&rotation),
        rotation_max_deg: rotation.iter().copied().fold(0.0, f64::max),
        scale: truth_from_estimate.scaling(),
    })
}

impl std::fmt::Display for Evaluation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}/{} images, ATE {:.4} (max {:.4}), rotation {:.3} deg (max {:.3})",
            self.num_registered,
            self.num_images,
            self.ate_rmse,
            self.ate_max,
            self.rotation_median_deg,
            self.rotation_max_deg
        )
    }
}

fn center(world_from_cam: &Isometry3<f64>) -> Point3<f64> {
    Point3::from(world_from_cam.translation.vector)
}

/// Rotation by the mean of the orientations, then scale and translation by the centers.
fn similarity_from_orientations(
    common: &[(Isometry3<f64>, Isometry3<f64>)],
) -> Option<Similarity3<f64>> {
    let mut sum = Matrix3::zeros();
    for (e, t) in common {
        let (e, t) = (e.rotation.to_rotation_matrix(), t.rotation.to_rotation_matrix());
        sum += t.matrix() * e.matrix().transpose();
    }
    let svd = sum.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let s = Vector3::new(1.0, 1.0, (u.determinant() * v_t.determinant()).signum());
    let matrix = u * Matrix3::from_diagonal(&s) * v_t;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let n = common.len() as f64;
    let mean_e = common.iter().map(|(e, _)| e.translation.vector).sum::<Vector3<f64>>() / n;
    let mean_t = common.iter().map(|(_, t)| t.translation.vector).sum::<Vector3<f64>>() / n;
    let (mut dot, mut square) = (0.0, 0.0);
    for (e, t) in common {
        let turned = rotation * (e.translation.vector - mean_e);
        dot += turned.dot(&(t.translation.vector - mean_t));
        square += turned.norm_squared();
    }
    let scale = dot / square;
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let translation = Translation3::from(mean_t - scale * (rotation * mean_e));
    Some(Similarity3::from_parts(translation, rotation, scale))
}

/// Middle value; the mean of the two middle ones of an even number. 0 of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    if n == 0 { 0.0 } else { (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk() -> Poses {
        (0..12)
            .map(|i| {
                let s = f64::from(i);
                let center = Vector3::new(0.5 * s, (0.7 * s).sin(), 0.1 * (1.3 * s).cos());
                let turn = Vector3::new(0.1 * s, -0.2, 0.3 * s);
                (format!("{i:02}.jpg"), Isometry3::new(center, turn))
            })
            .collect()
    }

    fn moved(poses: &Poses, by: &Similarity3<f64>) -> Poses {
        let turn = by.isometry.rotation;
        let place = |p: &Isometry3<f64>| {
            Isometry3::from_parts(Translation3::from((by * center(p)).coords), turn * p.rotation)
        };
        poses.iter().map(|(name, p)| (name.clone(), place(p))).collect()
    }

    #[test]
    fn the_gauge_is_free_and_errors_are_seen() {
        let truth = walk();
        let gauge =
            Similarity3::new(Vector3::new(3.0, -1.0, 2.0), Vector3::new(0.2, 1.0, -0.4), 0.3);
        let mut estimate = moved(&truth, &gauge);
        for alignment in [Alignment::Centers, Alignment::Orientations] {
            let found = evaluate(&estimate, &truth, alignment).unwrap();
            assert!(found.ate_max < 1e-12 && found.rotation_max_deg < 1e-5, "{found}");
            assert!((found.scale * 0.3 - 1.0).abs() < 1e-12);
        }
        let turned = estimate.get_mut("05.jpg").unwrap();
        turned.rotation *= UnitQuaternion::from_euler_angles(0.1, 0.0, 0.0);
        let found = evaluate(&estimate, &truth, Alignment::Centers).unwrap();
        assert!((found.rotation_max_deg - 0.1_f64.to_degrees()).abs() < 1e-9);
        assert!(found.rotation_median_deg < 1e-5);
        estimate.remove("00.jpg");
        assert_eq!(evaluate(&estimate, &truth, Alignment::Centers).unwrap().num_registered, 11);
        assert_eq!(evaluate(&estimate, &truth, Alignment::Centers).unwrap().num_images, 12);
    }

    /// A wrong center of known size in one of n poses, seen without alignment: rmse = d / √n.
    #[test]
    fn the_root_mean_square_is_one() {
        let truth = walk();
        let mut estimate = truth.clone();
        estimate.get_mut("03.jpg").unwrap().translation.vector.x += 0.6;
        let found = evaluate(&estimate, &truth, Alignment::None).unwrap();
        assert!((found.ate_rmse - 0.6 / 12.0_f64.sqrt()).abs() < 1e-12);
        assert!((found.ate_max - 0.6).abs() < 1e-12);
        assert_eq!(found.ate_median, 0.0);
    }

    #[test]
    fn a_straight_path_needs_orientations() {
        let truth: Poses = walk()
            .into_iter()
            .map(|(name, p)| {
                let x = Vector3::x() * p.translation.vector.x;
                (name, Isometry3::from_parts(x.into(), p.rotation))
            })
            .collect();
        assert!(evaluate(&truth, &truth, Alignment::Centers).is_none());
        assert!(evaluate(&truth, &truth, Alignment::Orientations).unwrap().ate_max < 1e-12);
    }
}
