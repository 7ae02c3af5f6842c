//! The parameters of the drones that are heard, before they are flown.

use std::{
    net::{SocketAddr, UdpSocket},
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use volery_flight::{
    Key,
    parameters::{Finding, Inspected, Inspector},
    signing_time,
};

use super::Check;

/// Drones say that they are there once a second.
const LISTEN: Duration = Duration::from_secs(3);
/// Longest inspection of all of them.
const PATIENCE: Duration = Duration::from_secs(30);
const RECEIVE_TIMEOUT: Duration = Duration::from_millis(10);
const MAX_DATAGRAM: usize = 2048;

/// A signing clock that is further off is worth a word: behind by a minute, a drone is not heard;
/// ahead, its recorded messages would be good until that time.
const MAX_CLOCK_ERROR_S: f64 = 10.0;

/// Listens where drones send to, and looks at everyone who is heard.
pub(super) fn checks(listen: SocketAddr, key: Option<[u8; 32]>) -> Vec<Check> {
    match inspect(listen, key) {
        Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => {
            vec![bad(format!("udp:{listen} is taken: end the server that listens there"))]
        }
        Err(error) => vec![bad(format!("udp:{listen}: {error}"))],
        Ok(inspector) if inspector.vehicles().is_empty() => {
            vec![bad(format!("nobody was heard on udp:{listen}"))]
        }
        Ok(inspector) => {
            let all = inspector.vehicles().iter();
            all.flat_map(|(id, inspected)| checks_of(id.0, inspected)).collect()
        }
    }
}

fn inspect(listen: SocketAddr, key: Option<[u8; 32]>) -> std::io::Result<Inspector> {
    let socket = UdpSocket::bind(listen)?;
    socket.set_read_timeout(Some(RECEIVE_TIMEOUT))?;
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let mut inspector = Inspector::new(key.map(Key), signing_time(since_epoch));
    let start = Instant::now();
    let mut buffer = [0; MAX_DATAGRAM];
    loop {
        if let Ok((length, from)) = socket.recv_from(&mut buffer) {
            inspector.receive(&buffer[..length], from, start.elapsed());
        }
        let now = start.elapsed();
        if now > PATIENCE || now > LISTEN && inspector.is_done() {
            return Ok(inspector);
        }
        for datagram in inspector.poll(now) {
            socket.send_to(&datagram.bytes, datagram.to)?;
        }
    }
}

fn checks_of(id: u8, inspected: &Inspected) -> Vec<Check> {
    let mut checks = Vec::new();
    if inspected.addresses.len() > 1 {
        checks.push(bad(format!("{id}: two drones have this number; give them their own")));
    }
    let clock = inspected.clock_ahead.filter(|ahead| ahead.abs() > MAX_CLOCK_ERROR_S);
    checks.extend(clock.map(|ahead| {
        let side = if ahead > 0.0 { "ahead" } else { "behind" };
        let error = ahead.abs();
        bad(format!(
            "{id}: its signing clock is {error:.0} s {side}; it takes its time from \
                     whoever sets up its key: set the key anew"
        ))
    }));
    let findings = inspected.inspection.findings();
    if findings.iter().all(|finding| finding.value.is_none()) && !findings.is_empty() {
        if inspected.clock_ahead.is_none() {
            let why = "it tells no parameters; does it sign with another key?";
            checks.push(bad(format!("{id}: {why}")));
        }
        return checks;
    }
    checks.extend(findings.iter().map(|finding| Check {
        name: "parameter",
        ok: finding.rule.is_advice,
        detail: words(id, finding),
    }));
    if checks.iter().all(|check| check.ok) {
        let autopilot = inspected.inspection.autopilot().name();
        let clock = inspected.clock_ahead;
        let clock = clock.map_or(String::new(), |s| format!(", signing clock {s:+.1} s"));
        let detail = format!("{id}: {autopilot}, set up for flight by camera{clock}");
        checks.insert(0, Check { name: "drone", ok: true, detail });
    }
    checks
}

fn words(id: u8, finding: &Finding) -> String {
    let rule = finding.rule;
    let is = finding.value.map_or("unknown".to_owned(), |value| value.to_string());
    let should = if rule.is_advice { "better" } else { "must be" };
    format!("{id}: {} is {is}, {should} {}: {}", rule.names[0], rule.wanted, rule.why)
}

fn bad(detail: String) -> Check {
    Check { name: "drone", ok: false, detail }
}
