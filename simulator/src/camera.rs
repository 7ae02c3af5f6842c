//! What a drone's camera sees.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use volery_formats::{WriteJpegError, write_jpeg};
use volery_geometry::Camera;
use volery_geometry::frames::camera_from_body_flu;
use volery_rendering::{DrawableMesh, VirtualCamera};
use volery_scene::Texture;
use volery_synthetic::{Hall, Photo, Renderer, Rendering, Sensor};

/// Share of detail that JPEG keeps, as the cameras of small drones have it.
const JPEG_QUALITY: u8 = 85;

/// What there is to be seen.
#[derive(Debug, Clone)]
pub enum Scenery {
    /// A painted hall.
    Hall(Box<Hall>),
    /// The mesh of a map.
    Mesh(Box<DrawableMesh>),
}

/// Where a camera sits on a drone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Above the feet, forward and to the left of the middle, meters (x forward, y left, z up).
    pub place: Vector3<f64>,
    /// How far it looks down, radians.
    pub down: f64,
}

impl Default for Mount {
    fn default() -> Self {
        Self { place: Vector3::new(0.05, 0.0, 0.06), down: 0.0 }
    }
}

impl Mount {
    /// Camera (x right, y down, z forward) from body (x forward, y left, z up).
    pub fn cam_from_body(&self) -> Isometry3<f64> {
        let level_from_tilted = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), self.down);
        let rotation = camera_from_body_flu() * level_from_tilted.inverse();
        Isometry3::from_parts(Translation3::identity(), rotation) * Translation3::from(-self.place)
    }
}

/// What is wrong with a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraFault {
    /// It shows the same picture again and again.
    Freeze,
    /// It shows nothing.
    Blackout,
}

/// A camera and what it looks at.
#[derive(Debug, Clone)]
pub struct Eye {
    scenery: Scenery,
    mount: Mount,
    sensor: Sensor,
    lens: Lens,
}

#[derive(Debug, Clone)]
enum Lens {
    Painter(Renderer),
    Drawer(Box<VirtualCamera>),
}

impl Eye {
    /// Prepares the rays of the camera.
    pub fn new(scenery: Scenery, camera: &Camera, mount: Mount) -> Self {
        let lens = match &scenery {
            Scenery::Hall(_) => Lens::Painter(Renderer::new(camera)),
            Scenery::Mesh(_) => Lens::Drawer(Box::new(VirtualCamera::new(camera))),
        };
        Self { scenery, mount, sensor: Sensor::default(), lens }
    }

    /// Its intrinsics.
    pub fn camera(&self) -> &Camera {
        match &self.lens {
            Lens::Painter(renderer) => renderer.camera(),
            Lens::Drawer(camera) => camera.camera(),
        }
    }

    /// Where it sits.
    pub fn mount(&self) -> &Mount {
        &self.mount
    }

    /// The photo at a pose of the body; equal seeds give equal noise.
    pub fn photo(&self, world_from_body: &Isometry3<f64>, seed: u64) -> Photo {
        let cam_from_world = self.mount.cam_from_body() * world_from_body.inverse();
        let ideal = match (&self.scenery, &self.lens) {
            (Scenery::Hall(hall), Lens::Painter(renderer)) => {
                renderer.render(hall, &cam_from_world)
            }
            (Scenery::Mesh(mesh), Lens::Drawer(camera)) => {
                let drawn = camera.draw_mesh(mesh, &cam_from_world);
                Rendering {
                    width: drawn.width,
                    height: drawn.height,
                    colors: drawn.colors.iter().map(|c| c.map(f32::from)).collect(),
                    depth: drawn.depth,
                    cam_from_world,
                }
            }
            _ => unreachable!("the lens was made for the scenery"),
        };
        self.sensor.expose(&ideal, seed)
    }

    /// A photo of nothing.
    pub fn darkness(&self) -> Photo {
        let Camera { width, height, .. } = *self.camera();
        Photo { width, height, rgb: vec![[0; 3]; (width * height) as usize] }
    }
}

/// The photo as it is sent.
///
/// # Errors
///
/// [`WriteJpegError`] for sizes that JPEG does not have.
pub fn jpeg(photo: Photo) -> Result<Vec<u8>, WriteJpegError> {
    let Photo { width, height, rgb } = photo;
    write_jpeg(&Texture { width, height, pixels: rgb }, JPEG_QUALITY)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// A point straight ahead of a level nose is in the middle, one to the left is left of it; a
    /// camera that looks down shows the horizon above the middle.
    #[test]
    fn the_camera_looks_along_the_nose() {
        let mount = Mount { place: Vector3::new(0.1, 0.0, 0.05), down: 0.0 };
        let ahead = mount.cam_from_body() * Point3::new(2.1, 0.0, 0.05);
        assert!((ahead - Point3::new(0.0, 0.0, 2.0)).norm() < 1e-12);
        assert!((mount.cam_from_body() * Point3::new(2.1, 1.0, 0.05)).x < -0.99);
        let tilted = Mount { down: 0.3, ..mount };
        let horizon = tilted.cam_from_body() * Point3::new(2.1, 0.0, 0.05);
        assert!((horizon.y / horizon.z + 0.3_f64.tan()).abs() < 1e-12, "{horizon}");
    }
}
