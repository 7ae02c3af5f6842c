//! Real photos through the whole pipeline, against surveyed or motion-capture truth.

use std::path::{Path, PathBuf};

use volery_pipeline::{
    CameraSpec, ImageInput, JobSpec, StageGroup, Summary, map_folder, reconstruct,
};
use volery_scene::{NoProgress, Verdict};
use volery_tests::{Alignment, SharedSet, shared::read_poses};

fn job(set: &SharedSet) -> JobSpec {
    let images =
        set.images.iter().map(|name| ImageInput::new(name, set.images_dir.join(name))).collect();
    JobSpec {
        camera: set.camera.as_ref().map(CameraSpec::from),
        stages: vec![StageGroup::Sfm],
        ..JobSpec::new(images)
    }
}

fn run(set: &SharedSet) -> (Summary, PathBuf) {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(set.name.replace('/', "_"));
    let _ = std::fs::remove_dir_all(&folder);
    let out = folder.join("map");
    let summary = reconstruct(&job(set), &folder.join("work"), &out, &NoProgress).unwrap();
    (summary, out)
}

fn evaluate(set: &SharedSet, out: &Path, alignment: Alignment) -> volery_tests::Evaluation {
    let poses = read_poses(&out.join(map_folder::file::POSES)).unwrap();
    let figures = volery_tests::evaluate(&poses, &set.truth, alignment).unwrap();
    println!("{}: {figures}", set.name);
    figures
}

/// COLMAP: 11/11, 3.0 mm over a row of 14.7 m, 0.03 degrees.
#[test]
fn fountain_is_mapped_to_millimeters() {
    let Some(set) = SharedSet::open("fountain_p11") else { return };
    let (summary, out) = run(&set);
    assert_eq!(summary.num_registered, 11);
    assert_eq!(summary.quality.verdict, Verdict::Good, "{:?}", summary.quality);
    let figures = evaluate(&set, &out, Alignment::Centers);
    assert!(figures.ate_rmse <= 0.0045, "{figures}");
    assert!(figures.rotation_median_deg <= 0.06, "{figures}");
    // Photos tell no lengths.
    assert!(!summary.scale.metric);
}

/// A distorted lens, 0.44 m of path. COLMAP: all placed, 7 mm, 0.26 degrees.
#[test]
fn desk_is_mapped_through_a_distorted_lens() {
    let Some(set) = SharedSet::open("fr2_desk") else { return };
    let (summary, out) = run(&set);
    assert_eq!(summary.num_registered, set.images.len());
    let figures = evaluate(&set, &out, Alignment::Orientations);
    assert!(figures.ate_rmse <= 0.02, "{figures}");
    assert!(figures.rotation_median_deg <= 1.0, "{figures}");
}
