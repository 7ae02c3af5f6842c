//! The demo's map and answers against the truth.

use std::collections::BTreeMap;

use serde::Serialize;
use volery_api::{LocalizeAnswer, LocalizeStatus};
use volery_formats::NamedPose;
use volery_geometry::{
    Isometry3, Point3, Similarity3, Vector3, isometry_from_points, similarity_from_points,
};
use volery_scene::TriangleMesh;
use volery_synthetic::{DemoHall, Shot};

use crate::localize::pose_of;

/// The whole demo in figures.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Score {
    pub(crate) num_scan: usize,
    pub(crate) num_registered: usize,
    /// Root mean square position error after the best similarity, meters.
    pub(crate) ate_m: f64,
    /// Median.
    pub(crate) rotation_deg: f64,
    /// Of the map's own meters.
    pub(crate) scale_error: f64,
    /// Angle between the map's z and up.
    pub(crate) gravity_deg: f64,
    pub(crate) num_queries: usize,
    pub(crate) num_localized: usize,
    /// Median position error of the answers, meters.
    pub(crate) query_m: f64,
    /// Median rotation error of the answers.
    pub(crate) query_deg: f64,
    /// Triangles of the mesh.
    pub(crate) num_triangles: usize,
    /// Median distance of its vertices to the true surfaces, meters.
    pub(crate) mesh_m: f64,
    /// Camera centers of the map in the world, for the plot.
    #[serde(skip)]
    pub(crate) centers: Vec<(Point3<f64>, Point3<f64>)>,
}

/// One query against its truth.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct QueryScore {
    pub(crate) name: String,
    pub(crate) status: LocalizeStatus,
    pub(crate) reason: Option<String>,
    pub(crate) error_m: Option<f64>,
    pub(crate) error_deg: Option<f64>,
    pub(crate) num_inliers: u32,
    pub(crate) total_ms: f64,
    /// Where the answer lies in the world.
    #[serde(skip)]
    pub(crate) place: Option<Point3<f64>>,
}

/// The map's poses against the scan's, and `world_from_map`.
pub(crate) fn map(hall: &DemoHall, poses: &[NamedPose]) -> Option<(Score, Similarity3<f64>)> {
    let pairs = pairs(hall, poses);
    let (source, target) = centers(&pairs);
    let world_from_map = similarity_from_points(&source, &target).ok()?;
    let centers: Vec<_> =
        source.iter().map(|p| world_from_map * p).zip(target.iter().copied()).collect();
    let squares: f64 = centers.iter().map(|(found, truth)| (found - truth).norm_squared()).sum();
    let rotation = world_from_map.isometry.rotation;
    let angles = pairs
        .iter()
        .map(|(found, truth)| (rotation * found.rotation).angle_to(&truth.rotation).to_degrees());
    let up = rotation * Vector3::z();
    let score = Score {
        num_scan: hall.scan.len(),
        num_registered: pairs.len(),
        ate_m: (squares / pairs.len() as f64).sqrt(),
        rotation_deg: median(angles),
        scale_error: 1.0 / world_from_map.scaling() - 1.0,
        gravity_deg: up.angle(&Vector3::z()).to_degrees(),
        num_queries: hall.queries.len(),
        num_localized: 0,
        query_m: 0.0,
        query_deg: 0.0,
        num_triangles: 0,
        mesh_m: 0.0,
        centers,
    };
    Some((score, world_from_map))
}

/// `world_from_map` with the map's unit taken as it is: what a wrong scale does is an error.
pub(crate) fn rigid(hall: &DemoHall, poses: &[NamedPose]) -> Option<Isometry3<f64>> {
    let (source, target) = centers(&pairs(hall, poses));
    isometry_from_points(&source, &target).ok()
}

/// Poses found and true.
fn pairs(hall: &DemoHall, poses: &[NamedPose]) -> Vec<(Isometry3<f64>, Isometry3<f64>)> {
    let truth: BTreeMap<&str, Isometry3<f64>> =
        hall.scan.iter().map(|shot| (shot.name.as_str(), shot.cam_from_world.inverse())).collect();
    poses
        .iter()
        .filter_map(|pose| Some((pose.world_from_cam, *truth.get(pose.image.as_str())?)))
        .collect()
}

fn centers(pairs: &[(Isometry3<f64>, Isometry3<f64>)]) -> (Vec<Point3<f64>>, Vec<Point3<f64>>) {
    let center = |pose: &Isometry3<f64>| Point3::from(pose.translation.vector);
    pairs.iter().map(|(found, truth)| (center(found), center(truth))).unzip()
}

/// An answer against the truth of its shot.
pub(crate) fn query(
    shot: &Shot,
    answer: &LocalizeAnswer,
    world_from_map: &Similarity3<f64>,
) -> QueryScore {
    let localization = &answer.localization;
    let truth = shot.cam_from_world.inverse();
    let found = pose_of(localization);
    let place = found.map(|pose| world_from_map * Point3::from(pose.translation.vector));
    QueryScore {
        name: shot.name.clone(),
        status: localization.status,
        reason: localization.reason.clone(),
        error_m: place.map(|place| (place.coords - truth.translation.vector).norm()),
        error_deg: found.map(|pose| {
            let rotation = world_from_map.isometry.rotation * pose.rotation;
            rotation.angle_to(&truth.rotation).to_degrees()
        }),
        num_inliers: localization.num_inliers,
        total_ms: localization.timings.total_ms.unwrap_or(0.0),
        place,
    }
}

impl Score {
    pub(crate) fn with_queries(self, queries: &[QueryScore]) -> Self {
        Self {
            num_localized: queries.iter().filter(|q| q.place.is_some()).count(),
            query_m: median(queries.iter().filter_map(|q| q.error_m)),
            query_deg: median(queries.iter().filter_map(|q| q.error_deg)),
            ..self
        }
    }

    pub(crate) fn with_mesh(
        self,
        mesh: &TriangleMesh,
        hall: &DemoHall,
        world_from_map: &Similarity3<f64>,
    ) -> Self {
        let room = &hall.hall.room;
        let off = mesh.vertices.iter().map(|v| room.distance_to_surface(&(world_from_map * v)));
        Self { num_triangles: mesh.triangles.len(), mesh_m: median(off), ..self }
    }

    /// Nearly all photos in the map, to centimeters, a mesh, and most queries placed in it.
    pub(crate) fn is_as_promised(&self) -> bool {
        self.num_registered * 10 >= self.num_scan * 9
            && self.ate_m < 0.03
            && self.num_localized * 4 >= self.num_queries * 3
            && self.query_m < 0.03
            && self.num_triangles > 0
            && self.mesh_m < 0.05
    }
}

pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    at_quantile(values, 0.5)
}

/// The value that a part `q` of all values lie below; 0 where there are none.
pub(super) fn at_quantile(values: impl Iterator<Item = f64>, q: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get(((values.len() as f64 * q) as usize).min(last)).copied().unwrap_or(0.0)
}
