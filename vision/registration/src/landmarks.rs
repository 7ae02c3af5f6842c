//! Places of a zone that look like no others.

use nalgebra::Vector3;
use rayon::prelude::*;
use volery_geometry::Neighbor;

use crate::RegistrationError;
use crate::surfels::{Surfel, Surfels};

/// Distance of the places that are considered, cells.
const SPACING: f64 = 2.4;
/// Radius of the surface that describes a place, cells.
const RADIUS: f64 = 12.0;
/// Places that are kept.
const MAX_LANDMARKS: usize = 2500;
/// Bins per angle.
const BINS: usize = 11;
/// Three angles.
const LEN: usize = 3 * BINS;

/// A fast point feature histogram, square roots of shares: its Euclidean distance is Hellinger's.
pub(crate) type Descriptor = [f32; LEN];

/// Places with descriptors, the most unusual ones of a zone.
#[derive(Debug, Clone)]
pub(crate) struct Landmarks {
    pub(crate) places: Vec<Surfel>,
    pub(crate) descriptors: Vec<Descriptor>,
}

impl Landmarks {
    /// Fast point feature histograms of thinned pieces; of these, the ones farthest from the mean
    /// histogram, which is that of the bare surfaces.
    ///
    /// # Source
    ///
    /// Rusu, Blodow and Beetz, "Fast Point Feature Histograms (FPFH) for 3D Registration", ICRA
    /// 2009, section III; the choice is the persistence of section II, at one radius.
    pub(crate) fn new(surfels: &Surfels) -> Result<Self, RegistrationError> {
        let thin = surfels.thinned(SPACING * surfels.cell())?;
        let radius = RADIUS * surfels.cell();
        let pieces = thin.pieces();
        let neighbors: Vec<Vec<Neighbor>> = pieces
            .par_iter()
            .enumerate()
            .map(|(index, piece)| {
                let mut found = Vec::new();
                thin.tree().within(&piece.position, radius, &mut found);
                found.retain(|n| n.index as usize != index && n.distance_squared > 0.0);
                // Sums must not depend on the order of the tree.
                found.sort_unstable_by_key(|n| n.index);
                found
            })
            .collect();
        let simple: Vec<Descriptor> = pieces
            .par_iter()
            .zip(&neighbors)
            .map(|(piece, found)| simple_histogram(piece, found, pieces))
            .collect();
        let descriptors: Vec<Descriptor> = simple
            .par_iter()
            .zip(&neighbors)
            .map(|(own, found)| fast_histogram(own, found, &simple))
            .collect();
        let chosen = most_unusual(&descriptors);
        Ok(Self {
            places: chosen.iter().map(|&i| pieces[i]).collect(),
            descriptors: chosen.iter().map(|&i| descriptors[i]).collect(),
        })
    }
}

/// Shares of the angles between a piece and its neighbors.
fn simple_histogram(piece: &Surfel, neighbors: &[Neighbor], pieces: &[Surfel]) -> Descriptor {
    let mut histogram = [0.0; LEN];
    let share = 1.0 / neighbors.len().max(1) as f32;
    for neighbor in neighbors {
        let other = &pieces[neighbor.index as usize];
        let direction = (other.position - piece.position) / neighbor.distance_squared.sqrt();
        let u = piece.normal;
        let Some(v) = direction.cross(&u).try_normalize(1e-9) else { continue };
        let w: Vector3<f64> = u.cross(&v);
        let alpha = v.dot(&other.normal);
        let phi = u.dot(&direction);
        let theta = w.dot(&other.normal).atan2(u.dot(&other.normal)) / std::f64::consts::PI;
        for (k, angle) in [alpha, phi, theta].into_iter().enumerate() {
            let bin = ((angle + 1.0) / 2.0 * BINS as f64).clamp(0.0, BINS as f64 - 1.0) as usize;
            histogram[k * BINS + bin] += share;
        }
    }
    histogram
}

/// That of a piece and those of its neighbors, nearer ones first, as square roots.
fn fast_histogram(own: &Descriptor, neighbors: &[Neighbor], simple: &[Descriptor]) -> Descriptor {
    let weight = |n: &Neighbor| 1.0 / n.distance_squared.sqrt() as f32;
    let total: f32 = neighbors.iter().map(weight).sum::<f32>().max(f32::MIN_POSITIVE);
    let mut histogram = *own;
    for neighbor in neighbors {
        let weight = weight(neighbor) / total;
        let other = &simple[neighbor.index as usize];
        histogram.iter_mut().zip(other).for_each(|(h, o)| *h += weight * o);
    }
    histogram.map(|h| (h / 6.0).sqrt())
}

/// Indices of the descriptors farthest from the mean, in order.
fn most_unusual(descriptors: &[Descriptor]) -> Vec<usize> {
    let mut mean = [0.0; LEN];
    for descriptor in descriptors {
        mean.iter_mut().zip(descriptor).for_each(|(m, d)| *m += d / descriptors.len() as f32);
    }
    let distances: Vec<f32> =
        descriptors.iter().map(|descriptor| distance_squared(descriptor, &mean)).collect();
    let mut order: Vec<usize> = (0..descriptors.len()).collect();
    order.sort_by(|&a, &b| distances[b].total_cmp(&distances[a]).then(a.cmp(&b)));
    order.truncate(MAX_LANDMARKS);
    order.sort_unstable();
    order
}

/// Squared Euclidean distance.
pub(crate) fn distance_squared(a: &Descriptor, b: &Descriptor) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Pairs `(source, target)` of landmarks of which one has no more similar one than the other.
pub(crate) fn match_landmarks(source: &Landmarks, target: &Landmarks) -> Vec<(u32, u32)> {
    let nearest = |from: &Landmarks, to: &Landmarks| -> Vec<usize> {
        let of = |descriptor: &Descriptor| {
            let mut best = (f32::INFINITY, 0);
            for (index, other) in to.descriptors.iter().enumerate() {
                let distance = distance_squared(descriptor, other);
                if distance < best.0 {
                    best = (distance, index);
                }
            }
            best.1
        };
        from.descriptors.par_iter().map(of).collect()
    };
    if source.places.is_empty() || target.places.is_empty() {
        return Vec::new();
    }
    let there = nearest(source, target).into_iter().enumerate();
    let back = nearest(target, source).into_iter().enumerate().map(|(t, s)| (s, t));
    let mut pairs: Vec<(u32, u32)> = there.chain(back).map(|(s, t)| (s as u32, t as u32)).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
