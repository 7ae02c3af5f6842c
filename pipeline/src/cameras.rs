//! Which images share a camera, and what is known of it.

use volery_estimation::IntrinsicsRefinement;
use volery_geometry::{Camera, CameraModel};
use volery_scene::CameraId;
use volery_sfm::SfmCamera;

use crate::{
    error::{PipelineError, code},
    ingest::Usable,
    photo::CameraHint,
    spec::{CameraSpec, JobSpec},
    summary::{CameraSource, Warning},
};

/// Focal length of an unknown camera over its longer side: a horizontal field of view of 45°.
const GUESSED_FOCAL: f64 = 1.2;

/// From this many images on, a second radial coefficient is well determined.
const MIN_IMAGES_FOR_RADIAL: usize = 30;

/// Sides of a given camera and of an image may differ in proportion by rounding only.
const MAX_ASPECT_DIFFERENCE: f64 = 0.01;

/// The cameras of a job.
pub(crate) struct Cameras {
    /// In the order of their ids.
    pub(crate) cameras: Vec<SfmCamera>,
    /// As many as cameras.
    pub(crate) sources: Vec<CameraSource>,
    /// Camera of every usable photo.
    pub(crate) of_photo: Vec<CameraId>,
    /// What the user should know.
    pub(crate) warnings: Vec<Warning>,
}

/// What makes two photos of one camera.
#[derive(PartialEq, Eq)]
enum Group {
    /// A calibration: its debug text, and the size it was scaled to.
    Given(String, u32, u32),
    /// No calibration: size, group of the caller, body, focal length in thousandths of a pixel.
    Unknown(u32, u32, Option<String>, [Option<String>; 3], Option<u64>),
}

/// Groups the photos: one camera per calibration, else one per size, body and focal length, so
/// that photos without EXIF share one.
pub(crate) fn assign_cameras(spec: &JobSpec, photos: &[Usable]) -> Result<Cameras, PipelineError> {
    let mut warnings = Vec::new();
    let mut order: Vec<(Group, SfmCamera, CameraSource)> = Vec::new();
    let mut ids: Vec<Option<CameraId>> = vec![None; photos.len()];
    let mut num_mismatched = 0;
    let num_of =
        |hint: &CameraHint| photos.iter().filter(|p| p.photo.hint.size == hint.size).count();
    for (i, usable) in photos.iter().enumerate() {
        let input = &spec.images[usable.input];
        let hint = &usable.photo.hint;
        let given = match input.camera.as_ref().or(spec.camera.as_ref()) {
            None => None,
            Some(camera) => {
                let fitted = fit_to_image(camera, hint)?;
                num_mismatched += usize::from(fitted.is_none());
                fitted
            }
        };
        let group = match &given {
            Some(c) => Group::Given(format!("{c:?}"), c.width, c.height),
            None => Group::Unknown(
                hint.size.width,
                hint.size.height,
                input.camera_group.clone(),
                hint.body.clone(),
                hint.focal_px.map(|f| (f * 1000.0).round() as u64),
            ),
        };
        let known = order.iter().position(|(g, ..)| *g == group);
        let id = match known {
            Some(id) => id,
            None => {
                let (camera, source) = match given {
                    Some(camera) => (SfmCamera::calibrated(camera), CameraSource::Given),
                    None => own_camera(hint, num_of(hint))?,
                };
                order.push((group, camera, source));
                order.len() - 1
            }
        };
        ids[i] = Some(CameraId(id as u32));
    }
    if num_mismatched > 0 {
        warnings.push(Warning {
            code: "camera_size_mismatch".to_owned(),
            detail: format!(
                "{num_mismatched} of {} images have other proportions than the camera given; \
                 their cameras are estimated",
                photos.len()
            ),
            hint: Some("give these images a calibration of their own".to_owned()),
        });
    }
    if order.len() > 1 {
        warnings.push(Warning {
            code: "several_cameras".to_owned(),
            detail: format!("the images were taken with {} cameras or zoom settings", order.len()),
            hint: None,
        });
    }
    Ok(Cameras {
        cameras: order.iter().map(|(_, camera, _)| *camera).collect(),
        sources: order.iter().map(|(.., source)| *source).collect(),
        of_photo: ids.into_iter().flatten().collect(),
        warnings,
    })
}

/// The calibration for an image, scaled if the image is a resized one; `None` for another shape.
fn fit_to_image(camera: &CameraSpec, hint: &CameraHint) -> Result<Option<Camera>, PipelineError> {
    let camera = camera
        .camera()
        .map_err(|e| PipelineError::plain(code::BAD_INPUT, format!("camera: {e}")))?;
    Ok(scaled_to(&camera, hint.size.width, hint.size.height))
}

/// The same lens for an image of another size, if the proportions are the same.
pub(crate) fn scaled_to(camera: &Camera, width: u32, height: u32) -> Option<Camera> {
    let scale_x = f64::from(width) / f64::from(camera.width);
    let scale_y = f64::from(height) / f64::from(camera.height);
    if (camera.width, camera.height) == (width, height) {
        Some(*camera)
    } else if (scale_x / scale_y - 1.0).abs() <= MAX_ASPECT_DIFFERENCE {
        Some(camera.scaled(scale_x, width, height))
    } else {
        None
    }
}

/// EXIF and a map's camera are the same lens if their focal lengths differ by less than this.
const MAX_FOCAL_DIFFERENCE: f64 = 0.15;

/// The camera of a photo that comes to a map: the map's own of this shape unless EXIF speaks of
/// another lens, else by EXIF.
pub(crate) fn likely_camera(
    of_map: Option<Camera>,
    (width, height): (u32, u32),
    exif_px: Option<f64>,
) -> Option<Camera> {
    let is_same_lens = |camera: &Camera| {
        exif_px.is_none_or(|px| (px / camera.mean_focal() - 1.0).abs() < MAX_FOCAL_DIFFERENCE)
    };
    of_map
        .filter(is_same_lens)
        .or_else(|| Camera::from_focal(CameraModel::SimplePinhole, width, height, exif_px?).ok())
}

/// A camera without calibration: from EXIF or guessed, to be refined.
fn own_camera(
    hint: &CameraHint,
    num_images: usize,
) -> Result<(SfmCamera, CameraSource), PipelineError> {
    let (width, height) = (hint.size.width, hint.size.height);
    let guess = GUESSED_FOCAL * f64::from(width.max(height));
    let focal_px = hint.focal_px.unwrap_or(guess);
    let model = if num_images < MIN_IMAGES_FOR_RADIAL {
        CameraModel::SimpleRadial
    } else {
        CameraModel::Radial
    };
    let camera = Camera::from_focal(model, width, height, focal_px)
        .map_err(|e| PipelineError::plain(code::BAD_INPUT, format!("camera: {e}")))?;
    let source = if hint.focal_px.is_some() { CameraSource::Exif } else { CameraSource::Guess };
    let sfm = SfmCamera {
        camera,
        refine: IntrinsicsRefinement::FOCAL_AND_DISTORTION,
        focal_is_guess: source == CameraSource::Guess,
    };
    Ok((sfm, source))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use volery_features::GlobalDescriptor;
    use volery_scene::ImageSize;

    use super::*;
    use crate::{photo::Photo, spec::ImageInput};

    fn usable(input: usize, width: u32, focal_px: Option<f64>) -> Usable {
        let hint = CameraHint {
            size: ImageSize { width, height: 480 },
            body: [None, Some("camera".to_owned()), None],
            focal_px,
            warnings: Vec::new(),
        };
        let photo = Photo {
            hint,
            contrast: 50.0,
            sharpness: 0.5,
            features: Arc::default(),
            colors: Vec::new(),
            global: GlobalDescriptor(Vec::new()),
        };
        Usable { input, key: blake3::hash(&[input as u8]), photo }
    }

    fn spec(num_images: usize) -> JobSpec {
        JobSpec::new((0..num_images).map(|i| ImageInput::new(format!("{i}.jpg"), "x")).collect())
    }

    #[test]
    fn photos_share_a_camera_unless_size_or_exif_differ() {
        let photos = [
            usable(0, 640, None),
            usable(1, 640, None),
            usable(2, 640, Some(500.0)),
            usable(3, 800, None),
            usable(4, 640, None),
        ];
        let cameras = assign_cameras(&spec(5), &photos).unwrap();
        let of: Vec<u32> = cameras.of_photo.iter().map(|id| id.0).collect();
        assert_eq!(of, [0, 0, 1, 2, 0]);
        assert!(cameras.cameras[0].focal_is_guess && !cameras.cameras[1].focal_is_guess);
        assert_eq!(cameras.cameras[0].camera.mean_focal(), 1.2 * 640.0);
        assert_eq!(cameras.sources[1], CameraSource::Exif);
        assert_eq!(cameras.warnings[0].code, "several_cameras");
    }

    /// A calibration holds for resized photos too, and stays fixed; photos of another shape are
    /// not forced into it.
    #[test]
    fn a_calibration_is_scaled_or_left_out() {
        let calibration =
            Camera::new(CameraModel::Pinhole, 1280, 960, &[1000.0, 1000.0, 640.0, 480.0]).unwrap();
        let spec = JobSpec { camera: Some((&calibration).into()), ..spec(2) };
        let cameras = assign_cameras(&spec, &[usable(0, 640, None), usable(1, 800, None)]).unwrap();
        assert_eq!(cameras.sources, [CameraSource::Given, CameraSource::Guess]);
        assert_eq!(cameras.cameras[0].camera.params(), [500.0, 500.0, 320.0, 240.0]);
        assert_eq!(cameras.cameras[0].refine, IntrinsicsRefinement::FIXED);
        assert_eq!(cameras.warnings[0].code, "camera_size_mismatch");
    }
}
