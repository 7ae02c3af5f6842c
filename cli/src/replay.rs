//! `volery replay`.

use std::{
    collections::BTreeMap,
    io,
    net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
    time::{Duration, Instant},
};

use volery_flight::tlog::{Record, read_records};
use volery_pipeline::{PipelineError, error::code};

use crate::{
    args::ReplayArgs,
    input,
    output::{Ending, Outcome, print_json},
};

/// The greatest system id that drones have; those above are ground stations.
const MAX_DRONE: u8 = 254;

pub(crate) fn run(args: &ReplayArgs, json: bool) -> Outcome {
    let log = input::read(&args.file)?;
    let records: Vec<Record<'_>> = read_records(&log).collect();
    if records.is_empty() {
        let detail = format!("{} is no telemetry log", args.file.display());
        return Err(PipelineError::plain(code::BAD_INPUT, detail));
    }
    let sent = play(&records, args.mavlink, args.speed);
    let num_sent = sent.map_err(|error| PipelineError::plain(code::IO, error.to_string()))?;
    eprintln!("{num_sent} messages sent to {}", args.mavlink);
    if json {
        print_json(&serde_json::json!({ "num_sent": num_sent, "mavlink": args.mavlink }));
    }
    Ok(Ending::Done)
}

/// Sends what drones said at the pace at which they said it, each from an address of its own.
/// Returns how many frames that were.
fn play(records: &[Record<'_>], to: SocketAddr, speed: f64) -> io::Result<usize> {
    let local: SocketAddr = match to {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let (mut sockets, mut num_sent) = (BTreeMap::new(), 0);
    let (begun, first) = (Instant::now(), records.first().map_or(Duration::ZERO, |r| r.time));
    for record in records {
        let system_id = record.frame[5];
        if system_id > MAX_DRONE {
            continue;
        }
        let due = begun + record.time.saturating_sub(first).div_f64(speed);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let socket = match sockets.entry(system_id) {
            std::collections::btree_map::Entry::Occupied(known) => known.into_mut(),
            std::collections::btree_map::Entry::Vacant(new) => new.insert(UdpSocket::bind(local)?),
        };
        // A server that does not listen yet may listen later.
        num_sent += usize::from(socket.send_to(record.frame, to).is_ok());
    }
    Ok(num_sent)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of this sender, as far as this file looks into it.
    fn frame(system_id: u8, number: u8) -> [u8; 12] {
        [0xfd, 0, 0, 0, number, system_id, 1, 0, 0, 0, 0, 0]
    }

    #[test]
    fn drones_say_again_what_they_said_in_order() {
        let server = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        server.set_read_timeout(Some(Duration::from_secs(9))).unwrap();
        let said = [frame(1, 0), frame(255, 1), frame(2, 2), frame(1, 3)];
        let records: Vec<_> = (0..)
            .map(Duration::from_secs)
            .zip(&said)
            .map(|(time, frame)| Record { time, frame })
            .collect();
        assert_eq!(play(&records, server.local_addr().unwrap(), 1e4).unwrap(), 3);
        let mut froms = Vec::new();
        for number in [0, 2, 3] {
            let mut buffer = [0; 64];
            let (length, from) = server.recv_from(&mut buffer).unwrap();
            assert_eq!((length, buffer[4]), (12, number));
            froms.push(from);
        }
        assert!(froms[0] == froms[2] && froms[0] != froms[1], "{froms:?}");
    }
}
