//! Trains the codebook of the whole-image descriptor on drawn images and writes it.
//!
//! `train_codebook vision/features/src/retrieval/codebook.bin`: f32 little endian, mean (128),
//! principal axes (32 x 128), centers (64 x 32).

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Random, textured};
use nalgebra::{DMatrix, DVector};
use volery_features::retrieval::{NUM_AXES, NUM_CENTERS};
use volery_features::{SiftOptions, detect_and_describe};
use volery_scene::DESCRIPTOR_LEN;

const NUM_IMAGES: u64 = 48;
const NUM_ITERATIONS: usize = 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: train_codebook FILE")?;
    let options = SiftOptions { max_features: 1500, ..SiftOptions::default() };
    let mut descriptors = Vec::new();
    for seed in 0..NUM_IMAGES {
        let mut canvas = textured(640, 480, seed);
        let mut random = Random(seed);
        canvas.paint(|_, _, value| value + random.range(-4.0, 4.0));
        descriptors.extend(detect_and_describe(&canvas.to_image(), &options).descriptors);
    }
    let points: Vec<DVector<f64>> = descriptors
        .iter()
        .map(|d| DVector::from_iterator(DESCRIPTOR_LEN, d.iter().map(|&v| f64::from(v) / 256.0)))
        .collect();
    let mean = points.iter().sum::<DVector<f64>>() / points.len() as f64;
    let mut covariance = DMatrix::zeros(DESCRIPTOR_LEN, DESCRIPTOR_LEN);
    for point in &points {
        let d = point - &mean;
        covariance.ger(1.0, &d, &d, 1.0);
    }
    let eigen = covariance.symmetric_eigen();
    let mut order: Vec<usize> = (0..DESCRIPTOR_LEN).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let axes = DMatrix::from_fn(NUM_AXES, DESCRIPTOR_LEN, |row, column| {
        eigen.eigenvectors[(column, order[row])]
    });
    let projected: Vec<DVector<f64>> = points.iter().map(|p| &axes * (p - &mean)).collect();
    let centers = k_means(&projected);
    println!("{} descriptors", points.len());

    let rows = axes.transpose();
    let values = mean
        .iter()
        .copied()
        .chain(rows.iter().copied())
        .chain(centers.iter().flat_map(|c| c.iter().copied().collect::<Vec<_>>()));
    let bytes: Vec<u8> = values.flat_map(|v| (v as f32).to_le_bytes()).collect();
    std::fs::write(path, bytes)?;
    Ok(())
}

/// Lloyd's algorithm from random points; an empty cell restarts at a random point.
fn k_means(points: &[DVector<f64>]) -> Vec<DVector<f64>> {
    let mut random = Random(7);
    let mut pick = || points[(random.unit() * points.len() as f32) as usize % points.len()].clone();
    let mut centers: Vec<DVector<f64>> = (0..NUM_CENTERS).map(|_| pick()).collect();
    for _ in 0..NUM_ITERATIONS {
        let mut sums = vec![(DVector::zeros(NUM_AXES), 0.0); NUM_CENTERS];
        for point in points {
            let nearest = (0..NUM_CENTERS)
                .min_by(|&a, &b| {
                    let distance = |c: usize| (&centers[c] - point).norm_squared();
                    distance(a).total_cmp(&distance(b))
                })
                .unwrap_or(0);
            sums[nearest].0 += point;
            sums[nearest].1 += 1.0;
        }
        for (center, (sum, count)) in centers.iter_mut().zip(sums) {
            *center = if count > 0.0 { sum / count } else { pick() };
        }
    }
    centers
}
