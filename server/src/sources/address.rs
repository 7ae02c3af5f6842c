//! Where a camera serves its pictures. Pure.

use hyper::Uri;

use crate::error::{ApiError, ApiResult, Code};

/// Longest address, bytes.
const MAX_URL: usize = 2000;

/// A plain `http` address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Address {
    /// A name, or an address without brackets.
    pub(super) host: String,
    pub(super) port: u16,
    /// With the query.
    pub(super) path: String,
}

impl Address {
    /// Takes addresses that can be asked as they stand: no other scheme, no password.
    pub(super) fn parse(url: &str) -> ApiResult<Self> {
        let bad = |why: &str| ApiError::new(Code::Unprocessable("bad_camera_url"), why);
        if url.len() > MAX_URL {
            return Err(bad("the address is too long"));
        }
        let uri: Uri = url.parse().map_err(|_| bad("the address cannot be read"))?;
        if uri.scheme_str() != Some("http") {
            return Err(bad("cameras are pulled by http://"));
        }
        let authority = uri.authority().ok_or_else(|| bad("the address names no host"))?;
        if authority.as_str().contains('@') {
            return Err(bad("the address may hold no user and no password"));
        }
        let host = authority.host().trim_matches(['[', ']']).to_owned();
        let port = authority.port_u16();
        let has_port = authority.as_str().len() > authority.host().len();
        if host.is_empty() || (has_port && port.is_none_or(|port| port == 0)) {
            return Err(bad("the address names no host, or no port"));
        }
        let path = uri.path_and_query().map_or("/", |path| path.as_str()).to_owned();
        Ok(Self { host, port: port.unwrap_or(80), path })
    }

    /// The host and its port, as a request names them.
    pub(super) fn authority(&self) -> String {
        let Self { host, port, .. } = self;
        if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_addresses_are_taken_apart() {
        for (url, host, port, path) in [
            ("http://192.168.4.1", "192.168.4.1", 80, "/"),
            ("http://192.168.4.1:81/stream", "192.168.4.1", 81, "/stream"),
            ("http://cam.lan/a?b=c#d", "cam.lan", 80, "/a?b=c"),
            ("http://[2001:db8::1]:81/x", "2001:db8::1", 81, "/x"),
        ] {
            let address = Address::parse(url).unwrap();
            assert_eq!((address.host.as_str(), address.port), (host, port), "{url}");
            assert_eq!(address.path, path, "{url}");
        }
    }

    #[test]
    fn nothing_else_is_an_address() {
        let long = format!("http://a/{}", "b".repeat(MAX_URL));
        for url in [
            "",
            "/stream",
            "192.168.4.1",
            "https://a/",
            "rtsp://a/",
            "file:///etc/passwd",
            "http://",
            "http:///x",
            "http://user@a/",
            "http://user:pass@a/",
            "http://a:0/",
            "http://a:99999/",
            "http://a:x/",
            "http://a:/",
            "http://a b/",
            "http://a/\r\nx: y",
            &long,
        ] {
            let error = Address::parse(url).expect_err(url);
            assert_eq!(error.code(), "bad_camera_url", "{url}");
        }
    }
}
