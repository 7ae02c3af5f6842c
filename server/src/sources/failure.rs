//! Why a camera gives no pictures.

use super::multipart::MultipartError;

/// Why a connection to a camera came to nothing, or to an end.
#[derive(Debug, thiserror::Error)]
pub(super) enum Failure {
    #[error("{0} may not be pulled from: start the service with --camera-host")]
    HostRefused(String),
    #[error("no connection to {0}: {1}")]
    Unreachable(String, String),
    #[error("it answers with status {0}")]
    Status(u16),
    #[error("it sends elsewhere (status {0}), and that is not followed")]
    Redirect(u16),
    #[error("it sends `{0}`, not motion JPEG (multipart/x-mixed-replace with a boundary)")]
    NotMjpeg(String),
    #[error("its stream cannot be read: {0}")]
    Broken(String),
    #[error("a picture is larger than {0} bytes")]
    TooLarge(usize),
    #[error("not a byte for {0} s")]
    Silent(u64),
    #[error("no whole picture in {0} s")]
    TooSlow(u64),
    #[error("it ended the stream")]
    Ended,
    #[error("the times of its pictures go backward, or come and go")]
    Clock,
}

impl Failure {
    /// Stable.
    pub(super) fn code(&self) -> &'static str {
        match self {
            Self::HostRefused(_) => "camera_host_refused",
            Self::Unreachable(..) => "camera_unreachable",
            Self::Status(_) => "camera_status",
            Self::Redirect(_) => "camera_redirect",
            Self::NotMjpeg(_) => "camera_not_mjpeg",
            Self::Broken(_) => "camera_stream_broken",
            Self::TooLarge(_) => "camera_frame_too_large",
            Self::Silent(_) => "camera_silent",
            Self::TooSlow(_) => "camera_too_slow",
            Self::Ended => "camera_ended",
            Self::Clock => "camera_clock",
        }
    }

    /// Whether it will most likely be so at the next try as well.
    pub(super) fn is_lasting(&self) -> bool {
        matches!(
            self,
            Self::HostRefused(_)
                | Self::Status(_)
                | Self::Redirect(_)
                | Self::NotMjpeg(_)
                | Self::TooLarge(_)
        )
    }
}

impl From<MultipartError> for Failure {
    fn from(error: MultipartError) -> Self {
        match error {
            MultipartError::TooLarge(max_bytes) => Self::TooLarge(max_bytes),
            error => Self::Broken(error.to_string()),
        }
    }
}
