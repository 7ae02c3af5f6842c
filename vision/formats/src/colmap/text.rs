//! The text form.

use std::fmt::Write as _;
use std::str::FromStr;

use volery_geometry::CameraModel;
use volery_scene::SparseModel;

use super::build::{Builder, ImageRecord, Place, PointRecord};
use super::{ColmapError, ColmapFile, ColmapFiles, clean_name};

/// Writes the text form; camera, image and point ids are written plus one.
pub fn write_colmap_text(model: &SparseModel) -> ColmapFiles {
    ColmapFiles {
        cameras: cameras_text(model).into_bytes(),
        images: images_text(model).into_bytes(),
        points: points_text(model).into_bytes(),
    }
}

// Writing to a String cannot fail, so the results of `write!` are dropped below.

fn cameras_text(model: &SparseModel) -> String {
    let mut text = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    let _ = writeln!(text, "# Number of cameras: {}", model.cameras.len());
    for (id, camera) in &model.cameras {
        let (name, width, height) = (camera.model.name(), camera.width, camera.height);
        let _ = write!(text, "{} {name} {width} {height}", id.0 + 1);
        for param in camera.params() {
            let _ = write!(text, " {param}");
        }
        text.push('\n');
    }
    text
}

fn images_text(model: &SparseModel) -> String {
    let mut text = String::from(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, \
         POINT3D_ID)\n",
    );
    let _ = writeln!(text, "# Number of images: {}", model.images.len());
    for (id, image) in &model.images {
        let q = image.cam_from_world.rotation.quaternion();
        let t = &image.cam_from_world.translation.vector;
        let _ = writeln!(
            text,
            "{} {} {} {} {} {} {} {} {} {}",
            id.0 + 1,
            q.w,
            q.i,
            q.j,
            q.k,
            t.x,
            t.y,
            t.z,
            image.camera.0 + 1,
            clean_name(&image.name)
        );
        let mut separator = "";
        for (keypoint, point) in image.keypoints.iter().zip(&image.points) {
            let _ = write!(text, "{separator}{} {}", keypoint.x, keypoint.y);
            let _ = match point {
                Some(point) => write!(text, " {}", point.0 + 1),
                None => write!(text, " -1"),
            };
            separator = " ";
        }
        text.push('\n');
    }
    text
}

fn points_text(model: &SparseModel) -> String {
    let mut text =
        String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
    let _ = writeln!(text, "# Number of points: {}", model.points.len());
    for (id, point) in &model.points {
        let p = &point.position;
        let [r, g, b] = point.color;
        let _ = write!(text, "{} {} {} {} {r} {g} {b} {}", id.0 + 1, p.x, p.y, p.z, point.error_px);
        for observation in &point.track {
            let _ = write!(text, " {} {}", observation.image.0 + 1, observation.keypoint);
        }
        text.push('\n');
    }
    text
}

/// Reads the text form.
///
/// # Errors
///
/// [`ColmapError`] for files that are cut off, senseless, or contradict each other.
pub fn read_colmap_text(files: &ColmapFiles) -> Result<SparseModel, ColmapError> {
    let mut builder = Builder::default();
    read_cameras_and_images(files, &mut builder)?;
    for (place, line) in records(ColmapFile::Points, &files.points)? {
        let mut words = Words::new(place, line);
        let id = words.parse()?;
        let position = [words.parse()?, words.parse()?, words.parse()?];
        let color = [words.parse()?, words.parse()?, words.parse()?];
        let error_px = words.parse()?;
        let mut track = Vec::new();
        while let Some(image) = words.parse_next()? {
            track.push((image, words.parse()?));
        }
        builder.point(place, PointRecord { id, position, color, error_px, track })?;
    }
    builder.finish()
}

pub(super) fn read_cameras_and_images(
    files: &ColmapFiles,
    builder: &mut Builder,
) -> Result<(), ColmapError> {
    for (place, line) in records(ColmapFile::Cameras, &files.cameras)? {
        let mut words = Words::new(place, line);
        let id = words.parse()?;
        let name = words.next()?;
        let model = CameraModel::from_name(name)
            .ok_or_else(|| place.invalid(format!("camera model {name:.40?} is not known")))?;
        let size = (words.parse()?, words.parse()?);
        let params: Vec<f64> = words.parse_rest()?;
        builder.camera(place, id, model, size, &params)?;
    }
    read_images(&files.images, builder)
}

/// Images take two lines each; the second is empty for an image without keypoints.
fn read_images(bytes: &[u8], builder: &mut Builder) -> Result<(), ColmapError> {
    let mut lines = lines(ColmapFile::Images, bytes)?;
    while let Some((place, line)) = lines.next() {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = Words::new(place, line);
        let id = words.parse()?;
        let quaternion = [words.parse()?, words.parse()?, words.parse()?, words.parse()?];
        let translation = [words.parse()?, words.parse()?, words.parse()?];
        let camera = words.parse()?;
        let name = words.rest().to_owned();
        if name.is_empty() {
            return Err(place.invalid("the image has no name"));
        }
        let mut keypoints = Vec::new();
        if let Some((place, line)) = lines.next() {
            let mut words = Words::new(place, line);
            while let Some(x) = words.parse_next()? {
                let (y, point) = (words.parse()?, words.parse::<i64>()?);
                keypoints.push((x, y, (point != -1).then_some(point as u64)));
            }
        }
        let record = ImageRecord { id, quaternion, translation, camera, name, keypoints };
        builder.image(place, record)?;
    }
    Ok(())
}

fn lines(
    file: ColmapFile,
    bytes: &[u8],
) -> Result<impl Iterator<Item = (Place, &str)>, ColmapError> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let record = bytes[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count() + 1;
        Place { file, record }.invalid("not UTF-8 text")
    })?;
    Ok(text.lines().enumerate().map(move |(i, line)| (Place { file, record: i + 1 }, line.trim())))
}

/// Lines that are neither blank nor comments.
fn records(
    file: ColmapFile,
    bytes: &[u8],
) -> Result<impl Iterator<Item = (Place, &str)>, ColmapError> {
    Ok(lines(file, bytes)?.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')))
}

/// The words of a line.
struct Words<'a> {
    place: Place,
    rest: &'a str,
}

impl<'a> Words<'a> {
    fn new(place: Place, line: &'a str) -> Self {
        Self { place, rest: line.trim_start() }
    }

    fn next_or_end(&mut self) -> Option<&'a str> {
        if self.rest.is_empty() {
            return None;
        }
        let (word, rest) =
            self.rest.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((self.rest, ""));
        self.rest = rest.trim_start();
        Some(word)
    }

    fn next(&mut self) -> Result<&'a str, ColmapError> {
        self.next_or_end().ok_or_else(|| self.place.invalid("the line is too short"))
    }

    fn rest(self) -> &'a str {
        self.rest
    }

    fn parse<T: FromStr>(&mut self) -> Result<T, ColmapError> {
        let word = self.next()?;
        word.parse().map_err(|_| self.place.invalid(format!("{word:.40?} is no number")))
    }

    /// `None` at the end of the line.
    fn parse_next<T: FromStr>(&mut self) -> Result<Option<T>, ColmapError> {
        if self.rest.is_empty() { Ok(None) } else { self.parse().map(Some) }
    }

    fn parse_rest<T: FromStr>(&mut self) -> Result<Vec<T>, ColmapError> {
        let mut values = Vec::new();
        while let Some(value) = self.parse_next()? {
            values.push(value);
        }
        Ok(values)
    }
}
