//! Connections: accepted, limited, and closed when their sender is too slow.

use std::{
    collections::HashMap,
    net::{IpAddr, SocketAddr},
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use axum::{Router, body::Body, http::Request};
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

use crate::{
    metrics::{add, sub},
    state::App,
};

/// Time that open requests have to end when the service closes down.
const DRAIN: Duration = Duration::from_secs(5);

/// Who is at the other end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Peer(pub(crate) SocketAddr);

/// Takes connections until the service closes down, then waits for them to end.
pub(crate) async fn accept(listener: TcpListener, router: Router, app: Arc<App>) {
    let connections = TaskTracker::new();
    let counts = Arc::new(Counts::default());
    loop {
        let (stream, address) = tokio::select! {
            () = app.closing.cancelled() => break,
            accepted = listener.accept() => match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    // Out of descriptors, most likely: wait for some to come back.
                    tracing::warn!(%error, "cannot accept a connection");
                    tokio::time::sleep(Duration::from_millis(100)).await;
                    continue;
                }
            },
        };
        let limits = &app.config.limits;
        let Some(place) =
            counts.enter(address.ip(), limits.connections, limits.connections_per_address)
        else {
            add(&app.metrics.connections_refused, 1);
            continue;
        };
        let (router, app) = (router.clone(), Arc::clone(&app));
        connections.spawn(async move {
            add(&app.metrics.connections, 1);
            serve(stream, address, router, &app).await;
            sub(&app.metrics.connections, 1);
            drop(place);
        });
    }
    drop(listener);
    connections.close();
    if tokio::time::timeout(DRAIN, connections.wait()).await.is_err() {
        tracing::warn!("closed with {} connections open", connections.len());
    }
}

async fn serve(stream: TcpStream, address: SocketAddr, router: Router, app: &App) {
    // Poses are small and late when they wait for company.
    let _ = stream.set_nodelay(true);
    let service = service_fn(move |request: Request<hyper::body::Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Peer(address));
        router.clone().oneshot(request)
    });
    let connection = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(Duration::from_secs(app.config.limits.header_timeout_s))
        .max_buf_size(64 << 10)
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades();
    let mut connection = std::pin::pin!(connection);
    let result = tokio::select! {
        result = connection.as_mut() => result,
        () = app.closing.cancelled() => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = result {
        tracing::debug!(%address, %error, "connection ended");
    }
}

/// Open connections, in all and per address.
#[derive(Debug, Default)]
struct Counts {
    open: Mutex<(u64, HashMap<IpAddr, u64>)>,
}

impl Counts {
    fn enter(self: &Arc<Self>, address: IpAddr, max: u64, max_per_address: u64) -> Option<Place> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let here = open.1.get(&address).copied().unwrap_or(0);
        // Everything on this machine shares one address.
        let crowded = here >= max_per_address && !address.to_canonical().is_loopback();
        if open.0 >= max || crowded {
            return None;
        }
        open.0 += 1;
        open.1.insert(address, here + 1);
        Some(Place { counts: Arc::clone(self), address })
    }
}

/// An open connection; gone when dropped.
struct Place {
    counts: Arc<Counts>,
    address: IpAddr,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut open = self.counts.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.0 -= 1;
        if let Some(here) = open.1.get_mut(&self.address) {
            *here -= 1;
            if *here == 0 {
                open.1.remove(&self.address);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn places_are_limited_and_come_back() {
        let counts = Arc::new(Counts::default());
        let far = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1));
        let first = counts.enter(far, 3, 1).unwrap();
        assert!(counts.enter(far, 3, 1).is_none());
        let near = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let _second = counts.enter(near, 3, 1).unwrap();
        let _third = counts.enter(near, 3, 1).unwrap();
        assert!(counts.enter(near, 3, 1).is_none());
        drop(first);
        assert!(counts.enter(far, 3, 1).is_some());
    }
}
