//! Bodies as they come: at some pace, since a few bytes now and then would keep a connection for
//! ever, and to their end, since whoever is still sending does not hear the answer.

use std::{
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
    time::Duration,
};

use axum::{
    BoxError,
    body::{Body, Bytes, HttpBody},
    extract::{Request, State},
    http::header,
    middleware::Next,
    response::Response,
};
use futures_util::{
    Stream, StreamExt,
    stream::{self, BoxStream},
};
use tokio::{
    runtime::Handle,
    time::{Instant, timeout},
};

use crate::state::App;

/// The body came too slowly.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("the body came too slowly")]
pub(crate) struct TooSlow;

/// How long the service has waited for a body, and how long it will.
#[derive(Debug, Clone, Copy)]
struct Patience {
    /// Longest pause, and what every body may take beyond its share.
    idle: Duration,
    min_bytes_per_s: u64,
    received: u64,
    waited: Duration,
}

impl Patience {
    /// For the next piece.
    fn left(&self) -> Duration {
        let share = Duration::from_secs_f64(self.received as f64 / self.min_bytes_per_s as f64);
        self.idle.min((self.idle + share).saturating_sub(self.waited))
    }
}

/// Fails bodies that pause, or come at less than the least pace. Only time spent waiting counts.
/// What no handler read is read here, unless the sender waits to be asked for it.
pub(crate) async fn keep_pace(
    State(app): State<Arc<App>>,
    request: Request,
    next: Next,
) -> Response {
    let limits = &app.config.limits;
    let patience = Patience {
        idle: Duration::from_secs(limits.body_idle_timeout_s),
        min_bytes_per_s: limits.body_min_bytes_per_s.max(1),
        received: 0,
        waited: Duration::ZERO,
    };
    let (parts, body) = request.into_parts();
    if body.is_end_stream() {
        return next.run(Request::from_parts(parts, body)).await;
    }
    let pieces = stream::try_unfold((body.into_data_stream(), patience), next_piece).boxed();
    let body = if parts.headers.contains_key(header::EXPECT) {
        Body::from_stream(pieces)
    } else {
        Body::from_stream(ToTheEnd { pieces: Some(pieces) })
    };
    next.run(Request::from_parts(parts, body)).await
}

/// A body that is read to its end when it is dropped before: the connection could not serve the
/// next request otherwise, and its closing would overtake the answer.
struct ToTheEnd {
    /// None once ended.
    pieces: Option<BoxStream<'static, Result<Bytes, BoxError>>>,
}

/// Longest time for what nobody reads, and longest pause in it: who sends nothing hears the answer.
const LINGER: Duration = Duration::from_secs(30);
const LINGER_PAUSE: Duration = Duration::from_secs(5);

impl Stream for ToTheEnd {
    type Item = Result<Bytes, BoxError>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let Some(pieces) = &mut self.pieces else { return Poll::Ready(None) };
        let next = pieces.poll_next_unpin(context);
        if matches!(next, Poll::Ready(None | Some(Err(_)))) {
            self.pieces = None;
        }
        next
    }
}

impl Drop for ToTheEnd {
    fn drop(&mut self) {
        let (Some(mut pieces), Ok(runtime)) = (self.pieces.take(), Handle::try_current()) else {
            return;
        };
        runtime.spawn(timeout(LINGER, async move {
            while let Ok(Some(Ok(_))) = timeout(LINGER_PAUSE, pieces.next()).await {}
        }));
    }
}

type Waiting = (axum::body::BodyDataStream, Patience);

async fn next_piece(
    (mut body, mut patience): Waiting,
) -> Result<Option<(Bytes, Waiting)>, BoxError> {
    let start = Instant::now();
    let piece = match timeout(patience.left(), body.next()).await {
        Err(_) => return Err(Box::new(TooSlow)),
        Ok(None) => return Ok(None),
        Ok(Some(piece)) => piece?,
    };
    patience.waited += start.elapsed();
    patience.received += piece.len() as u64;
    Ok(Some((piece, (body, patience))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patience_grows_with_what_has_come() {
        let second = Duration::from_secs(1);
        let fresh = Patience {
            idle: 30 * second,
            min_bytes_per_s: 1000,
            received: 0,
            waited: Duration::ZERO,
        };
        assert_eq!(fresh.left(), 30 * second);
        assert_eq!(Patience { waited: 20 * second, ..fresh }.left(), 10 * second);
        assert_eq!(Patience { waited: 40 * second, ..fresh }.left(), Duration::ZERO);
        let busy = Patience { received: 20_000, waited: 40 * second, ..fresh };
        assert_eq!(busy.left(), 10 * second);
        // No credit is saved up for a pause.
        assert_eq!(Patience { received: 9_000_000, ..busy }.left(), 30 * second);
    }
}
