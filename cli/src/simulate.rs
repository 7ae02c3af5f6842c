//! `volery simulate`.

use std::io::Write;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use nalgebra::{Point3, Vector3};
use volery_client::Client;
use volery_formats::read_glb_of_textured_mesh;
use volery_geometry::Camera;
use volery_pipeline::{CameraSpec, PipelineError, error::code};
use volery_rendering::DrawableMesh;
use volery_simulator::shell::{Feed, FrameSink, Simulation, StreamTarget, simulate};
use volery_simulator::{DroneOptions, Eye, Mount, Scenery, Signing, Space};
use volery_synthetic::DemoHall;

use crate::{
    args::{RoomArg, SimulateArgs},
    input,
    output::{Ending, Outcome},
    remote::failed,
    serve::{runtime, signalled},
};

/// Stamps of MAVLink's signatures count from 2015 in units of 10 µs.
const STAMPS_SINCE: Duration = Duration::from_secs(1_420_070_400);

pub(crate) fn run(args: &SimulateArgs) -> Outcome {
    let (space, scenery) = place(args)?;
    let simulation = Simulation {
        server: args.mavlink,
        bind: args.bind,
        drones: drones(args)?,
        space,
        separation: args.separation,
        faults: args.fault.clone(),
        feed: feed(args, scenery)?,
        report_interval: Duration::from_secs_f64(1.0 / args.report),
    };
    let duration = args.duration.map(Duration::from_secs_f64);
    let summary = runtime()?.block_on(async {
        let interrupted = signalled();
        let stop = async {
            match duration {
                Some(duration) => tokio::select! {
                    () = tokio::time::sleep(duration) => {}
                    () = interrupted => {}
                },
                None => interrupted.await,
            }
        };
        simulate(simulation, stop, print_line).await
    });
    let summary = summary.map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    print_line(&summary);
    Ok(Ending::Done)
}

/// One line of JSON on standard output. A closed pipe is the reader's choice.
fn print_line(line: &impl serde::Serialize) {
    let mut out = std::io::stdout().lock();
    if serde_json::to_writer(&mut out, line).is_ok() {
        let _ = writeln!(out);
    }
}

/// What they can run into and what they see.
fn place(args: &SimulateArgs) -> Result<(Space, Option<(Scenery, Camera)>), PipelineError> {
    if let Some(path) = &args.glb {
        let bytes = input::read(path)?;
        let unusable =
            |e: String| PipelineError::plain(code::BAD_INPUT, format!("{}: {e}", path.display()));
        let mut map = read_glb_of_textured_mesh(&bytes).map_err(|e| unusable(e.to_string()))?;
        let vertices = &map.mesh.vertices;
        let none = Point3::from(Vector3::repeat(f64::INFINITY));
        let low = vertices.iter().fold(none, |low, v| low.inf(v));
        let high = vertices.iter().fold(-none, |high, v| high.sup(v));
        let floor = Vector3::z() * low.z;
        map.mesh.vertices.iter_mut().for_each(|v| *v -= floor);
        let mesh = DrawableMesh::with_texture(&map).map_err(|e| unusable(e.to_string()))?;
        let scenery = Scenery::Mesh(Box::new(mesh));
        return Ok((Space::Hollow([low - floor, high - floor]), Some((scenery, camera(args)?))));
    }
    match args.room {
        RoomArg::Open => Ok((Space::Open, None)),
        RoomArg::Hall => {
            let hall = DemoHall::new(args.seed).hall;
            let room = Space::Room(hall.room.clone());
            Ok((room, Some((Scenery::Hall(Box::new(hall)), camera(args)?))))
        }
    }
}

fn camera(args: &SimulateArgs) -> Result<Camera, PipelineError> {
    match &args.camera {
        Some(path) => {
            let bytes = input::read(path)?;
            volery_formats::read_camera_json(&bytes).map_err(|e| {
                PipelineError::plain(code::BAD_INPUT, format!("{}: {e}", path.display()))
            })
        }
        None => Ok(DemoHall::default_camera()),
    }
}

fn drones(args: &SimulateArgs) -> Result<Vec<DroneOptions>, PipelineError> {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let epoch = (since_epoch.saturating_sub(STAMPS_SINCE).as_micros() / 10) as u64;
    let signing = args.key.map(|key| Signing { key, epoch });
    (0..args.drones)
        .map(|index| {
            let system_id = args.system_id.checked_add(index).filter(|id| *id < 255);
            let system_id = system_id.ok_or_else(|| {
                PipelineError::plain(code::BAD_INPUT, "system ids end at 254".to_owned())
            })?;
            let place = Vector3::from(args.start) + Vector3::from(args.spacing) * f64::from(index);
            Ok(DroneOptions {
                parameters: args.parameter.clone(),
                signing,
                seed: args.seed,
                ..DroneOptions::new(system_id, args.flavor.of(index), place.into())
            })
        })
        .collect()
}

fn feed(
    args: &SimulateArgs,
    scenery: Option<(Scenery, Camera)>,
) -> Result<Option<Feed>, PipelineError> {
    let sink = match (args.map, args.mjpeg) {
        (Some(map_id), _) => {
            let server = &args.server;
            let client = Client::new(&server.server, server.token.as_deref()).map_err(failed)?;
            let camera = CameraSpec::from(&camera(args)?).into();
            FrameSink::Stream(StreamTarget { client, map_id, camera })
        }
        (None, Some(address)) => FrameSink::Mjpeg(address),
        (None, None) => return Ok(None),
    };
    let (scenery, camera) = scenery.ok_or_else(|| {
        PipelineError::plain(
            code::BAD_INPUT,
            "there is nothing to be seen in --room open".to_owned(),
        )
    })?;
    let interval = Duration::from_secs_f64(1.0 / args.frames);
    Ok(Some(Feed { eye: Eye::new(scenery, &camera, Mount::default()), interval, sink }))
}
