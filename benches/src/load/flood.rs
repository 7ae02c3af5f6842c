//! Packets of strangers.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage};
use volery_geometry::Rng;
use volery_simulator::{Link, Signing};

/// Between two bursts.
const PAUSE: Duration = Duration::from_millis(1);
/// Sockets they come from.
const SOCKETS: usize = 4;

/// Sends `rate` packets per second until `stop`: signed with a wrong key, unsigned with the number
/// of a drone, MAVLink 1 and garbage. Returns how many.
pub(crate) fn flood(to: SocketAddr, rate: u32, stop: &AtomicBool) -> std::io::Result<u64> {
    let mut rng = Rng::new(5);
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let wrong = Some(Signing { key: [6; 32], epoch: 1 << 45 });
    let mut packets: Vec<Vec<u8>> = (1..=50)
        .flat_map(|id| {
            [wrong, None].map(|key| Link::new(id, 1, key).encode(&heartbeat, Duration::ZERO))
        })
        .collect();
    for _ in 0..packets.len() / 2 {
        let garbage = |rng: &mut Rng| (0..30 + rng.index(200)).map(|_| rng.bits() as u8).collect();
        let random: Vec<u8> = garbage(&mut rng);
        packets.push([&[0xFE], &random[..]].concat());
        packets.push(random);
    }
    let sockets = (0..SOCKETS).map(|_| UdpSocket::bind("127.0.0.1:0"));
    let sockets: Vec<UdpSocket> = sockets.collect::<std::io::Result<_>>()?;
    let (start, mut sent) = (Instant::now(), 0);
    while !stop.load(Ordering::Relaxed) {
        let due = (start.elapsed().as_secs_f64() * f64::from(rate)) as u64;
        while sent < due {
            let packet = &packets[rng.index(packets.len())];
            sockets[rng.index(SOCKETS)].send_to(packet, to)?;
            sent += 1;
        }
        std::thread::sleep(PAUSE);
    }
    Ok(sent)
}
