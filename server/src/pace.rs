//! Bodies must come at some pace: a few bytes now and then would keep a connection for ever.

use std::{sync::Arc, time::Duration};

use axum::{
    body::{Body, Bytes},
    extract::{Request, State},
    middleware::Next,
    response::Response,
};
use futures_util::{StreamExt, stream};
use tokio::time::{Instant, timeout};

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
    let paced = stream::try_unfold((body.into_data_stream(), patience), next_piece);
    next.run(Request::from_parts(parts, Body::from_stream(paced))).await
}

type Waiting = (axum::body::BodyDataStream, Patience);

async fn next_piece(
    (mut body, mut patience): Waiting,
) -> Result<Option<(Bytes, Waiting)>, axum::BoxError> {
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
