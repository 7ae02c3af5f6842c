//! `volery demo`: a synthetic hall is scanned, mapped by the service and localized against; drones
//! with cameras fly as a group over the map. All of it is compared with the truth.

mod flight;
mod flight_plots;
mod flight_score;
mod folder;
mod mapping;
mod page;
mod record;
mod score;
mod text;

use std::{pin::pin, sync::Arc, time::Duration, time::Instant};

use volery_api::{Job, Role};
use volery_client::Client;
use volery_pipeline::{PipelineError, error::code};
use volery_server::{Config, MavlinkSettings, RunningServer, start};
use volery_synthetic::DemoHall;

use crate::{
    args::DemoArgs,
    output::{Ending, Outcome, print_json},
    remote::failed,
    serve::{own_program, runtime, signalled},
};
use flight::Swarm;
use flight_score::FlightScore;
pub(crate) use folder::DemoFolder;
use mapping::Mapped;
pub(crate) use mapping::save;
pub(crate) use score::rigid;
use score::{QueryScore, Score};

/// For the browser that watches.
const TOKEN_LIFE: Duration = Duration::from_secs(24 * 3600);
/// The drones' autopilots count with 50 ms; on a busy machine a pose takes longer now and then.
const MAX_POSE_AGE: Duration = Duration::from_millis(250);
/// At the end of a crossing, before the next one.
const REST: Duration = Duration::from_secs(2);

/// What the demo has measured, for the page and for `--json`.
#[derive(Debug, serde::Serialize)]
pub(crate) struct DemoReport {
    /// Drones that flew.
    drones: usize,
    /// Of them, those that were at all their goals.
    arrived: usize,
    /// Of two drones in the air.
    min_separation_m: Option<f64>,
    /// Of the drones' cameras, live.
    pose_error_median_m: Option<f64>,
    /// Root mean square position error of the map's cameras after the best similarity.
    map_ate_m: f64,
    /// The whole demo.
    seconds: f64,
    stages: Vec<(&'static str, f64)>,
    score: Score,
    queries: Vec<QueryScore>,
    flight: Option<FlightScore>,
    job: Job,
    map: serde_json::Value,
}

/// How long what took.
struct Stages {
    start: Instant,
    lap: Instant,
    seconds: Vec<(&'static str, f64)>,
}

impl Stages {
    fn new() -> Self {
        Self { start: Instant::now(), lap: Instant::now(), seconds: Vec::new() }
    }

    /// Since the stage before.
    fn done(&mut self, what: &'static str) {
        let spent = self.lap.elapsed().as_secs_f64();
        eprintln!("{what}: {spent:.1} s");
        self.lap = Instant::now();
        self.seconds.push((what, spent));
    }
}

pub(crate) fn run(args: &DemoArgs, json: bool) -> Outcome {
    let folder = DemoFolder::claim(&args.out, &["data", "scan", "query"])?;
    let runtime = runtime()?;
    let outcome = runtime.block_on(serve(args, json, &folder));
    // Photos that are being drawn for nobody.
    runtime.shutdown_background();
    outcome
}

/// Runs the ground station and shows it.
async fn serve(args: &DemoArgs, json: bool, folder: &DemoFolder) -> Outcome {
    let any_port = ([127, 0, 0, 1], 0).into();
    let mavlink = MavlinkSettings {
        accept_unsigned: true,
        max_pose_age: MAX_POSE_AGE,
        ..MavlinkSettings::new(any_port)
    };
    let config = Config {
        listen: any_port,
        mavlink: (args.drones > 0).then_some(mavlink),
        ..Config::new(folder.join("data"), own_program()?)
    };
    let server = start(config).await.map_err(|e| PipelineError::plain("serve", e.to_string()))?;
    let mut interrupted = pin!(signalled());
    let outcome = tokio::select! {
        outcome = present(args, json, folder, &server) => outcome,
        () = &mut interrupted => {
            let detail = format!("interrupted; {} keeps what was done", args.out.display());
            Err(PipelineError::plain(code::CANCELLED, detail))
        }
    };
    let ending = match outcome {
        Ok((ending, swarm)) => {
            if !args.headless {
                tokio::select! { () = fly_on(swarm) => {}, () = &mut interrupted => {} }
            }
            Ok(ending)
        }
        Err(error) => Err(error),
    };
    server.stop().await;
    ending
}

/// The demo from the scan to the report. Its drones are still in the air if somebody watches.
async fn present(
    args: &DemoArgs,
    json: bool,
    folder: &DemoFolder,
    server: &RunningServer,
) -> Result<(Ending, Option<Swarm>), PipelineError> {
    let admin = Client::new(&server.url(), server.admin_token.as_deref()).map_err(failed)?;
    let life = Some(TOKEN_LIFE.as_secs());
    let token = admin.create_token("demo", Role::Pilot, life).await.map_err(failed)?;
    let client = Client::new(&server.url(), Some(&token.secret)).map_err(failed)?;
    eprintln!("watch it: {}/#token={}", server.url(), token.secret);

    let mut stages = Stages::new();
    let hall = Arc::new(DemoHall::new(args.seed));
    let (photographed, scan) = (Arc::clone(&hall), folder.clone());
    tokio::task::spawn_blocking(move || mapping::take_photos(&photographed, &scan))
        .await
        .map_err(|e| PipelineError::plain("defect", e.to_string()))??;
    stages.done("rendering");
    let mapped = mapping::map(&client, &hall, folder, &mut stages).await?;
    let (flight, swarm) = match server.mavlink_addr() {
        Some(mavlink) => {
            flight::register(&admin, args.drones).await?;
            let swarm =
                Swarm::start(&client, mavlink, args.drones, &hall, &mapped, args.seed).await?;
            let (flight, swarm) = fly(swarm, args.headless, &mapped, &mut stages).await?;
            (Some(flight), swarm)
        }
        None => (None, None),
    };
    let report = DemoReport {
        drones: flight.as_ref().map_or(0, |flight| flight.drones),
        arrived: flight.as_ref().map_or(0, |flight| flight.arrived),
        min_separation_m: flight.as_ref().and_then(|flight| flight.min_separation_m),
        pose_error_median_m: flight.as_ref().map(|flight| flight.pose_error_median_m),
        map_ate_m: mapped.score.ate_m,
        seconds: stages.start.elapsed().as_secs_f64(),
        stages: stages.seconds,
        score: mapped.score,
        queries: mapped.queries,
        flight,
        job: mapped.job,
        map: mapped.info,
    };
    let path = folder.write("report.html", page::page(&hall, &report).as_bytes())?;
    if json {
        print_json(&report);
    } else {
        text::print(&report, &path);
    }
    let is_good = report.score.is_as_promised()
        && report.flight.as_ref().is_none_or(FlightScore::is_as_promised);
    Ok((if is_good { Ending::Done } else { Ending::Partial }, swarm))
}

/// There and back through the middle. Lands if nobody watches.
async fn fly(
    mut swarm: Swarm,
    is_headless: bool,
    mapped: &Mapped,
    stages: &mut Stages,
) -> Result<(FlightScore, Option<Swarm>), PipelineError> {
    stages.done("drones find their places");
    swarm.fence().await?;
    let mut crossings = Vec::new();
    for _ in 0..2 {
        let (plan, goals) = swarm.cross().await?;
        let truth = swarm.record.now();
        let crossing = flight_score::crossing(plan, &goals, &truth, &mapped.world_from_map);
        let is_whole = crossing.state == "finished";
        crossings.push((crossing, goals));
        if !is_whole {
            break;
        }
    }
    if is_headless {
        swarm.land().await?;
    }
    stages.done("group flight");
    let flight = flight_score::score(swarm.record.finish(), crossings, &mapped.world_from_map);
    if is_headless {
        swarm.stop().await?;
        return Ok((flight, None));
    }
    Ok((flight, Some(swarm)))
}

/// To and fro for who watches, until somebody else gives the drones orders.
async fn fly_on(swarm: Option<Swarm>) {
    eprintln!("the ground station runs on; Ctrl-C ends it");
    if let Some(mut swarm) = swarm {
        let why = loop {
            tokio::time::sleep(REST).await;
            match swarm.cross().await {
                Ok((flight, _)) if flight.state == "finished" => {}
                Ok((flight, _)) => break format!("the flight is {}", flight.state),
                Err(error) => break error.to_string(),
            }
        };
        eprintln!("the drones fly no further crossings: {why}");
        // They stay switched on.
        let _on = swarm;
        return std::future::pending().await;
    }
    std::future::pending().await
}
