use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage};
use volery_geometry::Rng;

use super::*;
use crate::wire::{read_frame, write_frame};

const KEY: Key = Key([3; 32]);
const SENDER: Sender = Sender { system_id: 7, component_id: 1 };
/// Some time late in 2026.
const NOW: u64 = 37_500_000_000_000;

/// What becomes of a heartbeat that was signed at `time` on a link.
fn verify(verifier: &mut Verifier, link_id: u8, time: u64) -> Result<(), SignatureError> {
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let bytes = write_frame(SENDER, 0, &heartbeat, Some((&KEY, link_id, time)));
    verifier.verify(&KEY, &read_frame(&bytes).0.unwrap(), NOW)
}

/// A frame that others have overtaken is taken, once; so is each of the others.
#[test]
fn what_was_overtaken_is_taken_once() {
    let mut verifier = Verifier::default();
    let times = [0, 300, 100, 200, 400].map(|time| NOW + time);
    for time in times {
        assert_eq!(verify(&mut verifier, 0, time), Ok(()));
    }
    for time in times {
        assert_eq!(verify(&mut verifier, 0, time), Err(SignatureError::Replayed), "{time}");
    }
    assert_eq!(verify(&mut verifier, 1, times[1]), Ok(()), "each link has its own times");
}

/// Dies if only what was taken is refused: a frame that somebody has held back is no news any more,
/// also on a stream that has been quiet meanwhile.
#[test]
fn what_comes_too_late_is_not_taken() {
    let mut verifier = Verifier::default();
    assert_eq!(verify(&mut verifier, 0, NOW), Ok(()));
    let latest = NOW + 10 * TICKS_PER_S;
    assert_eq!(verify(&mut verifier, 0, latest), Ok(()));
    let too_late = latest - MAX_LATE - 1;
    assert_eq!(verify(&mut verifier, 0, too_late), Err(SignatureError::Replayed));
    assert_eq!(verify(&mut verifier, 0, latest - MAX_LATE), Ok(()));
    // What is remembered over a restart has no window: all of it may have been taken.
    let mut restarted = Verifier::default();
    verifier.times().for_each(|time| restarted.remember(time));
    assert_eq!(verify(&mut restarted, 0, latest - 1), Err(SignatureError::Replayed));
    assert_eq!(verify(&mut restarted, 0, latest + 1), Ok(()));
}

/// Frames that come late, twice, again after seconds, or never: none is taken twice, and all that
/// are at most a second behind the newest are taken, however many are remembered.
#[test]
fn nothing_is_taken_twice() {
    let mut rng = Rng::new(5);
    let mut verifier = Verifier::default();
    assert_eq!(verify(&mut verifier, 0, NOW), Ok(()));
    // Four hundred frames a second.
    let frames = (1..8000_u64).map(|i| NOW + i * TICKS_PER_S / 400);
    let mut arrivals: Vec<(u64, u64)> = frames
        .flat_map(|time| {
            let copies =
                [0.9, 3.0].map(|late| time + (rng.uniform() * late * TICKS_PER_S as f64) as u64);
            copies.map(|at| (at, time))
        })
        .collect();
    arrivals.sort_unstable();
    let mut taken = BTreeSet::from([NOW]);
    let mut latest = NOW;
    for (_, time) in arrivals {
        let is_new = time + MAX_LATE >= latest && !taken.contains(&time);
        assert_eq!(verify(&mut verifier, 0, time).is_ok(), is_new, "{time}");
        if is_new {
            taken.insert(time);
            latest = latest.max(time);
        }
    }
    assert_eq!(taken.len(), 8000, "each came once within a second");
}
