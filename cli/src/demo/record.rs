//! What the simulation knows to be true of the flight, beside what the map said.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use volery_simulator::Event;
use volery_simulator::shell::{Line, Placed, State};

/// The lines of a simulation, as long as it is listened to.
#[derive(Debug, Clone, Default)]
pub(super) struct Recorder(Arc<Mutex<Recording>>);

#[derive(Debug, Default)]
struct Recording {
    is_over: bool,
    record: Record,
}

/// A flight as it was.
#[derive(Debug, Clone, Default)]
pub(super) struct Record {
    /// True states in the order of time, by drone.
    pub(super) states: BTreeMap<u8, Vec<State>>,
    /// Pictures that were placed, by drone.
    pub(super) placed: BTreeMap<u8, Vec<Placed>>,
    /// How many pictures came to what.
    pub(super) frames: BTreeMap<String, usize>,
    /// What should not have happened.
    pub(super) mishaps: Vec<String>,
}

impl Recorder {
    pub(super) fn add(&self, line: &Line) {
        let mut recording = self.lock();
        if recording.is_over {
            return;
        }
        let record = &mut recording.record;
        match line {
            Line::State(state) => {
                record.states.entry(state.system_id).or_default().push((**state).clone());
            }
            Line::Frame { system_id, frame, placed, .. } => {
                *record.frames.entry(frame.clone()).or_default() += 1;
                if let Some(placed) = placed {
                    record.placed.entry(*system_id).or_default().push((**placed).clone());
                }
            }
            Line::Event { t, system_id, event } => {
                let what = match event {
                    Event::Failsafe { why } => format!("failsafe: {why}"),
                    Event::Crash { speed } => format!("crash at {speed:.1} m/s"),
                    Event::Contact => "contact".to_owned(),
                    Event::TooClose { other, distance } => {
                        format!("{distance:.2} m from drone {other}")
                    }
                    Event::Halted => "the firmware stopped".to_owned(),
                    _ => return,
                };
                record.mishaps.push(format!("{t:.1} s: drone {system_id}: {what}"));
            }
            Line::Camera { .. } => {}
        }
    }

    /// The latest true state of each drone.
    pub(super) fn now(&self) -> BTreeMap<u8, State> {
        let recording = self.lock();
        let last = |(&id, states): (&u8, &Vec<State>)| Some((id, states.last()?.clone()));
        recording.record.states.iter().filter_map(last).collect()
    }

    /// What was recorded; nothing is from now on.
    pub(super) fn finish(&self) -> Record {
        let mut recording = self.lock();
        recording.is_over = true;
        std::mem::take(&mut recording.record)
    }

    fn lock(&self) -> MutexGuard<'_, Recording> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
