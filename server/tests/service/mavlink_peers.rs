//! MAVLink as others speak it: a vehicle on the server plugins of MAVSDK, and MAVProxy between.
//!
//! They need a Python with `mavsdk` and `MAVProxy`, which `./run test` installs.

use std::{
    net::{SocketAddr, UdpSocket},
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

use volery_server::MavlinkSettings;

use crate::support::{
    self, Folder, Server,
    peers::{self, Peers, tour, until_undisturbed},
};

/// Largest true distance from a target, meters.
const LIMIT: f64 = 0.15;

async fn server() -> Server {
    Server::start_with(|config| {
        config.mavlink = Some(MavlinkSettings {
            accept_unsigned: true,
            ..MavlinkSettings::new(SocketAddr::from(([127, 0, 0, 1], 0)))
        });
    })
    .await
}

/// A process that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An address that nobody listens at.
fn free_address() -> SocketAddr {
    UdpSocket::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap()
}

/// MAVSDK acknowledges modes, arming and intervals as a PX4, and tells where the vehicle is.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_vehicle_of_mavsdk_flies_to_its_targets() {
    let Some(python) = support::python("mavsdk, pymavlink") else { return };
    until_undisturbed("MAVSDK", LIMIT, || fly_mavsdk(&python)).await;
}

/// The worst true error at a target, and the longest pause of the vehicle.
async fn fly_mavsdk(python: &Path) -> (Result<f64, String>, Duration) {
    let server = server().await;
    let address = server.running.mavlink_addr().unwrap().to_string();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = root.join("tests/service/support/mavsdk_vehicle.py");
    let mut command = Command::new(python);
    command.arg(script).args(["--server", &address]);
    let peers = Peers::start(&mut command, &server.client);
    let worst = tour(&server.client, &peers, 1, "MAVSDK").await;
    let silence = peers.truth().longest_silence;
    (worst, silence)
}

/// A drone flies whose datagrams all pass the ground station of its pilot, which forwards both ways
/// and is itself heard by the drone.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drone_behind_mavproxy_flies_to_its_targets() {
    let Some(script) = peers::drone_sim() else { return };
    let Some(python) = support::python("pymavlink, MAVProxy") else { return };
    let fly = async |flavor: &str| {
        let what = format!("{flavor} behind MAVProxy");
        let fly = || fly_behind_mavproxy(flavor, &what, &python, &script);
        until_undisturbed(&what, LIMIT, fly).await;
    };
    tokio::join!(fly("ardupilot"), fly("px4"));
}

/// The worst true error at a target, and the longest pause of the simulator.
async fn fly_behind_mavproxy(
    flavor: &str,
    what: &str,
    python: &Path,
    script: &Path,
) -> (Result<f64, String>, Duration) {
    let server = server().await;
    let (folder, master) = (Folder::new(), free_address().to_string());
    let service = server.running.mavlink_addr().unwrap();
    let mut proxy = Command::new(python.with_file_name("mavproxy.py"));
    proxy.args([format!("--master=udpin:{master}"), format!("--out=udpout:{service}")]);
    proxy.args(["--non-interactive", "--default-modules="]).current_dir(&folder.0);
    proxy.arg(format!("--state-basedir={}", folder.0.display()));
    // It runs until its input ends.
    proxy.stdin(Stdio::piped()).stdout(Stdio::null());
    let _proxy = Running(proxy.spawn().unwrap());
    let mut command = Command::new(python);
    command.arg(script).args(["--server", &master, "--flavor", flavor, "--report-hz", "20"]);
    let peers = Peers::start(&mut command, &server.client);
    let worst = tour(&server.client, &peers, 1, what).await;
    let truth = peers.truth();
    assert!(truth.mishaps.is_empty(), "{what}: {:?}", truth.mishaps);
    (worst, truth.longest_silence)
}
