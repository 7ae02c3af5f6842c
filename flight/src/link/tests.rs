use mavlink::dialects::ardupilotmega::{EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, MavCmd};

use super::*;

const ID: VehicleId = VehicleId(1);
const LANDED_STATE: u32 = 245;

/// Requests of one stream in a minute in which it comes `rate` times a second.
fn num_requests(stream: u32, rate: f64) -> usize {
    let mut link = Link::new(Duration::ZERO);
    let mut next = 0.0;
    let mut requests = 0;
    for step in 0..6000_u32 {
        let now = Duration::from_millis(10) * step;
        if now.as_secs_f64() >= next {
            next += 1.0 / rate;
            for message in [
                MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA::default()),
                MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()),
            ] {
                link.take(ID, 0, &message, now);
            }
        }
        requests += link
            .poll(ID, false, now)
            .iter()
            .filter(|message| match message {
                MavMessage::COMMAND_LONG(m) => {
                    m.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL && m.param1 == stream as f32
                }
                _ => false,
            })
            .count();
    }
    requests
}

/// A vehicle that sends a message at half the rate by itself has not heard the request; one that
/// sends at the rate that it was asked for is left alone, also when some are lost.
#[test]
fn a_request_that_was_lost_is_made_again() {
    assert_eq!(num_requests(LANDED_STATE, 2.0), 1);
    assert_eq!(num_requests(LANDED_STATE, 1.6), 1);
    assert!(num_requests(LANDED_STATE, 1.0) > 10);
    assert!(num_requests(LANDED_STATE, 0.3) > 10);
}

/// A vehicle whose failsafe waits for two seconds hears us several times meanwhile.
#[test]
fn heartbeats_come_four_times_a_second() {
    let mut link = Link::new(Duration::ZERO);
    let beats =
        (0..1000_u32).flat_map(|step| link.poll(ID, false, Duration::from_millis(10) * step));
    let beats = beats.filter(|message| matches!(message, MavMessage::HEARTBEAT(_))).count();
    assert_eq!(beats, 40);
}

/// Dies if a message that was overtaken counts as missed, or as the newest.
#[test]
fn what_was_overtaken_is_not_lost() {
    let loss = |sequences: &[u8]| {
        let mut link = Link::new(Duration::ZERO);
        for &sequence in sequences {
            let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
            link.take(ID, sequence, &heartbeat, Duration::ZERO);
        }
        link.loss()
    };
    assert_eq!(loss(&[250, 252, 251, 254, 253, 255, 1, 0, 2]), 0.0);
    assert_eq!(loss(&[254, 255, 2, 1, 3]), 1.0 / 6.0);
}
