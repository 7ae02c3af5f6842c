//! `run-decoder` and `run-localizer`: requests on standard input, answers on standard output.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    io::{self, Read, Write},
    path::Path,
    sync::Arc,
    time::Instant,
};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use volery_api::{
    Localization, RenderRequest, RenderWhat,
    worker::{
        ImageCheck, LocalizeTask, MAX_WORKER_HEADER, ModelPoses, RenderReply, WorkerFailure,
        WorkerReply, WorkerRequest,
    },
};
use volery_formats::{
    DecodeLimits, ImageFormat, colmap::write_colmap_binary, decode_image, read_exif,
    write_depth_png, write_glb, write_png, write_thumbnail, write_transforms_json,
};
use volery_geometry::{Camera, Point3};
use volery_localization::{LocalizationPrior, LocalizeOptions};

use super::{
    align::align_folder, answer::localization, image_work::query_image, parent, tracking::Trackers,
};
use crate::{
    CameraSpec, ForeignModel, PipelineError,
    atomic::write_atomic,
    error::code,
    map_folder::{MapFolder, read_map},
    read_foreign_model, wire,
};

/// Longest payload of a message, bytes: the largest photo that the decoder takes, and raw pixels.
const MAX_PAYLOAD: usize = 256 << 20;

/// Largest picture that is drawn: its depths fill the longest answer.
const MAX_RENDER_PIXELS: u64 = 2048 * 2048;

/// Map versions kept in memory; the least recently used goes first.
const MAX_MAPS: usize = 8;

/// After an answer, so long is waited for the next request before what could wait is begun.
const LEISURE: Timespec = Timespec { tv_sec: 0, tv_nsec: 2_000_000 };

/// Answers requests about images until standard input ends.
pub fn run_decoder() -> io::Result<()> {
    serve(&mut Decoder)
}

/// Answers requests about maps until standard input ends.
pub fn run_localizer() -> io::Result<()> {
    serve(&mut Localizer::default())
}

/// Header and payload.
type Answer = Result<(Vec<u8>, Vec<u8>), serde_json::Error>;

trait Worker {
    fn answer(&mut self, request: WorkerRequest, payload: &[u8]) -> Answer;

    /// Whether something could wait for the answer to leave.
    fn is_behind(&self) -> bool {
        false
    }

    /// Does it, and puts off what it can if the next request waits.
    fn catch_up(&mut self, _is_hurried: bool) {}
}

struct Decoder;

impl Worker for Decoder {
    fn answer(&mut self, request: WorkerRequest, payload: &[u8]) -> Answer {
        match request {
            WorkerRequest::CheckImage {} => reply(check_image(payload)),
            WorkerRequest::Thumbnail { max_side } => match thumbnail(payload, max_side) {
                Ok(png) => Ok((reply(Ok(json!({})))?.0, png)),
                Err(failure) => reply::<Value>(Err(failure)),
            },
            WorkerRequest::ReadModel { files, photos } => {
                reply(read_model(&files, &photos, payload).map_err(of_pipeline))
            }
            _ => reply::<Value>(Err(failure("bad_request", "a decoder only looks at files"))),
        }
    }
}

#[derive(Default)]
struct Localizer {
    maps: Maps,
    trackers: Trackers,
}

impl Worker for Localizer {
    fn answer(&mut self, request: WorkerRequest, payload: &[u8]) -> Answer {
        let Self { maps, trackers } = self;
        match request {
            WorkerRequest::CheckImage {}
            | WorkerRequest::Thumbnail { .. }
            | WorkerRequest::ReadModel { .. } => {
                reply::<Value>(Err(failure("bad_request", "a localizer only looks at maps")))
            }
            WorkerRequest::Localize(task) => reply(localize(&task, payload, maps)),
            WorkerRequest::Track(task) => reply(trackers.track(&task, payload, maps)),
            WorkerRequest::EndTrack { stream } => {
                trackers.end(stream);
                reply(Ok(json!({})))
            }
            WorkerRequest::Render { map_dir, render } => match draw(&map_dir, &render, maps) {
                Ok((about, picture)) => Ok((reply(Ok(about))?.0, picture)),
                Err(failure) => reply::<Value>(Err(failure)),
            },
            WorkerRequest::Align { map_dir, out_dir, align } => {
                let outcome = align_folder(Path::new(&map_dir), Path::new(&out_dir), &align);
                let outcome = outcome.map(|residuals| json!({ "residuals": residuals }));
                reply(outcome.map_err(of_pipeline))
            }
            WorkerRequest::Export { map_dir, format, out } => {
                reply(export(Path::new(&map_dir), &format, Path::new(&out)).map(|()| json!({})))
            }
        }
    }

    fn is_behind(&self) -> bool {
        self.trackers.is_behind()
    }

    fn catch_up(&mut self, is_hurried: bool) {
        self.trackers.catch_up(is_hurried);
    }
}

fn serve(worker: &mut impl Worker) -> io::Result<()> {
    if !parent::is_alive() {
        return Ok(());
    }
    let (stdin, mut output) = (io::stdin(), io::stdout().lock());
    let mut input = stdin.lock();
    while let Some(header) = read_part(&mut input, MAX_WORKER_HEADER)? {
        let payload = read_part(&mut input, MAX_PAYLOAD)?.ok_or(io::ErrorKind::UnexpectedEof)?;
        let (header, payload) = match serde_json::from_slice(&header) {
            Ok(request) => worker.answer(request, &payload)?,
            Err(error) => reply::<Value>(Err(failure("bad_request", error.to_string())))?,
        };
        for part in [&header[..], &payload] {
            output.write_all(&(part.len() as u32).to_le_bytes())?;
            output.write_all(part)?;
        }
        output.flush()?;
        if worker.is_behind() {
            // Requests come one by one, so that none is in the buffer already.
            let mut next = [PollFd::new(&stdin, PollFlags::IN)];
            let is_hurried = poll(&mut next, Some(&LEISURE)).is_ok_and(|num_ready| num_ready > 0);
            worker.catch_up(is_hurried);
        }
    }
    Ok(())
}

/// A length and as many bytes; `None` if the input ends before.
fn read_part(input: &mut impl Read, max_len: usize) -> io::Result<Option<Vec<u8>>> {
    let mut len = [0; 4];
    match input.read_exact(&mut len) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        other => other?,
    }
    let len = u32::from_le_bytes(len) as usize;
    if len > max_len {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "message part is too long"));
    }
    let mut part = vec![0; len];
    input.read_exact(&mut part)?;
    Ok(Some(part))
}

/// An answer without payload.
fn reply<T: Serialize + for<'de> Deserialize<'de>>(outcome: Result<T, WorkerFailure>) -> Answer {
    Ok((WorkerReply(outcome).to_header()?, Vec::new()))
}

pub(super) fn failure(code: &str, detail: impl Into<String>) -> WorkerFailure {
    WorkerFailure { code: code.to_owned(), detail: detail.into(), hint: None }
}

pub(super) fn of_pipeline(error: PipelineError) -> WorkerFailure {
    WorkerFailure { code: error.code, detail: error.detail, hint: error.hint }
}

fn check_image(bytes: &[u8]) -> Result<ImageCheck, WorkerFailure> {
    let image = decode_image(bytes, &DecodeLimits::default())
        .map_err(|e| failure(e.code(), e.to_string()))?;
    let summary = read_exif(bytes);
    let (width, height) = (image.gray.width(), image.gray.height());
    let focal = summary.focal_px(width, height);
    let fields = [
        ("focal_px", json!(focal.px)),
        ("focal_source", json!(focal.source.code())),
        ("make", json!(summary.make)),
        ("model", json!(summary.model)),
        ("capture_time_s", json!(summary.time_s)),
    ];
    let mut warnings = summary.warnings;
    warnings.extend(focal.warnings);
    Ok(ImageCheck {
        width,
        height,
        format: match image.header.format {
            ImageFormat::Jpeg => "jpeg",
            ImageFormat::Png => "png",
        }
        .to_owned(),
        exif: fields
            .into_iter()
            .filter(|(_, value)| !value.is_null())
            .map(|(name, value)| (name.to_owned(), value))
            .collect(),
        warnings,
    })
}

fn thumbnail(bytes: &[u8], max_side: u32) -> Result<Vec<u8>, WorkerFailure> {
    let image = decode_image(bytes, &DecodeLimits::default())
        .map_err(|e| failure(e.code(), e.to_string()))?;
    write_thumbnail(&image, max_side).map_err(|e| failure("damaged", e.to_string()))
}

/// Open map folders, the least recently used first to go.
#[derive(Default)]
pub(super) struct Maps {
    open: BTreeMap<String, (u64, Arc<MapFolder>)>,
    num_uses: u64,
}

impl Maps {
    pub(super) fn get(&mut self, folder: &str) -> Result<Arc<MapFolder>, PipelineError> {
        self.num_uses += 1;
        if let Some((last_use, map)) = self.open.get_mut(folder) {
            *last_use = self.num_uses;
            return Ok(Arc::clone(map));
        }
        let map = Arc::new(MapFolder::open(Path::new(folder))?);
        if self.open.len() >= MAX_MAPS {
            let oldest = self.open.iter().min_by_key(|(_, (last_use, _))| *last_use);
            if let Some(oldest) = oldest.map(|(folder, _)| folder.clone()) {
                self.open.remove(&oldest);
            }
        }
        self.open.insert(folder.to_owned(), (self.num_uses, Arc::clone(&map)));
        Ok(map)
    }
}

fn localize(
    task: &LocalizeTask,
    bytes: &[u8],
    maps: &mut Maps,
) -> Result<Localization, WorkerFailure> {
    let map = maps.get(&task.map_dir).map_err(of_pipeline)?;
    let camera = task.camera.as_ref().map(camera_of).transpose()?;
    let start = Instant::now();
    let query =
        query_image(bytes, task.encoding, task.width.zip(task.height), camera.as_ref(), &map)
            .map_err(|e| failure(e.code(), e.to_string()))?;
    let decode_ms = start.elapsed().as_secs_f64() * 1e3;
    let prior = task.prior.unwrap_or_default();
    let prior = LocalizationPrior {
        position: prior.position.map(|p| (Point3::from(p.position), p.sigma)),
        yaw: prior.yaw.map(|p| (p.yaw, p.sigma)),
    };
    let options = LocalizeOptions::default();
    let located = map
        .locate(&query.image, &query.camera, &prior, &options, task.method)
        .map_err(of_pipeline)?;
    let mut reply = localization(&located);
    reply.timings.decode_ms = Some(decode_ms);
    reply.timings.total_ms = Some(start.elapsed().as_secs_f64() * 1e3);
    Ok(reply)
}

/// Draws a view of a map.
fn draw(
    map_dir: &str,
    render: &RenderRequest,
    maps: &mut Maps,
) -> Result<(RenderReply, Vec<u8>), WorkerFailure> {
    let map = maps.get(map_dir).map_err(of_pipeline)?;
    let camera = match &render.camera {
        Some(camera) => camera_of(camera)?,
        None => *map.first_camera().ok_or_else(|| {
            failure("unknown_camera", "the map has no camera, and none was given")
        })?,
    };
    let pixels = u64::from(camera.width) * u64::from(camera.height);
    if pixels > MAX_RENDER_PIXELS {
        let detail = format!("{pixels} pixels are more than {MAX_RENDER_PIXELS}");
        return Err(failure("too_large", detail));
    }
    if let Some(problem) = render.pose.problem() {
        return Err(failure("bad_pose", problem));
    }
    let map_from_camera = wire::isometry(&render.pose.position, &render.pose.orientation);
    let surface = map.surface().map_err(of_pipeline)?;
    let drawn = surface.draw(&camera, &map_from_camera.inverse());
    let (width, height) = (drawn.width, drawn.height);
    let picture = match render.what {
        RenderWhat::Color => write_png(width, height, &drawn.colors),
        RenderWhat::Depth => write_depth_png(width, height, &drawn.depth),
        RenderWhat::DepthF32 => Ok(drawn.depth.iter().flat_map(|d| d.to_le_bytes()).collect()),
    };
    let picture = picture.map_err(|e| failure("io", e.to_string()))?;
    Ok((RenderReply { surface: surface.name().to_owned() }, picture))
}

/// The model in `payload`, whose `files` follow each other.
fn read_model(
    files: &[(String, u64)],
    photos: &BTreeSet<String>,
    payload: &[u8],
) -> Result<ModelPoses, PipelineError> {
    let mut rest = payload;
    let mut named = Vec::with_capacity(files.len());
    for (name, len) in files {
        let len = usize::try_from(*len).unwrap_or(usize::MAX);
        let (bytes, after) = rest.split_at_checked(len).ok_or_else(|| {
            PipelineError::plain(code::BAD_MODEL, format!("{name} ends before its {len} bytes"))
        })?;
        named.push((name.clone(), bytes));
        rest = after;
    }
    let ForeignModel { images, unknown } = read_foreign_model(&named, photos)?;
    let images = images.into_iter().map(|(name, (cam_from_world, camera))| {
        (name, (wire::camera_pose(&cam_from_world.inverse()), camera.into()))
    });
    Ok(ModelPoses { images: images.collect(), unknown })
}

pub(super) fn camera_of(camera: &volery_api::Camera) -> Result<Camera, WorkerFailure> {
    let spec = CameraSpec::try_from(camera.clone()).map_err(of_pipeline)?;
    spec.camera().map_err(|e| failure("bad_camera", e.to_string()))
}

fn export(map_dir: &Path, format: &str, out: &Path) -> Result<(), WorkerFailure> {
    let (info, map) = read_map(map_dir).map_err(of_pipeline)?;
    match format {
        "colmap_bin" => {
            let files = write_colmap_binary(&map.model);
            fs::create_dir_all(out).map_err(|e| of_pipeline(PipelineError::io(out, &e)))?;
            write_atomic(&out.join("cameras.bin"), &files.cameras)
                .and_then(|()| write_atomic(&out.join("images.bin"), &files.images))
                .and_then(|()| write_atomic(&out.join("points3D.bin"), &files.points))
        }
        "map.glb" => write_atomic(out, &write_glb(&map, &info.content_id())),
        "transforms.json" => {
            write_atomic(out, write_transforms_json(&map.model, "images").as_bytes())
        }
        other => return Err(failure("bad_request", format!("unknown export {other:?}"))),
    }
    .map_err(of_pipeline)
}
