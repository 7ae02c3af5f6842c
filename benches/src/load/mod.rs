//! A server under load: drones in flight, viewers, requests; without and with a reconstruction,
//! and among strangers' packets.

mod drone;
mod flood;
mod http;
mod listeners;
mod station;

use std::io::Result;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use volery_simulator::Signing;
use volery_tests::SharedSet;

use crate::table::{Table, figure};
use drone::{Body, Seen};
use http::Connection;
use listeners::Times;
use station::Station;

/// First argument that asks for this table.
pub(crate) const COMMAND: &str = "load";

const DRONES: u8 = 50;
const SUBSCRIBERS: u32 = 500;
const REQUESTS_PER_S: u32 = 200;
const FLOOD_PER_S: u32 = 50_000;
/// Photos that are reconstructed meanwhile.
const PHOTOS: &str = "fountain_p11";
const KEY: [u8; 32] = [7; 32];
/// Seconds from 1970 to 2015, where signing times begin.
const SIGNING_EPOCH_S: u64 = 1_420_070_400;

/// What happens besides the load itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Besides {
    Nothing,
    Reconstruction,
    Flood,
}

/// The load of each kind for some seconds.
///
/// * `arguments`: seconds (60), and words that choose among `nothing`, `reconstruction`, `flood`.
pub(crate) fn load(arguments: &[String]) -> Result<Table> {
    let seconds = arguments.iter().find_map(|word| word.parse().ok()).unwrap_or(60.0);
    let heads = [
        "besides",
        "relay of a pose p50 / p99",
        "push of a state p50 / p99",
        "request p50 / p99",
        "slowest setpoints",
        "their longest gap",
        "telemetry lost",
        "poses refused",
        "CPU of the server",
    ];
    let title = format!(
        "Load: {DRONES} drones with 100 messages/s and 30 poses/s each, {SUBSCRIBERS} subscribers at \
         10 Hz, {REQUESTS_PER_S} requests/s, for {seconds} s"
    );
    let mut table = Table::new(&title, &heads);
    for (name, besides) in [
        ("nothing", Besides::Nothing),
        ("reconstruction", Besides::Reconstruction),
        ("flood", Besides::Flood),
    ] {
        let words = || arguments.iter().filter(|word| word.parse::<f64>().is_err());
        if words().count() == 0 || words().any(|word| word == name) {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .enable_all()
                .build()?;
            let mut row = vec![name.to_owned()];
            row.extend(runtime.block_on(run(besides, Duration::from_secs_f64(seconds)))?);
            table.add(row);
        }
    }
    Ok(table)
}

async fn run(besides: Besides, time: Duration) -> Result<Vec<String>> {
    let station = Station::start(&KEY)?;
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let since_2015 = since_1970.saturating_sub(Duration::from_secs(SIGNING_EPOCH_S));
    let signing = Signing { key: KEY, epoch: (since_2015.as_micros() / 10) as u64 };
    let start = Instant::now();
    let (mut drones, mut rising) = (Vec::new(), Vec::new());
    for id in 1..=DRONES {
        let body = Body::start(id, signing, station.mavlink, start).await?;
        let feed = Connection::open(station.http, &station.token).await?;
        fail_aloud(tokio::spawn(Arc::clone(&body).feed(feed)));
        let mut pilot = Connection::open(station.http, &station.token).await?;
        let lifted = Arc::clone(&body);
        rising.push(tokio::spawn(async move { lifted.lift(&mut pilot, signing).await }));
        drones.push(body);
    }
    for task in rising {
        task.await.map_err(std::io::Error::other)??;
    }
    let (pushes, requests) = (Times::default(), Times::default());
    for index in 0..SUBSCRIBERS {
        let drone = (index % u32::from(DRONES)) as u8 + 1;
        let watch = listeners::watch(station.http, station.token.clone(), drone, pushes.clone());
        fail_aloud(tokio::spawn(watch));
    }
    for index in 0..listeners::connections(REQUESTS_PER_S) {
        let drone = (index % u32::from(DRONES)) as u8 + 1;
        let ask = listeners::ask(station.http, station.token.clone(), drone, requests.clone());
        fail_aloud(tokio::spawn(ask));
    }
    let photos = SharedSet::open(PHOTOS);
    let mut job = match (besides, &photos) {
        (Besides::Reconstruction, Some(photos)) => Some(station.reconstruct(&photos.images_dir)?),
        (Besides::Reconstruction, None) => {
            return Err(std::io::Error::other(format!("{PHOTOS} is absent")));
        }
        _ => None,
    };
    // What comes while all of them connect is not the load.
    tokio::time::sleep(Duration::from_secs(3)).await;
    let lost_before = num_lost(&station, &drones).await?;
    let (cpu, dropped) = (station.cpu_s(), station.num_dropped());
    let sent: u64 = drones.iter().map(|drone| drone.num_sent()).sum();
    let (_, _) = (pushes.take(), requests.take());
    drones.iter().for_each(|drone| drop(drone.take()));
    let stop = Arc::new(AtomicBool::new(false));
    let flood = (besides == Besides::Flood).then(|| {
        let (to, stop) = (station.mavlink, Arc::clone(&stop));
        std::thread::spawn(move || flood::flood(to, FLOOD_PER_S, &stop))
    });
    let begin = Instant::now();
    while begin.elapsed() < time {
        tokio::time::sleep(Duration::from_millis(200)).await;
        if let (Some(child), Some(photos)) = (&mut job, &photos)
            && child.try_wait()?.is_some()
        {
            *child = station.reconstruct(&photos.images_dir)?;
        }
    }
    let end = Instant::now();
    let seen: Vec<Seen> = drones.iter().map(|drone| drone.take()).collect();
    let cpu = station.cpu_s() - cpu;
    stop.store(true, Ordering::Relaxed);
    if let Some(flood) = flood {
        let sent = flood.join().unwrap_or(Ok(0))?;
        let dropped = station.num_dropped() - dropped;
        eprintln!("{sent} hostile packets, {dropped} datagrams dropped by the kernel");
    }
    if let Some(mut child) = job {
        // It ends with the server otherwise.
        let _ = child.kill();
        let _ = child.wait();
    }
    let mut relays: Vec<Duration> = seen.iter().flat_map(|seen| seen.relays.clone()).collect();
    let sent = drones.iter().map(|drone| drone.num_sent()).sum::<u64>() - sent;
    let refused: u64 = seen.iter().map(|seen| seen.num_refused).sum();
    let slowest = seen.iter().map(|seen| seen.setpoints.len()).min().unwrap_or(0);
    let gap = seen.iter().map(|seen| longest_gap(&seen.setpoints, begin, end)).max();
    let lost = num_lost(&station, &drones).await? - lost_before;
    let (mut pushes, mut requests) = (pushes.take(), requests.take());
    eprintln!(
        "{} relays, {} pushes, {} requests, {sent} messages of drones",
        relays.len(),
        pushes.len(),
        requests.len()
    );
    Ok(vec![
        quantiles(&mut relays),
        quantiles(&mut pushes),
        quantiles(&mut requests),
        figure(slowest as f64 / (end - begin).as_secs_f64(), 1, "Hz"),
        figure(gap.unwrap_or(time).as_secs_f64() * 1e3, 0, "ms"),
        figure(100.0 * lost / sent as f64, 2, "%"),
        format!("{refused} of {}", relays.len() as u64 + refused),
        figure(cpu, 1, "s"),
    ])
}

/// Messages of the drones that the server has missed since the start.
async fn num_lost(station: &Station, drones: &[Arc<Body>]) -> Result<f64> {
    let mut server = Connection::open(station.http, &station.token).await?;
    let mut lost = 0.0;
    for drone in drones {
        let path = format!("/v1/drones/{}/state", drone.id());
        let (_, answer) = server.ask("GET", &path, "").await?;
        let state: serde_json::Value = serde_json::from_slice(&answer)?;
        lost += state["link"]["loss"].as_f64().unwrap_or(1.0) * drone.num_sent() as f64;
    }
    Ok(lost)
}

/// A load that ends early is none.
fn fail_aloud<E: std::fmt::Display + Send + 'static>(
    task: tokio::task::JoinHandle<std::result::Result<(), E>>,
) {
    tokio::spawn(async move {
        if let Ok(Err(error)) = task.await {
            eprintln!("part of the load has ended: {error}");
        }
    });
}

fn longest_gap(times: &[Instant], begin: Instant, end: Instant) -> Duration {
    let all: Vec<Instant> = [&[begin], times, &[end]].concat();
    all.windows(2).map(|pair| pair[1].saturating_duration_since(pair[0])).max().unwrap_or_default()
}

/// The middle one and the one that a hundredth exceeds.
fn quantiles(times: &mut [Duration]) -> String {
    times.sort_unstable();
    let at = |part: f64| {
        let index = (part * times.len() as f64) as usize;
        times.get(index).map_or("-".to_owned(), |t| figure(t.as_secs_f64() * 1e3, 1, "ms"))
    };
    format!("{} / {}", at(0.5), at(0.99))
}
