//! Flights are recorded, and seen again.

use std::{collections::BTreeSet, net::UdpSocket, process::Command};

use serde_json::{Value, json};
use volery_flight::tlog::{Record, read_records};
use volery_simulator::{DroneOptions, Flavor};

use crate::support::{self, field, field::Field};

/// Counts of messages by system id and name, as pymavlink reads a log.
const COUNT: &str = r#"
import collections, json, os, sys
os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
log = mavutil.mavlink_connection(sys.argv[1])
counts = collections.Counter()
stamps = []
while (message := log.recv_match()) is not None:
    counts[f"{message.get_srcSystem()} {message.get_type()}"] += 1
    stamps.append(message._timestamp)
assert stamps == sorted(stamps)
print(json.dumps(counts))
"#;

fn system_id(record: &Record<'_>) -> u8 {
    record.frame[5]
}

/// From its start to its end: what the drone said and what it was told, for pymavlink too; a service
/// that hears it once more shows the drone where it was.
#[tokio::test]
async fn a_flight_is_recorded_and_seen_again() {
    let server = field::server().await;
    let client = &server.client;
    let wish = json!({"drone": 1});
    client.post("/v1/recordings", wish.clone()).await.expect(404);
    let start = DroneOptions::new(1, Flavor::ArduPilot, [2.0, -3.0, 0.0].into());
    let field = Field::open(&server, vec![start]);
    field.until("/v1/drones/1", |drone| drone["state"]["link"]["state"] == "linked").await;
    let made = client.post("/v1/recordings", wish.clone()).await.expect(201);
    let path = made.header("location").unwrap().to_owned();
    assert_eq!((&made.json()["drone"], &made.json()["running"]), (&json!(1), &json!(true)));
    assert_eq!(client.post("/v1/recordings", wish).await.expect(409).code(), "recording_runs");
    field.take_off(&[1], 1.0).await;
    let stopped = client.post(&format!("{path}/stop"), json!(null)).await.expect(200).json();
    assert_eq!(stopped["running"], false);
    let list = client.get("/v1/recordings").await.expect(200).json();
    assert_eq!(list["items"], json!([stopped]));

    let log = client.get(&path).await.expect(200).body;
    assert_eq!(stopped["size"], log.len());
    let records: Vec<Record<'_>> = read_records(&log).collect();
    let bytes: usize = records.iter().map(|record| 8 + record.frame.len()).sum();
    assert_eq!(bytes, log.len(), "nothing but records");
    assert!(records.is_sorted_by_key(|record| record.time));
    let senders: BTreeSet<u8> = records.iter().map(system_id).collect();
    assert_eq!(senders, [1, 255].into());
    if let Some(python) = support::python("pymavlink") {
        let file = server.folder.0.join("flight.tlog");
        std::fs::write(&file, &log).unwrap();
        let run = Command::new(python).args(["-c", COUNT]).arg(&file).output().unwrap();
        let error = String::from_utf8_lossy(&run.stderr);
        let counts: Value =
            serde_json::from_slice(&run.stdout).unwrap_or_else(|e| panic!("{e}: {error}"));
        let total: u64 = counts.as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
        assert_eq!(total, records.len() as u64, "{counts}");
        for kind in ["1 HEARTBEAT", "1 LOCAL_POSITION_NED", "255 VISION_POSITION_ESTIMATE"] {
            assert!(counts[kind].as_u64() > Some(3), "{counts}");
        }
    }
    field.close().await;

    let again = field::server().await;
    let drone = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let address = again.running.mavlink_addr().unwrap();
    for record in records.iter().filter(|record| system_id(record) == 1) {
        drone.send_to(record.frame, address).unwrap();
    }
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(30);
    loop {
        let state = again.client.get("/v1/drones/1/state").await;
        if state.status == 200 && state.json()["armed"] == true {
            let position = state.json()["estimate"]["position"].clone();
            let [x, y, z]: [f64; 3] = serde_json::from_value(position).unwrap();
            assert!((x - 2.0).hypot(y + 3.0) < 0.3 && (z - 1.0).abs() < 0.3, "{x} {y} {z}");
            break;
        }
        assert!(std::time::Instant::now() < deadline, "{state:?}");
    }

    client.delete(&path).await.expect(204);
    client.get(&path).await.expect(404);
    assert_eq!(client.get("/v1/recordings").await.expect(200).json()["items"], json!([]));
}
