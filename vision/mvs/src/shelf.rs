//! What is finished waits outside: a reconstruction holds the images of one cluster in memory, and
//! one that was interrupted goes on where it stopped.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use nalgebra::Isometry3;
use volery_geometry::Camera;
use volery_scene::{DepthMap, ImageId, OctNormal};

/// Bytes of a pixel of a depth map.
const PIXEL_BYTES: usize = 10;

/// A finished unit of work; all of one image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Item {
    /// The undistorted, smaller photo.
    Photo,
    /// The depth map that the images alone give.
    Photometric,
    /// The same under the eyes of the other depth maps.
    Geometric,
    /// What other maps confirm, and flat surfaces concluded from it.
    Filtered,
    /// Without what other maps see through.
    Finished,
}

impl Item {
    /// In the order they are made.
    pub const ALL: [Self; 5] =
        [Self::Photo, Self::Photometric, Self::Geometric, Self::Filtered, Self::Finished];
}

/// A shelf that does not take what it is given; it knows why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a finished unit could not be kept")]
pub struct NotKept;

/// Keeps finished units. What it forgets is made again.
pub trait Shelf: Sync {
    /// Whether it has a unit.
    fn has(&self, image: ImageId, item: Item) -> bool;

    /// A unit as it was put there.
    fn get(&self, image: ImageId, item: Item) -> Option<Vec<u8>>;

    /// Keeps a unit.
    fn put(&self, image: ImageId, item: Item, bytes: Vec<u8>) -> Result<(), NotKept>;

    /// Nobody will ask for a unit again.
    fn forget(&self, image: ImageId, item: Item);
}

/// A shelf in memory.
#[derive(Debug, Default)]
pub struct MemoryShelf {
    units: Mutex<BTreeMap<(ImageId, Item), Vec<u8>>>,
}

impl MemoryShelf {
    fn with<T>(&self, act: impl FnOnce(&mut BTreeMap<(ImageId, Item), Vec<u8>>) -> T) -> T {
        act(&mut self.units.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Shelf for MemoryShelf {
    fn has(&self, image: ImageId, item: Item) -> bool {
        self.with(|units| units.contains_key(&(image, item)))
    }

    fn get(&self, image: ImageId, item: Item) -> Option<Vec<u8>> {
        self.with(|units| units.get(&(image, item)).cloned())
    }

    fn put(&self, image: ImageId, item: Item, bytes: Vec<u8>) -> Result<(), NotKept> {
        self.with(|units| units.insert((image, item), bytes));
        Ok(())
    }

    fn forget(&self, image: ImageId, item: Item) {
        self.with(|units| units.remove(&(image, item)));
    }
}

/// The pixels of a map; camera and pose are the model's to know.
pub(crate) fn bytes_of_map(map: &DepthMap) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(map.depth.len() * PIXEL_BYTES);
    bytes.extend(map.depth.iter().flat_map(|depth| depth.to_le_bytes()));
    bytes.extend(map.normals.iter().flat_map(|normal| normal.to_bytes()));
    bytes.extend(&map.confidence);
    bytes.extend(map.inferred.iter().map(|&inferred| u8::from(inferred)));
    bytes
}

/// The inverse of [`bytes_of_map`]; `None` for another number of pixels.
pub(crate) fn map_of_bytes(
    bytes: &[u8],
    image: ImageId,
    camera: Camera,
    cam_from_world: Isometry3<f64>,
) -> Option<DepthMap> {
    let num_pixels = camera.width as usize * camera.height as usize;
    if bytes.len() != num_pixels * PIXEL_BYTES {
        return None;
    }
    let (depth, rest) = bytes.split_at(4 * num_pixels);
    let (normals, rest) = rest.split_at(4 * num_pixels);
    let (confidence, inferred) = rest.split_at(num_pixels);
    let (depth, normals) = (depth.as_chunks::<4>().0, normals.as_chunks::<4>().0);
    Some(DepthMap {
        image,
        camera,
        cam_from_world,
        depth: depth.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        normals: normals.iter().map(|bytes| OctNormal::from_bytes(*bytes)).collect(),
        confidence: confidence.to_vec(),
        inferred: inferred.iter().map(|&byte| byte != 0).collect(),
    })
}

#[cfg(test)]
mod tests {
    use volery_geometry::{CameraModel, Vector3};

    use super::*;

    #[test]
    fn a_map_comes_back() {
        let camera = Camera::from_focal(CameraModel::Pinhole, 3, 2, 4.0).unwrap();
        let pose = Isometry3::translation(1.0, 2.0, 3.0);
        let mut map = DepthMap::empty(ImageId(7), camera, pose);
        for index in 0..6 {
            map.depth[index] = 0.1 + index as f32;
            map.normals[index] = Vector3::new(index as f32, -1.0, -2.0).into();
            map.confidence[index] = 40 * index as u8;
            map.inferred[index] = index % 2 == 0;
        }
        let bytes = bytes_of_map(&map);
        assert_eq!(map_of_bytes(&bytes, ImageId(7), camera, pose), Some(map));
        assert_eq!(map_of_bytes(&bytes[1..], ImageId(7), camera, pose), None);
    }
}
