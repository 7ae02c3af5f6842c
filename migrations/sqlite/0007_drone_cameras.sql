-- Cameras that the service pulls; a drone need not be registered to have one.
CREATE TABLE drone_cameras (
    -- MAVLink system id.
    drone    INTEGER PRIMARY KEY,
    -- Address, map, intrinsics and whether the poses feed the drone, JSON.
    settings TEXT NOT NULL
);
