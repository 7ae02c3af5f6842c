//! The hosts that cameras may be pulled from. Pure.

use std::{
    net::{IpAddr, SocketAddr},
    str::FromStr,
};

/// A host, an address or a network that cameras may be pulled from, maybe one port of it only.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraHost {
    who: Who,
    port: Option<u16>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Who {
    /// In lower case.
    Name(String),
    Network(IpAddr, u32),
}

/// Why a text names no host.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no host name, address or network such as 192.168.4.0/24, with or without :PORT")]
pub struct BadCameraHost(String);

impl FromStr for CameraHost {
    type Err = BadCameraHost;

    fn from_str(text: &str) -> Result<Self, BadCameraHost> {
        parse(text).ok_or_else(|| BadCameraHost(text.to_owned()))
    }
}

fn parse(text: &str) -> Option<CameraHost> {
    let (host, port) = match text.strip_prefix('[') {
        Some(rest) => {
            let (host, port) = rest.split_once(']')?;
            (host, if port.is_empty() { None } else { Some(port.strip_prefix(':')?) })
        }
        // IPv6 has more than one colon, and no port without brackets.
        None if text.matches(':').count() > 1 => (text, None),
        None => text.split_once(':').map_or((text, None), |(host, port)| (host, Some(port))),
    };
    let port = match port {
        None => None,
        Some(port) => Some(port.parse().ok().filter(|port| *port != 0)?),
    };
    let who = match host.split_once('/') {
        Some((address, length)) => network(address, Some(length))?,
        None => network(host, None).or_else(|| name(host))?,
    };
    Some(CameraHost { who, port })
}

fn network(address: &str, length: Option<&str>) -> Option<Who> {
    let address: IpAddr = address.parse().ok()?;
    let most = if address.is_ipv4() { 32 } else { 128 };
    let length = length.map_or(Some(most), |length| length.parse().ok())?;
    (length <= most).then_some(Who::Network(address, length))
}

fn name(host: &str) -> Option<Who> {
    let is_name = !host.is_empty()
        && host.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '.' | '_'))
        // What could be meant as an address.
        && !host.chars().all(|c| c.is_ascii_digit() || c == '.');
    is_name.then(|| Who::Name(host.to_ascii_lowercase()))
}

impl CameraHost {
    /// Whether it may name `host`, before that is resolved; any network may hold any name.
    fn may_be(&self, host: &str, port: u16) -> bool {
        let is_host = match &self.who {
            Who::Name(name) => name.eq_ignore_ascii_case(host),
            Who::Network(..) => address_of(host).is_none_or(|address| self.holds(address)),
        };
        is_host && self.port.is_none_or(|own| own == port)
    }

    fn holds(&self, address: IpAddr) -> bool {
        let Who::Network(network, length) = self.who else { return false };
        let shift = |bits: u32| bits - length;
        match (network, address) {
            (IpAddr::V4(network), IpAddr::V4(address)) => {
                let difference = network.to_bits() ^ address.to_bits();
                difference.checked_shr(shift(32)).unwrap_or(0) == 0
            }
            (IpAddr::V6(network), IpAddr::V6(address)) => {
                let difference = network.to_bits() ^ address.to_bits();
                difference.checked_shr(shift(128)).unwrap_or(0) == 0
            }
            _ => false,
        }
    }
}

/// An address that stands in the place of a name.
fn address_of(host: &str) -> Option<IpAddr> {
    let address: IpAddr = host.trim_matches(['[', ']']).parse().ok()?;
    Some(address.to_canonical())
}

/// Whether a camera may be pulled from `host`, as far as that is known before it is resolved.
pub(super) fn may_be_allowed(allowed: &[CameraHost], host: &str, port: u16) -> bool {
    allowed.iter().any(|entry| entry.may_be(host, port))
}

/// Whether a connection may go to `address`, which `host` was resolved to. Who owns a name may
/// point it anywhere: this machine and links without addresses of their own must be allowed by
/// address.
pub(super) fn is_allowed(allowed: &[CameraHost], host: &str, address: SocketAddr) -> bool {
    let ip = address.ip().to_canonical();
    let is_own = match ip {
        IpAddr::V4(v4) => v4.is_link_local(),
        IpAddr::V6(v6) => v6.is_unicast_link_local(),
    } || ip.is_loopback()
        || ip.is_unspecified()
        || ip.is_multicast();
    allowed.iter().any(|entry| {
        let is_host = match &entry.who {
            Who::Name(name) => !is_own && name.eq_ignore_ascii_case(host),
            Who::Network(..) => entry.holds(ip),
        };
        is_host && entry.port.is_none_or(|port| port == address.port())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allowed(text: &str, host: &str, address: &str) -> bool {
        let entry = [text.parse().unwrap()];
        let address: SocketAddr = address.parse().unwrap();
        let is_allowed = is_allowed(&entry, host, address);
        // What is refused before it is resolved is refused after.
        assert!(may_be_allowed(&entry, host, address.port()) || !is_allowed, "{text} {host}");
        is_allowed
    }

    #[test]
    fn networks_hold_their_addresses() {
        for (text, address, expected) in [
            ("192.168.4.0/24", "192.168.4.17:81", true),
            ("192.168.4.0/24", "192.168.5.17:81", false),
            ("192.168.4.99/24", "192.168.4.17:81", true),
            ("192.168.4.17", "192.168.4.17:81", true),
            ("192.168.4.17", "192.168.4.18:81", false),
            ("192.168.4.17:81", "192.168.4.17:81", true),
            ("192.168.4.17:81", "192.168.4.17:82", false),
            ("192.168.4.0/24:81", "192.168.4.17:81", true),
            ("0.0.0.0/0", "8.8.8.8:80", true),
            ("0.0.0.0/0", "[2001:db8::1]:80", false),
            ("::/0", "[2001:db8::1]:80", true),
            ("2001:db8::/32", "[2001:db8:ffff::1]:80", true),
            ("2001:db8::/32", "[2001:db9::1]:80", false),
            ("[2001:db8::1]:81", "[2001:db8::1]:81", true),
            ("[2001:db8::/32]:81", "[2001:db8::1]:80", false),
            // An address of IPv4 in the clothes of IPv6.
            ("127.0.0.0/8", "[::ffff:127.0.0.1]:80", true),
            ("::/0", "[::ffff:127.0.0.1]:80", false),
        ] {
            let socket: SocketAddr = address.parse().unwrap();
            let host = socket.ip().to_string();
            assert_eq!(allowed(text, &host, address), expected, "{text} {address}");
            // A name in that network is as good as its address.
            assert_eq!(allowed(text, "camera.lan", address), expected, "{text} {address}");
        }
    }

    #[test]
    fn names_are_compared_as_names() {
        assert!(allowed("Camera.lan", "camera.LAN", "10.0.0.5:80"));
        assert!(allowed("camera.lan:81", "camera.lan", "10.0.0.5:81"));
        assert!(!allowed("camera.lan:81", "camera.lan", "10.0.0.5:80"));
        assert!(!allowed("camera.lan", "camera.lan.evil.org", "10.0.0.5:80"));
        assert!(!allowed("camera.lan", "10.0.0.5", "10.0.0.5:80"));
    }

    /// Who owns a name does not thereby reach services of this machine.
    #[test]
    fn a_name_does_not_lead_to_this_machine() {
        for address in ["127.0.0.1:80", "[::1]:80", "[::ffff:127.0.0.1]:80", "0.0.0.0:80"] {
            assert!(!allowed("camera.lan", "camera.lan", address), "{address}");
        }
        for address in ["169.254.169.254:80", "[fe80::1]:80", "224.0.0.1:80"] {
            assert!(!allowed("camera.lan", "camera.lan", address), "{address}");
        }
    }

    #[test]
    fn nonsense_names_no_host() {
        for text in [
            "",
            ":80",
            "a:",
            "a:0",
            "a:70000",
            "a b",
            "http://a",
            "a/24",
            "1.2.3",
            "1.2.3.4/33",
            "::/129",
            "[::1",
            "[::1]81",
            "1.2.3.4/",
            "a@b",
            "[a.b]:x",
        ] {
            assert!(text.parse::<CameraHost>().is_err(), "{text}");
        }
    }
}
