//! The values that move: poses, intrinsics, points.

use nalgebra::{Isometry3, Point3, Vector6};
use volery_geometry::{Camera, perturbed};

use super::BundleProblem;
use super::layout::{LANES, Layout, NONE};
use super::lens::Lens;

/// A pose as rows of its rotation and its translation.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseRows {
    pub(super) rotation: [[f64; 3]; 3],
    pub(super) translation: [f64; 3],
    /// Camera center in the world.
    pub(super) center: [f64; 3],
    pub(super) camera: u32,
}

impl PoseRows {
    pub(super) fn new(cam_from_world: &Isometry3<f64>, camera: u32) -> Self {
        let matrix = cam_from_world.rotation.to_rotation_matrix().into_inner();
        let t = &cam_from_world.translation.vector;
        Self {
            rotation: std::array::from_fn(|row| {
                std::array::from_fn(|column| matrix[(row, column)])
            }),
            translation: [t.x, t.y, t.z],
            center: (-matrix.tr_mul(t)).into(),
            camera,
        }
    }

    /// `R x + t`.
    #[inline(always)]
    pub(super) fn transform<const FMA: bool>(&self, x: &[f64; 3]) -> [f64; 3] {
        use super::lens::fma;
        std::array::from_fn(|row| {
            let r = &self.rotation[row];
            let z = fma::<FMA>(r[2], x[2], self.translation[row]);
            fma::<FMA>(r[0], x[0], fma::<FMA>(r[1], x[1], z))
        })
    }
}

/// Values of all unknowns and constants, points in visiting order.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) cam_from_world: Vec<Isometry3<f64>>,
    pub(super) cameras: Vec<Camera>,
    pub(super) points: Vec<[f64; 3]>,
    /// `cam_from_world` made ready.
    pub(super) poses: Vec<PoseRows>,
    /// `cameras` made ready.
    pub(super) lenses: Vec<Lens>,
}

impl State {
    pub(super) fn new(problem: &BundleProblem, layout: &Layout) -> Self {
        let cameras: Vec<_> = problem.cameras.iter().map(|c| c.camera).collect();
        Self {
            cam_from_world: problem.poses.iter().map(|p| p.cam_from_world).collect(),
            lenses: cameras.iter().map(Lens::new).collect(),
            cameras,
            points: layout
                .point_ids
                .iter()
                .map(|&id| problem.points[id as usize].coords.into())
                .collect(),
            poses: problem
                .poses
                .iter()
                .map(|p| PoseRows::new(&p.cam_from_world, p.camera))
                .collect(),
        }
    }

    /// Poses and intrinsics of `from` moved by the reduced `step`. Points are left to
    /// [`super::linearize`]. `false` if a value left its domain.
    pub(super) fn step_cameras(&mut self, from: &Self, step: &[f64], layout: &Layout) -> bool {
        for (index, &block) in layout.pose_blocks.iter().enumerate() {
            if block == NONE {
                continue;
            }
            let offset = layout.block_offsets[block as usize];
            let xi = Vector6::from_column_slice(&step[offset..offset + 6]);
            let pose = perturbed(&from.cam_from_world[index], &xi);
            self.cam_from_world[index] = pose;
            self.poses[index] = PoseRows::new(&pose, from.poses[index].camera);
        }
        let mut in_domain = step.iter().all(|v| v.is_finite());
        for (index, free) in layout.intrinsics.iter().enumerate() {
            if free.params.is_empty() {
                continue;
            }
            let mut camera = from.cameras[index];
            for (k, &param) in free.params.iter().enumerate() {
                let offset = layout.block_offsets[free.first_block + k / LANES] + k % LANES;
                camera.params_mut()[param] += step[offset];
            }
            let focal = camera.focal();
            in_domain &= focal.x > 0.0 && focal.y > 0.0;
            self.cameras[index] = camera;
            self.lenses[index] = Lens::new(&camera);
        }
        in_domain
    }

    /// Writes the values back.
    pub(super) fn store(&self, problem: &mut BundleProblem, layout: &Layout) {
        for (pose, cam_from_world) in problem.poses.iter_mut().zip(&self.cam_from_world) {
            if !pose.constant {
                pose.cam_from_world = *cam_from_world;
            }
        }
        for (camera, refined) in problem.cameras.iter_mut().zip(&self.cameras) {
            camera.camera = *refined;
        }
        for (&id, point) in layout.point_ids.iter().zip(&self.points) {
            problem.points[id as usize] = Point3::from(*point);
        }
    }
}
