//! Asks one vehicle for its parameters.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA,
};
use mavlink::types::CharArray;

use super::rules::{Rule, rules};
use crate::{Autopilot, VehicleId, message};

/// Parameters that are asked for at once.
const AT_ONCE: usize = 6;
/// For an answer, before it is asked again, and how often.
const PATIENCE: Duration = Duration::from_millis(300);
const MAX_REQUESTS: u32 = 5;

/// A parameter that is not as it should be.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Its rule.
    pub rule: &'static Rule,
    /// What it is; `None` where the vehicle did not say.
    pub value: Option<f64>,
}

/// The inspection of one vehicle.
#[derive(Debug, Clone)]
pub struct Inspection {
    vehicle: VehicleId,
    autopilot: Autopilot,
    questions: Vec<Question>,
}

/// One parameter under one of its names.
#[derive(Debug, Clone)]
struct Question {
    rule: &'static Rule,
    name: &'static str,
    value: Option<f64>,
    num_requests: u32,
    due: Duration,
}

impl Question {
    fn is_open(&self) -> bool {
        self.value.is_none() && self.num_requests < MAX_REQUESTS
    }
}

impl Inspection {
    /// Of a vehicle that was heard.
    pub fn new(vehicle: VehicleId, autopilot: Autopilot) -> Self {
        let ask = |rule: &'static Rule| {
            let question = move |name| Question {
                rule,
                name,
                value: None,
                num_requests: 0,
                due: Duration::ZERO,
            };
            rule.names.iter().copied().map(question)
        };
        Self { vehicle, autopilot, questions: rules(autopilot).iter().flat_map(ask).collect() }
    }

    /// What to send at `now`.
    pub fn poll(&mut self, now: Duration) -> Vec<MavMessage> {
        let vehicle = self.vehicle;
        let open = self.questions.iter_mut().filter(|question| question.is_open());
        let due = open.take(AT_ONCE).filter(|question| now >= question.due);
        due.map(|question| {
            question.num_requests += 1;
            question.due = now + PATIENCE;
            request(vehicle, question.name)
        })
        .collect()
    }

    /// Takes a message of the vehicle.
    pub fn receive(&mut self, message: &MavMessage) {
        let MavMessage::PARAM_VALUE(told) = message else { return };
        let Ok(name) = told.param_id.to_str() else { return };
        let Some(rule) = self.questions.iter().find(|q| q.name == name).map(|q| q.rule) else {
            return;
        };
        // Its other names need not be asked for.
        for question in self.questions.iter_mut().filter(|q| q.rule == rule) {
            question.value = Some(value(told, self.autopilot));
        }
    }

    /// Of which autopilot.
    pub fn autopilot(&self) -> Autopilot {
        self.autopilot
    }

    /// Whether all was answered, or asked often enough.
    pub fn is_done(&self) -> bool {
        !self.questions.iter().any(Question::is_open)
    }

    /// What is not as it should be, or not known.
    pub fn findings(&self) -> Vec<Finding> {
        let rules = rules(self.autopilot).iter();
        rules
            .filter_map(|rule| {
                let asked = self.questions.iter().find(|question| question.rule == rule);
                let value = asked.and_then(|question| question.value);
                let is_good = value.is_some_and(|value| rule.wanted.holds(value));
                (!is_good).then_some(Finding { rule, value })
            })
            .collect()
    }
}

fn request(vehicle: VehicleId, name: &str) -> MavMessage {
    MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
        // By the name.
        param_index: -1,
        target_system: vehicle.0,
        target_component: message::AUTOPILOT_COMPONENT,
        param_id: CharArray::from(name),
    })
}

/// ArduPilot casts whole numbers to the field's f32, PX4 puts their bits into it.
fn value(told: &PARAM_VALUE_DATA, autopilot: Autopilot) -> f64 {
    let bits = told.param_value.to_bits();
    match (autopilot, told.param_type) {
        (Autopilot::Px4, MavParamType::MAV_PARAM_TYPE_INT32) => f64::from(bits.cast_signed()),
        (Autopilot::Px4, MavParamType::MAV_PARAM_TYPE_UINT32) => f64::from(bits),
        _ => f64::from(told.param_value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(name: &str, param_value: f32, param_type: MavParamType) -> MavMessage {
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value,
            param_count: 1,
            param_index: 0,
            param_id: CharArray::from(name),
            param_type,
        })
    }

    /// What never answers is asked a few times, and then told of as unknown.
    #[test]
    fn silence_is_a_finding() {
        let mut inspection = Inspection::new(VehicleId(1), Autopilot::Px4);
        let (mut now, mut num_sent) = (Duration::ZERO, 0);
        while !inspection.is_done() {
            num_sent += inspection.poll(now).len();
            now += Duration::from_millis(50);
            assert!(now < Duration::from_secs(60), "it never ends");
        }
        assert_eq!(num_sent, rules(Autopilot::Px4).len() * MAX_REQUESTS as usize);
        let findings = inspection.findings();
        assert_eq!(findings.len(), rules(Autopilot::Px4).len());
        assert!(findings.iter().all(|finding| finding.value.is_none()));
    }

    /// Whole numbers come as bits from PX4 and as numbers from ArduPilot; the name that an older
    /// firmware has will do.
    #[test]
    fn values_are_read_as_each_autopilot_writes_them() {
        let int = MavParamType::MAV_PARAM_TYPE_INT32;
        let mut px4 = Inspection::new(VehicleId(1), Autopilot::Px4);
        px4.receive(&answer("EKF2_EV_CTRL", f32::from_bits(11), int));
        px4.receive(&answer("SYS_HAS_GPS", f32::from_bits(1), int));
        let names = |inspection: &Inspection| {
            inspection
                .findings()
                .into_iter()
                .map(|f| (f.rule.names[0], f.value))
                .collect::<Vec<_>>()
        };
        assert!(!names(&px4).iter().any(|(name, _)| *name == "EKF2_EV_CTRL"));
        assert!(names(&px4).contains(&("SYS_HAS_GPS", Some(1.0))));
        let mut ardupilot = Inspection::new(VehicleId(1), Autopilot::ArduPilot);
        ardupilot.receive(&answer("GPS_TYPE", 0.0, int));
        ardupilot.receive(&answer("EK3_SRC1_YAW", 1.0, int));
        assert!(!names(&ardupilot).iter().any(|(name, _)| *name == "GPS1_TYPE"));
        assert!(names(&ardupilot).contains(&("EK3_SRC1_YAW", Some(1.0))));
    }
}
