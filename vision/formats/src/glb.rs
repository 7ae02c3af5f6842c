//! A map as binary glTF.

use volery_scene::EnvironmentMap;

/// Writes the points and the camera frusta of a map as a GLB. Vertices are in map coordinates; the
/// root node turns them to glTF's axes. `asset.extras` carries `map_id` and the unit.
pub fn write_glb(map: &EnvironmentMap, map_id: &str) -> Vec<u8> {
    let _ = (map, map_id);
    todo!()
}
