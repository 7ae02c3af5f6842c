//! The photos of a job, read when they are needed.

use volery_formats::{DecodeLimits, decode_image};
use volery_scene::{ImageId, Photo, Photos};

use crate::{ingest::Ingested, spec::JobSpec};

/// Reads the files of the photos that take part.
pub(crate) struct Files<'a> {
    pub(crate) spec: &'a JobSpec,
    pub(crate) ingested: &'a Ingested,
}

impl Photos for Files<'_> {
    fn photo(&self, image: ImageId) -> Option<Photo> {
        let usable = self.ingested.usable.get(image.0 as usize)?;
        let bytes = std::fs::read(&self.spec.images[usable.input].path).ok()?;
        let decoded = decode_image(&bytes, &DecodeLimits::default()).ok()?;
        let rgb = decoded.color.as_ref().map(|color| color.to_rgb());
        let colors = rgb.map(|rgb| rgb.as_chunks::<3>().0.to_vec());
        Some(Photo { gray: decoded.gray, colors })
    }
}
