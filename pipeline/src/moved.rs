//! A map that was moved keeps its localization index; priors and answers are moved instead.

use nalgebra::{
    Isometry3, Matrix6, Quaternion, Similarity3, Translation3, UnitQuaternion, Vector3,
};
use serde::{Deserialize, Serialize};
use volery_localization::{LocalizationAnswer, LocalizationPrior, PoseEstimate, Status};

use crate::heading::NorthInMap;

/// Below this tilt a similarity only turns about z, radians.
const MAX_TILT: f64 = 0.02;

/// `x_in_map = scale * rotation * x_in_index + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MovedBy {
    /// Unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// In the map.
    pub translation: [f64; 3],
    /// Positive.
    pub scale: f64,
}

impl From<&Similarity3<f64>> for MovedBy {
    fn from(similarity: &Similarity3<f64>) -> Self {
        let q = similarity.isometry.rotation;
        Self {
            rotation: [q.w, q.i, q.j, q.k],
            translation: similarity.isometry.translation.vector.into(),
            scale: similarity.scaling(),
        }
    }
}

impl MovedBy {
    /// `map_from_index`.
    pub fn similarity(&self) -> Similarity3<f64> {
        let [w, i, j, k] = self.rotation;
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
        let translation = Translation3::from(Vector3::from(self.translation));
        Similarity3::from_parts(translation, rotation, self.scale)
    }

    /// What is known in the map, said in the frame of the index.
    pub(crate) fn prior_in_index(&self, prior: &LocalizationPrior) -> LocalizationPrior {
        let map_from_index = self.similarity();
        LocalizationPrior {
            position: prior
                .position
                .map(|(p, sigma)| (map_from_index.inverse() * p, sigma / self.scale)),
            yaw: prior.yaw.and_then(|(yaw, sigma)| {
                Some((yaw - turn_about_z(&map_from_index.isometry.rotation)?, sigma))
            }),
        }
    }

    /// Moves the poses of an answer into the map.
    pub(crate) fn move_answer(&self, answer: &mut LocalizationAnswer) {
        match &mut answer.status {
            Status::Ok(estimate) => self.move_estimate(estimate),
            Status::Ambiguous(all) => all.iter_mut().for_each(|e| self.move_estimate(e)),
            Status::NotFound(_) => {}
        }
    }

    fn move_estimate(&self, estimate: &mut PoseEstimate) {
        self.move_pose(&mut estimate.map_from_camera, &mut estimate.covariance);
    }

    /// Moves a pose and its covariance into the map.
    pub(crate) fn move_pose(&self, pose: &mut Isometry3<f64>, covariance: &mut Matrix6<f64>) {
        let map_from_index = self.similarity();
        let rotation = map_from_index.isometry.rotation;
        let position = map_from_index * nalgebra::Point3::from(pose.translation.vector);
        *pose = Isometry3::from_parts(position.coords.into(), rotation * pose.rotation);
        let r = rotation.to_rotation_matrix().into_inner();
        let mut jacobian = Matrix6::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(r * self.scale));
        jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        *covariance = jacobian * *covariance * jacobian.transpose();
    }

    /// Whether the index is upright where the map is.
    pub(crate) fn is_upright(&self) -> bool {
        turn_about_z(&self.similarity().isometry.rotation).is_some()
    }
}

/// The compass after a move; `None` when z is no longer up.
pub(crate) fn turn_north(
    north: &NorthInMap,
    new_from_map: &Similarity3<f64>,
) -> Option<NorthInMap> {
    let turn = turn_about_z(&new_from_map.isometry.rotation)?;
    Some(NorthInMap { yaw: north.yaw + turn, sigma: north.sigma })
}

fn turn_about_z(rotation: &UnitQuaternion<f64>) -> Option<f64> {
    let tilt = (rotation * Vector3::z()).angle(&Vector3::z());
    let x = rotation * Vector3::x();
    (tilt < MAX_TILT).then(|| x.y.atan2(x.x))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use volery_localization::{LocalizationAnswer, Status};

    use super::*;

    /// A moved answer sees the moved points where the answer saw the points, and its covariance
    /// grows with the square of the scale.
    #[test]
    fn answers_move_with_the_map() {
        let map_from_index =
            Similarity3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.0, 0.0, 0.7), 2.0);
        let moved = MovedBy::from(&map_from_index);
        assert!(
            (moved.similarity().to_homogeneous() - map_from_index.to_homogeneous()).norm() < 1e-12
        );
        let pose = Isometry3::new(Vector3::new(0.3, 0.2, 0.1), Vector3::new(0.4, -0.2, 1.0));
        let estimate = PoseEstimate {
            map_from_camera: pose,
            covariance: Matrix6::identity(),
            num_inliers: 10,
            num_correspondences: 10,
            reprojection_px: 1.0,
            sightings: Vec::new(),
        };
        let mut answer = LocalizationAnswer {
            status: Status::Ok(estimate),
            num_features: 10,
            num_correspondences: 10,
        };
        moved.move_answer(&mut answer);
        let Status::Ok(estimate) = &answer.status else { panic!("{answer:?}") };
        let point = Point3::new(3.0, 1.0, 2.0);
        let before = pose.inverse() * point;
        let after = estimate.map_from_camera.inverse() * (map_from_index * point);
        assert!((after.coords - before.coords * 2.0).norm() < 1e-12);
        assert!((estimate.covariance[(0, 0)] - 4.0).abs() < 1e-12);
        assert!((estimate.covariance[(5, 5)] - 1.0).abs() < 1e-12);

        let prior = LocalizationPrior {
            position: Some((map_from_index * point, 0.4)),
            yaw: Some((0.9, 0.1)),
        };
        let prior = moved.prior_in_index(&prior);
        let (position, sigma) = prior.position.unwrap();
        assert!((position - point).norm() < 1e-12 && (sigma - 0.2).abs() < 1e-12);
        assert!((prior.yaw.unwrap().0 - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_tilted_map_has_no_compass() {
        let tilt = Similarity3::new(Vector3::zeros(), Vector3::new(0.3, 0.0, 0.0), 1.0);
        assert_eq!(turn_north(&NorthInMap { yaw: 0.0, sigma: 0.1 }, &tilt), None);
    }
}
