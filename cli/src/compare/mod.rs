//! `volery compare-positioning`: the same flight through a synthetic hall by camera, by radio
//! strength, and by ultrasound with a height sensor.

mod beacons;
mod page;

use std::f64::consts::TAU;
use std::fs;

use nalgebra::Point3;
use serde::Serialize;
use volery_api::LocalizeMethod;
use volery_flight::positioning::{Figures, compare};
use volery_localization::{LocalizationPrior, LocalizeOptions, Status};
use volery_pipeline::{
    CameraSpec, ImageInput, JobSpec, MapFolder, PipelineError, StageGroup, error::code, reconstruct,
};
use volery_scene::ImagePrior;
use volery_synthetic::{DemoHall, Rng, Sensor, Shot, cam_from_heading};

use crate::{
    args::CompareArgs,
    demo::{DemoFolder, rigid, save},
    output::{Ending, Outcome, print_json},
    progress::Terminal,
};
use beacons::Beacons;

/// Half axes of the way, an eight over the crates at both ends, and its heights, meters.
const WAY: [f64; 2] = [4.0, 1.7];
const HEIGHT: f64 = 2.1;
const CLIMB: f64 = 0.4;
/// Of a hovering drone, radians.
const TILT: f64 = 0.01;

/// Name of what is worst by far.
const RADIO: &str = "radio strength";

/// A way to know where one is.
#[derive(Debug, Serialize)]
struct System {
    name: &'static str,
    #[serde(flatten)]
    figures: Option<SystemFigures>,
    #[serde(skip)]
    estimates: Vec<Option<Point3<f64>>>,
}

/// Errors against the truth.
#[derive(Debug, Serialize)]
struct SystemFigures {
    num_asked: usize,
    num_answered: usize,
    median_m: f64,
    p95_m: f64,
    max_m: f64,
    rmse_horizontal_m: f64,
    rmse_height_m: f64,
}

impl From<Figures> for SystemFigures {
    fn from(figures: Figures) -> Self {
        Self {
            num_asked: figures.num_asked,
            num_answered: figures.num_answered,
            median_m: figures.median,
            p95_m: figures.p95,
            max_m: figures.max,
            rmse_horizontal_m: figures.rmse_horizontal,
            rmse_height_m: figures.rmse_height,
        }
    }
}

#[derive(Debug, Serialize)]
struct Comparison {
    systems: Vec<System>,
    /// Median level error of radio by its noise: decibels, meters.
    radio_by_noise: Vec<[f64; 2]>,
    #[serde(skip)]
    truth: Vec<Point3<f64>>,
}

pub(crate) fn run(args: &CompareArgs, json: bool) -> Outcome {
    let folder = DemoFolder::claim(&args.out, &["scan", "work", "map"])?;
    let hall = DemoHall::new(args.seed);
    let shots = flight(usize::from(args.places), args.seed);
    let truth: Vec<Point3<f64>> =
        shots.iter().map(|shot| shot.cam_from_world.inverse().translation.vector.into()).collect();
    let beacons = Beacons::around(&hall.hall.room);
    let mut systems = vec![System::new("camera", &truth, by_camera(&hall, &shots, &folder)?)];
    systems.push(System::new(
        RADIO,
        &truth,
        beacons.by_radio(&truth, HEIGHT, args.rssi_sigma_db, args.seed),
    ));
    systems.push(System::new(
        "ultrasound and height",
        &truth,
        beacons.by_sound(&hall.hall.room, &truth, args.seed),
    ));
    let radio_by_noise = beacons.radio_by_noise(&truth, HEIGHT, args.seed);
    let comparison = Comparison { systems, radio_by_noise, truth };
    let text = serde_json::to_string_pretty(&comparison)
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    folder.write("report.json", text.as_bytes())?;
    for (name, svg) in page::plots(&hall.hall.room, &comparison) {
        folder.write(name, svg.as_bytes())?;
    }
    let page = folder.write("report.html", page::page(&comparison).as_bytes())?;
    if json {
        print_json(&comparison);
    } else {
        for system in &comparison.systems {
            println!("{:22} {}", system.name, system.words());
        }
        println!("report                 {}", page.display());
    }
    Ok(Ending::Done)
}

impl System {
    fn new(name: &'static str, truth: &[Point3<f64>], estimates: Vec<Option<Point3<f64>>>) -> Self {
        let figures = compare(truth, &estimates).map(SystemFigures::from);
        Self { name, figures, estimates }
    }

    fn words(&self) -> String {
        self.figures.as_ref().map_or("no answers".to_owned(), |f| {
            format!(
                "{} of {} places, median {:.3} m, p95 {:.3} m, level {:.3} m rms, height {:.3} m rms",
                f.num_answered,
                f.num_asked,
                f.median_m,
                f.p95_m,
                f.rmse_horizontal_m,
                f.rmse_height_m
            )
        })
    }
}

/// An eight through the hall; the camera looks along it.
fn flight(num_places: usize, seed: u64) -> Vec<Shot> {
    let mut rng = Rng::fork(seed, 0x636f);
    (0..num_places)
        .map(|index| {
            let turn = TAU * (index as f64 + 0.5) / num_places as f64;
            let [x, y] = [WAY[0] * turn.sin(), WAY[1] * (2.0 * turn).sin()];
            let ahead = [WAY[0] * turn.cos(), 2.0 * WAY[1] * (2.0 * turn).cos()];
            let center = Point3::new(x, y, HEIGHT + CLIMB * (3.0 * turn).cos());
            let (pitch, roll) = (TILT * rng.normal(), TILT * rng.normal());
            Shot {
                name: format!("flight_{index:04}"),
                cam_from_world: cam_from_heading(&center, ahead[0].atan2(ahead[1]), pitch, roll),
                prior: ImagePrior::default(),
                sensor: Sensor::default(),
                seed: rng.bits(),
            }
        })
        .collect()
}

/// The hall is scanned and mapped as in the demo, and each photo of the flight is localized alone.
fn by_camera(
    hall: &DemoHall,
    shots: &[Shot],
    folder: &DemoFolder,
) -> Result<Vec<Option<Point3<f64>>>, PipelineError> {
    let scan = folder.join("scan");
    let mut images = Vec::new();
    for shot in &hall.scan {
        let path = scan.join(&shot.name);
        save(&hall.photo(shot), &path)?;
        images.push(ImageInput { prior: shot.prior, ..ImageInput::new(shot.name.clone(), path) });
    }
    let spec = JobSpec {
        camera: Some(CameraSpec::from(hall.camera())),
        stages: vec![StageGroup::Sfm],
        ..JobSpec::new(images)
    };
    let progress = Terminal::new();
    let made = reconstruct(&spec, &folder.join("work"), &folder.join("map"), &progress);
    progress.finish();
    made?;
    let map = MapFolder::open(&folder.join("map"))?;
    let poses = folder.join("map").join("poses.csv");
    let poses = fs::read(&poses).map_err(|e| PipelineError::io(&poses, &e))?;
    let poses = volery_formats::read_poses_csv(&poses)
        .map_err(|e| PipelineError::plain(code::BAD_MAP, e.to_string()))?;
    let world_from_map = rigid(hall, &poses)
        .ok_or_else(|| PipelineError::plain(code::NO_MODEL, "the map cannot be compared"))?;
    let (prior, options) = (LocalizationPrior::default(), LocalizeOptions::default());
    shots
        .iter()
        .map(|shot| {
            let image = hall.photo(shot).gray();
            let located =
                map.locate(&image, hall.camera(), &prior, &options, LocalizeMethod::Pnp)?;
            Ok(match located.answer.status {
                Status::Ok(estimate) => {
                    let place = Point3::from(estimate.map_from_camera.translation.vector);
                    Some(world_from_map * place)
                }
                _ => None,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_free() {
        let hall = DemoHall::new(1);
        for shot in flight(60, 1) {
            let center = volery_geometry::triangulation::camera_center(&shot.cam_from_world);
            assert!(hall.hall.room.is_free(&center, 0.2), "{}: {center}", shot.name);
        }
    }
}
