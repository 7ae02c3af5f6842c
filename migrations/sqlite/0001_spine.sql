CREATE TABLE tokens (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT,
    id         TEXT NOT NULL UNIQUE,
    name       TEXT NOT NULL,
    role       TEXT NOT NULL,
    hash       BLOB NOT NULL UNIQUE,
    created_ms INTEGER NOT NULL,
    expires_ms INTEGER
);

CREATE TABLE cameras (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT,
    id         TEXT NOT NULL UNIQUE,
    request    TEXT NOT NULL,
    name       TEXT NOT NULL,
    camera     TEXT NOT NULL,
    created_ms INTEGER NOT NULL
);

CREATE TABLE imagesets (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT,
    id         TEXT NOT NULL UNIQUE,
    request    TEXT NOT NULL,
    name       TEXT NOT NULL,
    camera_id  TEXT REFERENCES cameras (id),
    notes      TEXT,
    created_ms INTEGER NOT NULL
);

-- A row means that the blob is whole and on the disk.
CREATE TABLE blobs (
    sha256     TEXT PRIMARY KEY,
    size       INTEGER NOT NULL,
    created_ms INTEGER NOT NULL
) WITHOUT ROWID;

CREATE TABLE images (
    seq             INTEGER PRIMARY KEY AUTOINCREMENT,
    id              TEXT NOT NULL UNIQUE,
    imageset_id     TEXT NOT NULL REFERENCES imagesets (id) ON DELETE CASCADE,
    name            TEXT NOT NULL,
    sha256          TEXT NOT NULL REFERENCES blobs (sha256),
    size            INTEGER NOT NULL,
    format          TEXT NOT NULL,
    width           INTEGER NOT NULL,
    height          INTEGER NOT NULL,
    exif            TEXT NOT NULL,
    prior           TEXT,
    capture_time_ns INTEGER,
    created_ms      INTEGER NOT NULL,
    UNIQUE (imageset_id, name),
    UNIQUE (imageset_id, sha256)
);

CREATE TABLE maps (
    seq            INTEGER PRIMARY KEY AUTOINCREMENT,
    id             TEXT NOT NULL UNIQUE,
    name           TEXT NOT NULL,
    active_version INTEGER NOT NULL,
    created_ms     INTEGER NOT NULL
);

CREATE TABLE map_versions (
    map_id         TEXT NOT NULL REFERENCES maps (id) ON DELETE CASCADE,
    version        INTEGER NOT NULL,
    job_id         TEXT,
    parent_version INTEGER,
    request_key    TEXT UNIQUE,
    request        TEXT,
    info           TEXT NOT NULL,
    residuals      TEXT,
    created_ms     INTEGER NOT NULL,
    PRIMARY KEY (map_id, version)
) WITHOUT ROWID;

CREATE TABLE map_files (
    map_id  TEXT NOT NULL,
    version INTEGER NOT NULL,
    path    TEXT NOT NULL,
    sha256  TEXT NOT NULL REFERENCES blobs (sha256),
    size    INTEGER NOT NULL,
    PRIMARY KEY (map_id, version, path),
    FOREIGN KEY (map_id, version) REFERENCES map_versions (map_id, version) ON DELETE CASCADE
) WITHOUT ROWID;

CREATE TABLE jobs (
    seq              INTEGER PRIMARY KEY AUTOINCREMENT,
    id               TEXT NOT NULL UNIQUE,
    kind             TEXT NOT NULL,
    request          TEXT NOT NULL,
    state            TEXT NOT NULL,
    priority         INTEGER NOT NULL,
    run_after_ms     INTEGER NOT NULL,
    attempt          INTEGER NOT NULL DEFAULT 0,
    max_attempts     INTEGER NOT NULL,
    -- Runs that ended with the service, not with the worker.
    interruptions    INTEGER NOT NULL DEFAULT 0,
    lease_owner      TEXT,
    -- Rises with every claim: a write with an old one is refused.
    lease_token      INTEGER NOT NULL DEFAULT 0,
    lease_until_ms   INTEGER,
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    stage            TEXT,
    progress         TEXT NOT NULL DEFAULT '{}',
    stages           TEXT NOT NULL DEFAULT '[]',
    error            TEXT,
    map_id           TEXT,
    map_version      INTEGER,
    last_event       INTEGER NOT NULL DEFAULT 0,
    created_ms       INTEGER NOT NULL,
    started_ms       INTEGER,
    finished_ms      INTEGER
);

CREATE INDEX jobs_queue ON jobs (state, priority DESC, run_after_ms, seq);

CREATE TABLE job_events (
    job_id  TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    seq     INTEGER NOT NULL,
    time_ms INTEGER NOT NULL,
    kind    TEXT NOT NULL,
    data    TEXT NOT NULL,
    PRIMARY KEY (job_id, seq)
) WITHOUT ROWID;
