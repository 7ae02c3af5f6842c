//! Who asks, and what they may.

use std::{
    collections::HashMap,
    net::{IpAddr, Ipv4Addr},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use axum::{
    extract::FromRequestParts,
    http::{HeaderMap, header, request::Parts},
};
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;
use uuid::Uuid;
use volery_api::{Role, ws::BEARER_PROTOCOL};

use crate::{
    accept::Peer,
    audit::identified,
    clock,
    error::{ApiError, ApiResult, Code},
    state::App,
    store::blobs::hex,
};

/// Failures of one address within [`WINDOW`] before it has to wait.
const MAX_FAILURES: u32 = 10;
const WINDOW: Duration = Duration::from_secs(60);
/// Addresses and known tokens kept at once.
const MAX_KEPT: usize = 4096;

/// Who asks.
#[derive(Debug, Clone)]
pub(crate) struct Caller {
    /// Of the token; nil for a caller from this machine without one.
    pub(crate) id: Uuid,
    /// Of the token, for people.
    pub(crate) name: String,
    pub(crate) role: Role,
}

/// A fresh secret of 256 random bits.
pub(crate) fn new_secret() -> ApiResult<String> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(ApiError::internal)?;
    Ok(format!("vly_{}", hex(&bytes)))
}

/// What is kept of a secret. It has 256 random bits, so one plain hash is enough.
pub(crate) fn hash_secret(secret: &str) -> [u8; 32] {
    Sha256::digest(secret.as_bytes()).into()
}

/// Counts failures per address, so that guessing ends after a few tries.
#[derive(Debug, Default)]
pub(crate) struct Guard {
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    failures: HashMap<IpAddr, (u32, Instant)>,
    /// By the hashes that were valid before: a flood of guesses does not lock their owners out.
    known: HashMap<[u8; 32], Known>,
    /// How often a token was deleted.
    num_deleted: u64,
}

/// A token that was valid when it was used first.
#[derive(Debug, Clone)]
struct Known {
    caller: Caller,
    expires_ms: Option<i64>,
    is_deleted: bool,
}

impl Known {
    fn is_expired(&self) -> bool {
        self.expires_ms.is_some_and(|end| end <= clock::now_ms())
    }
}

impl Guard {
    fn check(&self, address: IpAddr, hash: &[u8; 32], now: Instant) -> ApiResult<()> {
        let mut kept = self.lock();
        let Some(&(failures, since)) = kept.failures.get(&address) else { return Ok(()) };
        let window = WINDOW * (failures / MAX_FAILURES).max(1);
        if now >= since + window {
            kept.failures.remove(&address);
            return Ok(());
        }
        if failures < MAX_FAILURES || kept.known.get(hash).is_some_and(|known| !known.is_deleted) {
            return Ok(());
        }
        let retry_after_s = (since + window - now).as_secs() + 1;
        Err(ApiError::new(
            Code::TooMany { code: "too_many_failures", retry_after_s },
            format!("{failures} requests from {address} had no valid token"),
        ))
    }

    fn failed(&self, address: IpAddr, now: Instant) {
        let mut kept = self.lock();
        if kept.failures.len() >= MAX_KEPT {
            kept.failures.clear();
        }
        kept.failures.entry(address).or_insert((0, now)).0 += 1;
    }

    /// Remembers a token that was found when [`Guard::num_deleted`] was as given: one that is
    /// deleted meanwhile stays unknown.
    fn passed(&self, hash: [u8; 32], known: Known, num_deleted: u64) {
        let mut kept = self.lock();
        if kept.known.len() >= MAX_KEPT {
            kept.known.clear();
        }
        if kept.num_deleted == num_deleted {
            kept.known.insert(hash, known);
        }
    }

    fn known(&self, hash: &[u8; 32]) -> Option<Known> {
        self.lock().known.get(hash).cloned()
    }

    fn num_deleted(&self) -> u64 {
        self.lock().num_deleted
    }

    /// A token was deleted.
    pub(crate) fn forget(&self, id: Uuid) {
        let mut kept = self.lock();
        kept.num_deleted += 1;
        for known in kept.known.values_mut() {
            known.is_deleted |= known.caller.id == id;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The token of a request: in `Authorization`, or, for sockets of browsers, in a subprotocol.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    if let Some(value) = headers.get(header::AUTHORIZATION) {
        let (scheme, token) = value.to_str().ok()?.split_once(' ')?;
        return scheme.eq_ignore_ascii_case("bearer").then(|| token.trim());
    }
    headers
        .get_all(header::SEC_WEBSOCKET_PROTOCOL)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .find_map(|protocol| protocol.trim().strip_prefix(BEARER_PROTOCOL))
}

/// Whether a request comes from a page of another site.
fn is_foreign_page(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return false };
    let host = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, host)| {
        host.rsplit_once(':').filter(|(_, port)| port.parse::<u16>().is_ok()).map_or(host, |h| h.0)
    });
    !matches!(host, Some("localhost" | "127.0.0.1" | "[::1]"))
}

async fn authenticate(parts: &Parts, app: &App) -> ApiResult<Caller> {
    let peer = parts.extensions.get::<Peer>();
    let address = peer.map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |peer| peer.0.ip());
    let Some(secret) = bearer(&parts.headers) else {
        if app.config.loopback_without_token
            && address.to_canonical().is_loopback()
            && !is_foreign_page(&parts.headers)
        {
            return Ok(Caller {
                id: Uuid::nil(),
                name: "this machine".to_owned(),
                role: Role::Admin,
            });
        }
        return Err(ApiError::new(Code::Unauthorized, "the request carries no token")
            .hint("send `Authorization: Bearer <token>`"));
    };
    let now = Instant::now();
    let hash = hash_secret(secret);
    app.guard.check(address, &hash, now)?;
    let known = match app.guard.known(&hash).filter(|known| !known.is_deleted) {
        Some(known) => known,
        None => find(app, address, &hash, now).await?,
    };
    if known.is_expired() {
        return Err(ApiError::new(Code::TokenExpired, "the token has expired")
            .hint("ask an admin for a new one"));
    }
    Ok(known.caller)
}

/// Looks a token up and remembers it: tokens do not change, they are only deleted.
async fn find(app: &App, address: IpAddr, hash: &[u8; 32], now: Instant) -> ApiResult<Known> {
    let num_deleted = app.guard.num_deleted();
    let token = app.store.token_by_hash(hash).await?;
    let Some(token) = token.filter(|token| bool::from(token.hash.ct_eq(hash))) else {
        app.guard.failed(address, now);
        return Err(ApiError::new(Code::Unauthorized, "the token is not valid"));
    };
    let caller = Caller { id: token.id, name: token.name, role: token.role };
    let known = Known { caller, expires_ms: token.expires_ms, is_deleted: false };
    if !known.is_expired() {
        app.guard.passed(*hash, known.clone(), num_deleted);
    }
    Ok(known)
}

macro_rules! callers {
    ($($(#[$doc:meta])* $name:ident)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone)]
        pub(crate) struct $name(
            #[allow(dead_code, reason = "most handlers only need to know that the role is high enough")]
            pub(crate) Caller,
        );

        impl FromRequestParts<Arc<App>> for $name {
            type Rejection = ApiError;

            async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> ApiResult<Self> {
                let caller = authenticate(parts, app).await?;
                identified(&parts.extensions, &caller);
                if caller.role < Role::$name {
                    return Err(ApiError::new(
                        Code::Forbidden,
                        format!("a {} may not do this", caller.role.name()),
                    )
                    .hint(format!("use a token with the role {} or higher", Role::$name.name())));
                }
                Ok(Self(caller))
            }
        }
    )*};
}

callers! {
    /// Any valid token.
    Viewer
    /// A token that may make things.
    Mapper
    /// A token that may command drones.
    Pilot
    /// A token that may hand out tokens.
    Admin
}

/// A token that may stop drones: a pilot's that is valid, or was when it was last used. To stop is
/// always safe, so it does not wait for the database.
#[derive(Debug, Clone)]
pub(crate) struct Stopper(pub(crate) Caller);

impl FromRequestParts<Arc<App>> for Stopper {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> ApiResult<Self> {
        let known = bearer(&parts.headers)
            .and_then(|secret| app.guard.known(&hash_secret(secret)))
            .map(|known| known.caller)
            .filter(|caller| caller.role >= Role::Pilot);
        match known {
            Some(caller) => {
                identified(&parts.extensions, &caller);
                Ok(Self(caller))
            }
            None => Pilot::from_request_parts(parts, app).await.map(|Pilot(caller)| Self(caller)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guessing_ends_after_ten_failures_and_begins_again_later() {
        let guard = Guard::default();
        let address = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let now = Instant::now();
        for _ in 0..MAX_FAILURES {
            guard.check(address, &[0; 32], now).unwrap();
            guard.failed(address, now);
        }
        assert_eq!(guard.check(address, &[0; 32], now).unwrap_err().code(), "too_many_failures");
        guard.passed([1; 32], viewer(), 0);
        guard.check(address, &[1; 32], now).unwrap();
        guard.check(address, &[0; 32], now + WINDOW).unwrap();
    }

    fn viewer() -> Known {
        let caller = Caller { id: Uuid::nil(), name: String::new(), role: Role::Viewer };
        Known { caller, expires_ms: None, is_deleted: false }
    }

    /// Dies if a token is remembered that was deleted between its being found and remembered.
    #[test]
    fn a_deleted_token_is_not_remembered_as_valid() {
        let guard = Guard::default();
        guard.passed([1; 32], viewer(), guard.num_deleted());
        assert!(!guard.known(&[1; 32]).unwrap().is_deleted);
        let found_when = guard.num_deleted();
        guard.forget(Uuid::nil());
        assert!(guard.known(&[1; 32]).unwrap().is_deleted);
        guard.passed([2; 32], viewer(), found_when);
        assert!(guard.known(&[2; 32]).is_none());
    }

    #[test]
    fn the_token_may_come_as_a_subprotocol() {
        let mut headers = HeaderMap::new();
        headers.insert(header::SEC_WEBSOCKET_PROTOCOL, "volery, bearer.abc".parse().unwrap());
        assert_eq!(bearer(&headers), Some("abc"));
        headers.insert(header::AUTHORIZATION, "Basic abc".parse().unwrap());
        assert_eq!(bearer(&headers), None);
    }

    #[test]
    fn pages_of_other_sites_are_foreign() {
        for (origin, foreign) in
            [("http://localhost:8420", false), ("http://127.0.0.1", false), ("http://evil", true)]
        {
            let mut headers = HeaderMap::new();
            headers.insert(header::ORIGIN, origin.parse().unwrap());
            assert_eq!(is_foreign_page(&headers), foreign, "{origin}");
        }
    }
}
