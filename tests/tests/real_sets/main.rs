//! Real photos and a rendered flight through the whole pipeline, each set mapped once for all tests.

mod finding_poses;
mod mapping;

use std::path::PathBuf;
use std::sync::LazyLock;

use volery_pipeline::map_folder::{self, MapFolder};
use volery_pipeline::{CameraSpec, ImageInput, JobSpec, StageGroup, Summary, reconstruct};
use volery_scene::{NoProgress, Verdict};
use volery_tests::{SharedSet, evaluation::Poses, shared::read_poses};

/// A set with its map.
struct MappedSet {
    set: SharedSet,
    summary: Summary,
    map: MapFolder,
    poses: Poses,
}

/// `None`, said aloud, where it is absent.
static DESK: LazyLock<Option<MappedSet>> = LazyLock::new(|| MappedSet::new("fr2_desk"));
static FOUNTAIN: LazyLock<Option<MappedSet>> = LazyLock::new(|| MappedSet::new("fountain_p11"));

impl MappedSet {
    fn new(name: &str) -> Option<Self> {
        let set = SharedSet::open(name)?;
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(set.name.replace('/', "_"));
        let _ = std::fs::remove_dir_all(&folder);
        let input = |name: &String| ImageInput::new(name, set.images_dir.join(name));
        let spec = JobSpec {
            camera: set.camera.as_ref().map(CameraSpec::from),
            stages: vec![StageGroup::Sfm],
            ..JobSpec::new(set.images.iter().map(input).collect())
        };
        let out = folder.join("map");
        let summary = reconstruct(&spec, &folder.join("work"), &out, &NoProgress).unwrap();
        assert_eq!(summary.quality.verdict, Verdict::Good, "{:?}", summary.quality);
        let poses = read_poses(&out.join(map_folder::file::POSES)).unwrap();
        Some(Self { set, summary, map: MapFolder::open(&out).unwrap(), poses })
    }
}
