//! The service itself: facts, limits, tokens, paging.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// What a token may do; each role may do all that the ones before it may.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Reads and localizes.
    Viewer,
    /// Uploads, reconstructs, aligns.
    Mapper,
    /// Commands drones.
    Pilot,
    /// Hands out tokens.
    Admin,
}

impl Role {
    /// In rising order.
    pub const ALL: [Self; 4] = [Self::Viewer, Self::Mapper, Self::Pilot, Self::Admin];

    /// Its name on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viewer => "viewer",
            Self::Mapper => "mapper",
            Self::Pilot => "pilot",
            Self::Admin => "admin",
        }
    }

    /// By its name on the wire.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }
}

/// A token to be made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateToken {
    /// Who or what it is for.
    #[schema(min_length = 1, max_length = 200)]
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// Seconds until it ends; never, when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires_in_s: Option<u64>,
}

/// A token without its secret.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Token {
    /// Its id.
    pub id: Uuid,
    /// Who or what it is for.
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// RFC 3339.
    pub created: String,
    /// RFC 3339.
    pub expires: Option<String>,
}

/// A token with its secret, which is shown this once.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CreatedToken {
    /// All but the secret.
    #[serde(flatten)]
    pub token: Token,
    /// Goes into `Authorization: Bearer ...`.
    pub secret: String,
}

/// A request that changed something, or would have.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct AuditEntry {
    /// When it was answered, RFC 3339.
    pub time: String,
    /// Whose; absent for a caller from this machine without one.
    pub token_id: Option<Uuid>,
    /// Of the token.
    pub name: String,
    /// Of the token.
    pub role: Role,
    /// Of HTTP; `WS` for a message over a socket.
    pub method: String,
    /// What was asked for.
    pub path: String,
    /// How it was answered; 400 and more was not done.
    pub status: u16,
    /// What a drone was commanded to do, or what was said over a socket, JSON.
    pub detail: Option<String>,
}

/// Where a list goes on.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// Most items to answer, 1 to 1000; 100 when absent.
    #[param(minimum = 1, maximum = 1000)]
    pub limit: Option<u32>,
    /// `next_cursor` of the page before.
    pub cursor: Option<String>,
}

/// A part of a list.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Page<T> {
    /// In a stable order.
    pub items: Vec<T>,
    /// Ask for the rest with it; absent at the end.
    pub next_cursor: Option<String>,
}

/// Whether the service can work.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// `ok` or `unavailable`.
    pub status: String,
    /// One entry per part.
    pub checks: Vec<HealthCheck>,
}

/// State of one part of the service.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct HealthCheck {
    /// `database`, `disk`, `worker`.
    pub name: String,
    /// Whether it works.
    pub ok: bool,
    /// What is wrong.
    pub detail: Option<String>,
}

/// What the service is and can do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Info {
    /// Of this software.
    pub version: String,
    /// Of the API.
    pub api: String,
    /// The server's time, nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// What it can do.
    pub capabilities: Capabilities,
    /// What it refuses.
    pub limits: Limits,
}

/// What the service can do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Capabilities {
    /// Groups of stages a job may ask for.
    pub stages: Vec<String>,
    /// Ways to localize.
    pub localizers: Vec<String>,
    /// Names under `export/`.
    pub exports: Vec<String>,
    /// Kinds of jobs.
    pub jobs: Vec<String>,
    /// Whether it has a link to drones; without one, whatever concerns drones answers `no_mavlink`.
    pub mavlink: bool,
}

/// Every limit of the service.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Limits {
    /// Bytes of a JSON body.
    pub json_bytes: u64,
    /// Bytes of one image.
    pub image_bytes: u64,
    /// Bytes of one upload request.
    pub upload_bytes: u64,
    /// Bytes of an archive, packed.
    pub archive_bytes: u64,
    /// Bytes of an archive, unpacked.
    pub archive_unpacked_bytes: u64,
    /// Entries of an archive.
    pub archive_entries: u64,
    /// Unpacked over packed size, per entry and in total.
    pub archive_ratio: u64,
    /// Images of one image set.
    pub imageset_images: u64,
    /// Jobs waiting.
    pub queued_jobs: u64,
    /// Connections at once.
    pub connections: u64,
    /// Connections at once from one address.
    pub connections_per_address: u64,
    /// Seconds to send the head of a request.
    pub header_timeout_s: u64,
    /// Seconds a body may pause.
    pub body_idle_timeout_s: u64,
    /// Bytes per second that a body must bring on average, beyond a first pause.
    pub body_min_bytes_per_s: u64,
    /// Bytes of disk that stay free.
    pub disk_reserve_bytes: u64,
}
