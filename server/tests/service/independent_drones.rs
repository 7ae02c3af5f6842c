//! Drones that others wrote fly over this service: a simulator on pymavlink that flies on nothing
//! but the poses it is sent. Its true positions are the measure.
//!
//! It needs `../shared/tools/drone_sim` and a Python with pymavlink; `./run test` installs the
//! latter. `VOLERY_LONG=1` flies every combination.

use std::{net::SocketAddr, path::Path, process::Command, time::Duration};

use volery_server::MavlinkSettings;

use crate::support::{
    self, Server,
    peers::{self, Peers, tour, until_undisturbed},
};

const COUNT: u8 = 3;
const KEY: &str = "8899aabbccddeeff00112233445566778899aabbccddeeff0011223344556677";

#[derive(Debug, Clone, Copy)]
struct Trial {
    flavor: &'static str,
    signed: bool,
    bad_link: bool,
}

impl Trial {
    /// Largest true distance from a target, meters.
    fn limit(&self) -> f64 {
        if self.bad_link { 0.30 } else { 0.15 }
    }
}

/// Discovered, fed, taken off, five targets each, landed; the worst true error at a target, and
/// the longest pause of the simulator.
async fn fly(trial: Trial, python: &Path, script: &Path) -> (Result<f64, String>, Duration) {
    let what = format!("{trial:?}");
    let server = Server::start_with(|config| {
        let listen = SocketAddr::from(([127, 0, 0, 1], 0));
        config.mavlink = Some(MavlinkSettings {
            key: trial.signed.then(|| MavlinkSettings::parse_key(KEY).unwrap()),
            accept_unsigned: !trial.signed,
            ..MavlinkSettings::new(listen)
        });
    })
    .await;
    let client = &server.client;
    let address = server.running.mavlink_addr().unwrap().to_string();
    let mut command = Command::new(python);
    // A quarter of a second without a newer pose lands these drones: where a fifth is lost and
    // some are overtaken, 20 a second are too few for more than a minute. The simulator moves in
    // steps of 20 ms, so that of higher rates only 50 is an even one.
    let rate = if trial.bad_link { "50" } else { "20" };
    command.arg(script).args(["--server", &address, "--count", "3", "--report-hz", rate]);
    command.args(["--flavor", trial.flavor, "--duration", "240"]);
    if trial.signed {
        command.args(["--signing-key", KEY]);
    }
    if trial.bad_link {
        command.args(["--loss", "0.2", "--delay", "0.15"]);
    }
    let peers = Peers::start(&mut command, client);
    let worst = tour(client, &peers, COUNT, &what).await;
    let truth = peers.truth();
    assert!(truth.mishaps.is_empty(), "{what}: {:?}", truth.mishaps);
    (worst, truth.longest_silence)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn drones_of_others_fly_to_their_targets() {
    let (Some(script), Some(python)) = (peers::drone_sim(), support::python("pymavlink")) else {
        return;
    };
    let long = std::env::var_os("VOLERY_LONG").is_some();
    let mut trials = Vec::new();
    for flavor in ["ardupilot", "px4"] {
        for signed in [false, true] {
            for bad_link in [false, true] {
                // In short: a good link; a bad one is flown in simulated time as well, where no
                // busy machine comes between.
                let short = (flavor == "px4") == signed && !bad_link;
                if long || short {
                    trials.push(Trial { flavor, signed, bad_link });
                }
            }
        }
    }
    let mut num_failed = 0;
    // Two at a time: every drone of these simulators takes a part of a core.
    for pair in trials.chunks(2) {
        let flights: Vec<_> = pair
            .iter()
            .map(|&trial| {
                let (python, script) = (python.clone(), script.clone());
                let what = format!("{trial:?}");
                tokio::spawn(async move {
                    until_undisturbed(&what, trial.limit(), || fly(trial, &python, &script)).await;
                })
            })
            .collect();
        for flight in flights {
            num_failed += u32::from(flight.await.is_err());
        }
    }
    assert_eq!(num_failed, 0, "of {} flights", trials.len());
}
