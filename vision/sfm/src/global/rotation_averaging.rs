//! Absolute rotations from relative ones.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::laplacian::GraphLaplacian;

/// Residual, radians, at which an edge has lost most of its weight (Geman–McClure).
const ROBUST_SCALE: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Edges further off after convergence are wrong and left out of the second run.
const MAX_RESIDUAL: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Standard deviation, radians, that an edge of mean weight is taken to have beside gravity.
const EDGE_SIGMA: f64 = std::f64::consts::PI / 180.0;
/// Residual, radians, below which the L1 stage weighs all edges alike.
const L1_FLOOR: f64 = 1e-3;
const NUM_L1_STEPS: usize = 20;
const MAX_ROBUST_STEPS: usize = 50;
/// Converged: no rotation moves by more, radians.
const MIN_STEP: f64 = 1e-7;

/// A measured relative rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotationEdge {
    /// First image.
    pub i: usize,
    /// Second image, another one.
    pub j: usize,
    /// `cam_j_from_cam_i`.
    pub j_from_i: UnitQuaternion<f64>,
    /// Trust, relative to the other edges, positive.
    pub weight: f64,
}

/// Direction of world +z in the camera frame with its sigma, radians.
pub type KnownUp = (Unit<Vector3<f64>>, f64);

/// Absolute rotations with what they leave of each edge.
#[derive(Debug, Clone, PartialEq)]
pub struct RotationAverage {
    /// `cam_from_world`; `None` outside the largest component.
    pub cam_from_world: Vec<Option<UnitQuaternion<f64>>>,
    /// Angle between each edge and the rotations of its images, radians; infinite where an image
    /// has none.
    pub residuals: Vec<f64>,
}

/// Rotations of the largest connected component that agree best with the relative ones.
///
/// From a maximum spanning tree, minimizes over `Rᵢ` first the L1 norm, then the Geman–McClure
/// loss of `log(Rⱼᵀ Rⱼᵢ Rᵢ)` by iteratively reweighted least squares, where each step solves
///
/// ```text
/// min Σ w ‖δⱼ − δᵢ − log(Rⱼᵀ Rⱼᵢ Rᵢ)‖²,   Rᵢ ← Rᵢ Exp(δᵢ)
/// ```
///
/// Edges more than 10 degrees off are then left out and the rest is solved again.
///
/// * `up_in_cam`: direction of world +z in the camera frame with its sigma in radians, where
///   known; empty or one per image. With any, the world is upright.
///
/// Source: Chatterjee & Govindu, "Robust Relative Rotation Averaging", PAMI 2018.
pub fn average_rotations(
    num_images: usize,
    edges: &[RotationEdge],
    up_in_cam: &[Option<KnownUp>],
) -> RotationAverage {
    let is_sound = |edge: &RotationEdge| {
        edge.i != edge.j
            && edge.i.max(edge.j) < num_images
            && edge.weight.is_finite()
            && edge.weight > 0.0
            && edge.j_from_i.coords.iter().all(|v| v.is_finite())
    };
    let mut kept: Vec<RotationEdge> = edges.iter().filter(|e| is_sound(e)).copied().collect();
    let mut rotations = vec![None; num_images];
    for _ in 0..2 {
        let Some(tree) = spanning_tree(num_images, &kept, &rotations) else { break };
        rotations = tree;
        kept.retain(|edge| rotations[edge.i].is_some() && rotations[edge.j].is_some());
        make_upright(&mut rotations, up_in_cam);
        refine(&mut rotations, &kept, up_in_cam);
        kept.retain(|edge| residual(edge, &rotations) <= MAX_RESIDUAL);
    }
    let residuals = edges
        .iter()
        .map(|edge| if is_sound(edge) { residual(edge, &rotations) } else { f64::INFINITY })
        .collect();
    RotationAverage { cam_from_world: rotations, residuals }
}

/// `log(Rⱼᵀ Rⱼᵢ Rᵢ)`.
fn error_vector(
    edge: &RotationEdge,
    rotation_i: &UnitQuaternion<f64>,
    rotation_j: &UnitQuaternion<f64>,
) -> Vector3<f64> {
    (rotation_j.inverse() * edge.j_from_i * rotation_i).scaled_axis()
}

fn residual(edge: &RotationEdge, rotations: &[Option<UnitQuaternion<f64>>]) -> f64 {
    match (rotations[edge.i], rotations[edge.j]) {
        (Some(i), Some(j)) => error_vector(edge, &i, &j).norm(),
        _ => f64::INFINITY,
    }
}

/// Rotations along the maximum spanning tree of the largest component; images that have a rotation
/// `before` keep it. `None` without edges.
fn spanning_tree(
    num_images: usize,
    edges: &[RotationEdge],
    before: &[Option<UnitQuaternion<f64>>],
) -> Option<Vec<Option<UnitQuaternion<f64>>>> {
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order.sort_by(|&a, &b| edges[b].weight.total_cmp(&edges[a].weight).then(a.cmp(&b)));
    let mut component: Vec<usize> = (0..num_images).collect();
    let mut neighbors: Vec<Vec<usize>> = vec![Vec::new(); num_images];
    for index in order {
        let edge = &edges[index];
        let (from, to) = (component[edge.i], component[edge.j]);
        if from != to {
            component.iter_mut().filter(|c| **c == from).for_each(|c| *c = to);
            neighbors[edge.i].push(index);
            neighbors[edge.j].push(index);
        }
    }
    let size = |of: usize| component.iter().filter(|&&c| c == of).count();
    let root = (0..num_images)
        .filter(|&image| !neighbors[image].is_empty())
        .max_by_key(|&image| (size(component[image]), std::cmp::Reverse(image)))?;
    let mut rotations = vec![None; num_images];
    rotations[root] = Some(before[root].unwrap_or_else(UnitQuaternion::identity));
    let mut stack = vec![root];
    while let Some(image) = stack.pop() {
        let Some(rotation) = rotations[image] else { continue };
        for &index in &neighbors[image] {
            let edge = &edges[index];
            let (other, along) = if edge.i == image {
                (edge.j, edge.j_from_i * rotation)
            } else {
                (edge.i, edge.j_from_i.inverse() * rotation)
            };
            if rotations[other].is_none() {
                rotations[other] = Some(before[other].unwrap_or(along));
                stack.push(other);
            }
        }
    }
    Some(rotations)
}

/// Turns the world so that the mean of the known ups becomes +z.
fn make_upright(rotations: &mut [Option<UnitQuaternion<f64>>], up_in_cam: &[Option<KnownUp>]) {
    let mean: Vector3<f64> = rotations
        .iter()
        .zip(up_in_cam)
        .filter_map(|(rotation, up)| Some((*rotation)?.inverse() * (*up)?.0.into_inner()))
        .sum();
    if mean.norm() < 1e-9 {
        return;
    }
    let upright_from_world =
        UnitQuaternion::rotation_between(&mean, &Vector3::z()).unwrap_or_else(|| {
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
        });
    for rotation in rotations.iter_mut().flatten() {
        *rotation *= upright_from_world.inverse();
    }
}

/// L1, then Geman–McClure.
fn refine(
    rotations: &mut [Option<UnitQuaternion<f64>>],
    edges: &[RotationEdge],
    up_in_cam: &[Option<KnownUp>],
) {
    // Nodes of the graph are the images of the component.
    let images: Vec<usize> = (0..rotations.len()).filter(|&i| rotations[i].is_some()).collect();
    let mut node_of = vec![0; rotations.len()];
    for (node, &image) in images.iter().enumerate() {
        node_of[image] = node;
    }
    let mut current: Vec<UnitQuaternion<f64>> = rotations.iter().flatten().copied().collect();
    let ends: Vec<(usize, usize)> =
        edges.iter().map(|edge| (node_of[edge.i], node_of[edge.j])).collect();
    let Some(mut laplacian) = GraphLaplacian::new(images.len(), &ends) else { return };
    let mean_weight = edges.iter().map(|edge| edge.weight).sum::<f64>() / edges.len().max(1) as f64;

    let ups: Vec<(usize, Vector3<f64>, f64)> = images
        .iter()
        .enumerate()
        .filter_map(|(node, &image)| {
            let (up, sigma) = (*up_in_cam.get(image)?)?;
            let is_sound = sigma > 0.0 && up.iter().all(|v| v.is_finite());
            is_sound.then(|| (node, up.into_inner(), (EDGE_SIGMA / sigma).powi(2)))
        })
        .collect();
    // The free turn about z (all turns without gravity) is held at the first image.
    let mut anchor = vec![0.0; images.len()];
    anchor[0] = 1.0;
    let mut tilt = if ups.is_empty() { anchor.clone() } else { vec![0.0; images.len()] };
    for &(node, _, weight) in &ups {
        tilt[node] += weight;
    }

    for step in 0..NUM_L1_STEPS + MAX_ROBUST_STEPS {
        let errors: Vec<Vector3<f64>> = edges
            .iter()
            .zip(&ends)
            .map(|(edge, &(i, j))| error_vector(edge, &current[i], &current[j]))
            .collect();
        let weights: Vec<f64> = edges
            .iter()
            .zip(&errors)
            .map(|(edge, error)| {
                let angle = error.norm();
                let robust = if step < NUM_L1_STEPS {
                    L1_FLOOR / angle.max(L1_FLOOR)
                } else {
                    (ROBUST_SCALE.powi(2) / (ROBUST_SCALE.powi(2) + angle * angle)).powi(2)
                };
                edge.weight / mean_weight * robust
            })
            .collect();
        let mut right = vec![Vector3::zeros(); images.len()];
        for ((&(i, j), error), &weight) in ends.iter().zip(&errors).zip(&weights) {
            right[i] -= weight * error;
            right[j] += weight * error;
        }
        let mut tilts = right.clone();
        for &(node, up, weight) in &ups {
            // Rᵢ (ẑ + δ × ẑ) = up.
            tilts[node] += weight * Vector3::z().cross(&(current[node].inverse() * up));
        }
        if !laplacian.solve(&ends, &weights, &tilt, &mut tilts)
            || !laplacian.solve(&ends, &weights, &anchor, &mut right)
        {
            break;
        }
        let mut longest = 0.0_f64;
        for ((rotation, tilt), turn) in current.iter_mut().zip(&tilts).zip(&right) {
            let delta = Vector3::new(tilt.x, tilt.y, turn.z);
            *rotation *= UnitQuaternion::from_scaled_axis(delta);
            rotation.renormalize();
            longest = longest.max(delta.norm());
        }
        if longest < MIN_STEP && step >= NUM_L1_STEPS {
            break;
        }
    }
    for (&image, rotation) in images.iter().zip(current) {
        rotations[image] = Some(rotation);
    }
}
