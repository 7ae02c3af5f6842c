//! What can go wrong between here and the server.

use volery_api::Problem;

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The server refused; `code` is stable.
    #[error("{} ({}, HTTP {})", .0.detail, .0.code, .0.status)]
    Problem(Box<Problem>),
    /// The server cannot be reached, or the connection broke.
    #[error("cannot talk to the server: {0}")]
    Transport(String),
    /// The server said something that this client does not understand.
    #[error("unexpected answer of the server: {0}")]
    Protocol(String),
    /// The address or the token cannot be used.
    #[error("{0}")]
    BadArgument(String),
    /// A local file.
    #[error("{path}: {error}")]
    File {
        /// Which.
        path: String,
        /// Why.
        error: std::io::Error,
    },
}

impl ClientError {
    /// The stable code, for programs.
    pub fn code(&self) -> &str {
        match self {
            Self::Problem(problem) => &problem.code,
            Self::Transport(_) => "unreachable",
            Self::Protocol(_) => "protocol",
            Self::BadArgument(_) => "bad_input",
            Self::File { .. } => "io",
        }
    }

    /// What to do about it.
    pub fn hint(&self) -> Option<&str> {
        match self {
            Self::Problem(problem) => problem.hint.as_deref(),
            _ => None,
        }
    }

    /// Whether the same call may succeed a little later.
    pub(crate) fn is_passing(&self) -> bool {
        match self {
            Self::Transport(_) => true,
            Self::Problem(problem) => matches!(problem.status, 429 | 502 | 503 | 504),
            _ => false,
        }
    }

    pub(crate) fn file(path: &std::path::Path, error: std::io::Error) -> Self {
        Self::File { path: path.display().to_string(), error }
    }
}

impl From<reqwest::Error> for ClientError {
    fn from(error: reqwest::Error) -> Self {
        // The outer message only names the URL; the cause is what helps.
        let mut cause: &dyn std::error::Error = &error;
        while let Some(inner) = cause.source() {
            cause = inner;
        }
        let place = error.url().map_or(String::new(), |url| format!(" at {url}"));
        Self::Transport(format!("{cause}{place}"))
    }
}
