-- Requests that changed something, by whom, and how they were answered.
CREATE TABLE audit (
    seq      INTEGER PRIMARY KEY AUTOINCREMENT,
    time_ms  INTEGER NOT NULL,
    -- Nil for a caller without a token. No reference: the entry outlives the token.
    token_id TEXT NOT NULL,
    name     TEXT NOT NULL,
    role     TEXT NOT NULL,
    method   TEXT NOT NULL,
    path     TEXT NOT NULL,
    status   INTEGER NOT NULL,
    detail   TEXT
);

CREATE INDEX audit_time ON audit (time_ms);
