-- Archives that come in parts.
CREATE TABLE uploads (
    id         TEXT PRIMARY KEY,
    request    TEXT NOT NULL,
    -- What became of the photos, JSON; once they are in their set.
    report     TEXT,
    created_ms INTEGER NOT NULL
) WITHOUT ROWID;
