//! The address that drones send to: one socket for everybody, and one for each drone that is known.
//!
//! The kernel hands a datagram to the socket that is connected to its sender. So what strangers
//! send fills a buffer of their own, and no drone loses a message to them.

use std::{
    collections::{BTreeMap, BTreeSet},
    io::{ErrorKind, Result},
    mem::MaybeUninit,
    net::{SocketAddr, UdpSocket},
    os::fd::OwnedFd,
    time::Duration,
};

use rustix::{
    event::{Timespec, epoll},
    net::{AddressFamily, SocketFlags, SocketType, bind, connect, socket_with, sockopt},
};

/// Bytes that may wait while the thread is not running: two seconds of fifty drones.
const COMMON_BUFFER: usize = 8 << 20;
/// The same for one drone.
const OWN_BUFFER: usize = 256 << 10;
/// Largest datagram of a drone.
const MAX_DATAGRAM: usize = 2048;
/// Datagrams of one socket that are taken before the others have their turn.
const TURN: usize = 64;
/// Sockets that are looked at in one round.
const ROUND: usize = 256;
/// Number of the common socket in the list of those that have something.
const COMMON: u64 = 0;

/// All sockets of the address.
#[derive(Debug)]
pub(super) struct Sockets {
    epoll: OwnedFd,
    common: UdpSocket,
    address: SocketAddr,
    own: BTreeMap<u64, (SocketAddr, UdpSocket)>,
    last: u64,
    /// Numbers of those that have something.
    ready: Vec<u64>,
}

/// The common socket at `listen`, and the bytes that may wait in it.
pub(super) fn open(listen: SocketAddr) -> Result<(UdpSocket, usize)> {
    let socket = UdpSocket::bind(listen)?;
    socket.set_nonblocking(true)?;
    sockopt::set_socket_recv_buffer_size(&socket, COMMON_BUFFER)?;
    // Not before it is bound: nobody else can take part in the address.
    sockopt::set_socket_reuseport(&socket, true)?;
    let granted = sockopt::socket_recv_buffer_size(&socket)?;
    Ok((socket, granted))
}

impl Sockets {
    pub(super) fn new(common: UdpSocket) -> Result<Self> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC)?;
        let data = epoll::EventData::new_u64(COMMON);
        epoll::add(&epoll, &common, data, epoll::EventFlags::IN)?;
        let address = common.local_addr()?;
        let (own, ready) = (BTreeMap::new(), Vec::with_capacity(ROUND));
        Ok(Self { epoll, common, address, own, last: COMMON, ready })
    }

    /// Until something has come, or `timeout` is over.
    pub(super) fn wait(&mut self, timeout: Duration) {
        let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(timeout.subsec_nanos()) };
        let mut events = [MaybeUninit::uninit(); ROUND];
        // Interrupted: nothing is ready.
        let ready = epoll::wait(&self.epoll, &mut events[..], Some(&timeout));
        let ready = ready.map_or(&mut [][..], |(ready, _)| ready);
        self.ready.clear();
        self.ready.extend(ready.iter().map(|event| event.data.u64()));
        // Those who are known come first.
        self.ready.sort_unstable_by_key(|number| *number == COMMON);
    }

    /// Hands over what has come.
    pub(super) fn receive(&self, mut take: impl FnMut(&[u8], SocketAddr)) {
        let mut buffer = [0; MAX_DATAGRAM];
        for number in &self.ready {
            let socket = match *number {
                COMMON => Some(&self.common),
                _ => self.own.get(number).map(|(_, socket)| socket),
            };
            let Some(socket) = socket else { continue };
            for _ in 0..TURN {
                match socket.recv_from(&mut buffer) {
                    Ok((length, from)) => take(&buffer[..length], from),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                    // What was sent to a drone did not arrive; it is noticed by its silence.
                    Err(_) => {}
                }
            }
        }
    }

    /// Exactly these senders have sockets of their own.
    pub(super) fn follow(&mut self, senders: &BTreeSet<SocketAddr>) {
        // A closed socket is watched no more.
        self.own.retain(|_, (of, _)| senders.contains(of));
        for &sender in senders {
            if self.own.values().any(|(of, _)| *of == sender) {
                continue;
            }
            match self.open_own(sender) {
                Ok(socket) => _ = self.own.insert(self.last, (sender, socket)),
                // It is heard at the common one.
                Err(error) => tracing::debug!(%error, %sender, "no socket of its own"),
            }
        }
    }

    fn open_own(&mut self, sender: SocketAddr) -> Result<UdpSocket> {
        let family = if sender.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = socket_with(family, SocketType::DGRAM, flags, None)?;
        sockopt::set_socket_recv_buffer_size(&socket, OWN_BUFFER)?;
        sockopt::set_socket_reuseport(&socket, true)?;
        // What comes between these two is heard as at the common one.
        bind(&socket, &self.address)?;
        connect(&socket, &sender)?;
        self.last += 1;
        epoll::add(
            &self.epoll,
            &socket,
            epoll::EventData::new_u64(self.last),
            epoll::EventFlags::IN,
        )?;
        Ok(socket.into())
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    const HERE: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);
    const PATIENCE: Duration = Duration::from_millis(900);

    fn heard(sockets: &mut Sockets) -> Vec<(Vec<u8>, SocketAddr)> {
        let mut all = Vec::new();
        sockets.wait(PATIENCE);
        sockets.receive(|bytes, from| all.push((bytes.to_vec(), from)));
        all
    }

    #[test]
    fn strangers_fill_a_buffer_of_their_own() {
        let (common, _) = open(HERE).unwrap();
        let to = common.local_addr().unwrap();
        let mut sockets = Sockets::new(common).unwrap();
        let [known, stranger] = [(); 2].map(|()| UdpSocket::bind(HERE).unwrap());
        let known_at = known.local_addr().unwrap();
        known.send_to(b"first", to).unwrap();
        assert_eq!(heard(&mut sockets), [(b"first".to_vec(), known_at)]);

        sockets.follow(&[known_at].into());
        // More than any buffer holds.
        for _ in 0..3 * COMMON_BUFFER / MAX_DATAGRAM {
            stranger.send_to(&[0; MAX_DATAGRAM], to).unwrap();
        }
        known.send_to(b"second", to).unwrap();
        let all = heard(&mut sockets);
        assert_eq!(all[0], (b"second".to_vec(), known_at), "the known one comes first");
        assert_eq!(all.len(), 1 + TURN);

        // Whoever is not known any more is heard at the common one again.
        while !heard(&mut sockets).is_empty() {}
        sockets.follow(&BTreeSet::new());
        known.send_to(b"third", to).unwrap();
        assert_eq!(heard(&mut sockets), [(b"third".to_vec(), known_at)]);
    }

    #[test]
    fn the_address_is_for_one_alone() {
        let (first, _) = open(HERE).unwrap();
        let at = first.local_addr().unwrap();
        assert_eq!(open(at).unwrap_err().kind(), ErrorKind::AddrInUse);
    }
}
