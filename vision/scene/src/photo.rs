//! Pixels of images, when they are needed.

use crate::{GrayImage, ImageId};

/// A photo of a registered image.
#[derive(Debug, Clone)]
pub struct Photo {
    /// Gray, of the size of the image's camera.
    pub gray: GrayImage,
    /// sRGB, row by row, as many as pixels; gray where absent.
    pub colors: Option<Vec<[u8; 3]>>,
}

impl Photo {
    /// sRGB of the pixel at an index of the rows.
    pub fn color(&self, index: usize) -> [u8; 3] {
        match &self.colors {
            Some(colors) => colors[index],
            None => [self.gray.pixels()[index]; 3],
        }
    }
}

/// Where photos come from. They are asked for when they are worked on and not kept, so that not all
/// need room at once.
pub trait Photos: Sync {
    /// The photo of an image, `None` if there is none.
    fn photo(&self, image: ImageId) -> Option<Photo>;
}
