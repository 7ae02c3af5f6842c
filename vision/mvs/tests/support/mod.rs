//! A rendered room with its sparse model and its true surfaces.

use std::collections::BTreeMap;

use volery_geometry::{Camera, CameraModel, Isometry3, Point3};

use volery_scene::{
    CameraId, ImageId, Observation, Photo, Photos, Point3d, PointId, RegisteredImage, SparseModel,
};
use volery_synthetic::{Hall, Renderer, Rendering, Rng, Room, Sensor, along_wall};

/// Views of a room with all that is true of them.
pub(crate) struct Scan {
    pub(crate) hall: Hall,
    pub(crate) camera: Camera,
    pub(crate) model: SparseModel,
    pub(crate) renderings: Vec<Rendering>,
    photos: BTreeMap<ImageId, Photo>,
}

impl Photos for Scan {
    fn photo(&self, image: ImageId) -> Option<Photo> {
        self.photos.get(&image).cloned()
    }
}

/// A camera of `width` pixels with a field of view of 67 degrees.
pub(crate) fn pinhole(width: u32) -> Camera {
    let focal = 0.75 * f64::from(width);
    Camera::from_focal(CameraModel::Pinhole, width, width * 3 / 4, focal).unwrap()
}

/// `num_views` views of the furnished side of a room, a quarter of a meter apart.
pub(crate) fn scan(camera: Camera, num_views: usize) -> Scan {
    let hall = Hall::standard(0.008, 3);
    let spacing = 0.25;
    let start = Point3::new(-0.5 * spacing * num_views as f64, -0.4, 1.4);
    let poses = along_wall(&start, 0.0, spacing, num_views, 4);
    let renderer = Renderer::new(&camera);
    let renderings: Vec<_> = poses.iter().map(|pose| renderer.render(&hall, pose)).collect();
    let sensor = Sensor { vignetting: 0.0, noise: 1.0, ..Sensor::default() };
    let exposed = renderings.iter().enumerate().map(|(index, rendering)| {
        let photo = sensor.expose(rendering, index as u64);
        let colors = Some(photo.rgb.clone());
        (ImageId(index as u32), Photo { gray: photo.gray(), colors })
    });
    let photos = exposed.collect();
    let model = sparse_model(&hall.room, &camera, &poses, 600);
    Scan { hall, camera, model, renderings, photos }
}

/// Points of the surfaces with the views that see them.
pub(crate) fn sparse_model(
    room: &Room,
    camera: &Camera,
    poses: &[Isometry3<f64>],
    num_points: usize,
) -> SparseModel {
    let mut model = SparseModel::default();
    model.cameras.insert(CameraId(0), *camera);
    for (index, pose) in poses.iter().enumerate() {
        let image = RegisteredImage {
            name: format!("{index}.png"),
            camera: CameraId(0),
            cam_from_world: *pose,
            keypoints: Vec::new(),
            points: Vec::new(),
        };
        model.images.insert(ImageId(index as u32), image);
    }
    let mut rng = Rng::new(9);
    while model.points.len() < num_points {
        let position = room.surface_point(&mut rng).position;
        let id = PointId(model.points.len() as u64);
        let mut track = Vec::new();
        for (image, registered) in &mut model.images {
            let seen = camera.project(&(registered.cam_from_world * position));
            let Some(pixel) = seen.filter(|pixel| camera.contains(pixel)) else { continue };
            if room.sees(&registered.center(), &position) {
                let keypoint = registered.keypoints.len() as u32;
                track.push(Observation { image: *image, keypoint });
                registered.keypoints.push(pixel);
                registered.points.push(Some(id));
            }
        }
        if track.len() >= 2 {
            let point = Point3d { position, color: [128; 3], error_px: 0.0, track };
            model.points.insert(id, point);
        }
    }
    model
}
