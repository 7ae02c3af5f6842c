-- Where drones may fly, one fence per map.
CREATE TABLE geofences (
    map_id TEXT PRIMARY KEY REFERENCES maps (id) ON DELETE CASCADE,
    -- Area, forbidden blocks and margin, JSON.
    fence  TEXT NOT NULL
);
