-- Drones that are registered, whether they are heard or not.
CREATE TABLE drones (
    -- MAVLink system id.
    id       INTEGER PRIMARY KEY,
    -- Name, signing key and how it takes poses, JSON.
    settings TEXT NOT NULL
);
