//! Whole reconstructions of the shared sets, ours and the peers', each in a process of its own.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use volery_pipeline::{
    CameraSpec, ImageInput, JobSpec, StageGroup, Summary, map_folder, reconstruct,
};
use volery_scene::NoProgress;
use volery_tests::shared::read_poses;
use volery_tests::{Alignment, Evaluation, SharedSet, evaluate, repository_root};

use crate::clock::{Cost, measure_children};
use crate::table::{Table, figure};

/// Folders of the shared data, with what fixes the rotation of the alignment and which table of
/// poses is the truth.
const SETS: [(&str, Alignment, &str); 5] = [
    ("fountain_p11", Alignment::Centers, "ground_truth.csv"),
    ("fr2_desk", Alignment::Orientations, "ground_truth.csv"),
    ("redkitchen", Alignment::Centers, "reference_sfm.csv"),
    ("sceaux_castle", Alignment::Centers, "ground_truth.csv"),
    ("warehouse_render/scan", Alignment::Centers, "ground_truth.csv"),
];

/// First argument that makes this program reconstruct one set and exit.
pub(crate) const CHILD: &str = "--reconstruct";

/// Who reconstructs.
#[derive(Debug, Clone)]
enum Runner {
    Ours,
    /// Its name, a Python that has it, and the script that runs it.
    Peer(&'static str, PathBuf, &'static str),
}

/// What a run gave.
struct Run {
    cost: Cost,
    figures: Option<Evaluation>,
    num_registered: Option<usize>,
    note: String,
}

/// Accuracy and time on every set whose name contains one of `only` (all if empty), the median
/// of `num_runs` runs, ours and the peers' in turn.
pub(crate) fn sets(only: &[String], num_runs: usize) -> Table {
    let heads = [
        "set",
        "by",
        "images",
        "ATE",
        "rotation",
        "CPU",
        "wall",
        "our CPU / theirs",
        "our wall / theirs",
        "note",
    ];
    let mut table = Table::new("Accuracy and time on real and rendered photos", &heads);
    let runners = runners();
    for (name, alignment, truth) in SETS {
        if !only.is_empty() && !only.iter().any(|part| name.contains(part.as_str())) {
            continue;
        }
        let Some(mut set) = SharedSet::open(name) else { continue };
        set.truth = read_poses(&set.dir.join(truth)).unwrap_or_default();
        let images: std::collections::BTreeSet<_> = set.images.iter().cloned().collect();
        set.truth.retain(|image, _| images.contains(image));
        let mut runs: Vec<Vec<Run>> = runners.iter().map(|_| Vec::new()).collect();
        for round in 0..num_runs {
            for (runner, runs) in runners.iter().zip(&mut runs) {
                let run = run(runner, &set, alignment, round);
                eprintln!("{name}, {}: {:.1} CPU s {}", runner.name(), run.cost.cpu_s, run.note);
                runs.push(run);
            }
        }
        let ours = median_cost(&runs[0]);
        for (runner, runs) in runners.iter().zip(&runs) {
            table.add(row(name, runner, &set, runs, ours));
        }
    }
    table
}

fn row(name: &str, runner: &Runner, set: &SharedSet, runs: &[Run], ours: Cost) -> Vec<String> {
    let cost = median_cost(runs);
    let Some(last) = runs.last() else { return vec![name.to_owned()] };
    let ratio = |ours: f64, theirs: f64| match runner {
        Runner::Peer(..) if theirs > 0.0 => figure(ours / theirs, 2, ""),
        _ => String::new(),
    };
    let number =
        |pick: &dyn Fn(&Evaluation) -> String| last.figures.as_ref().map_or("-".to_owned(), pick);
    let registered = last.num_registered.map_or("-".to_owned(), |n| n.to_string());
    vec![
        name.to_owned(),
        runner.name().to_owned(),
        format!("{registered}/{}", set.images.len()),
        number(&|f| figure(f.ate_rmse * 1e3, 1, "mm")),
        number(&|f| figure(f.rotation_median_deg, 3, "deg")),
        figure(cost.cpu_s, 1, "s"),
        figure(cost.wall_s, 1, "s"),
        ratio(ours.cpu_s, cost.cpu_s),
        ratio(ours.wall_s, cost.wall_s),
        last.note.clone(),
    ]
}

fn median_cost(runs: &[Run]) -> Cost {
    let median = |pick: &dyn Fn(&Run) -> f64| {
        volery_tests::evaluation::median(&runs.iter().map(pick).collect::<Vec<_>>())
    };
    Cost { wall_s: median(&|run| run.cost.wall_s), cpu_s: median(&|run| run.cost.cpu_s) }
}

/// Ours, and the peers where `VOLERY_PEERS_PYTHON` names a Python that has them.
fn runners() -> Vec<Runner> {
    let mut all = vec![Runner::Ours];
    let Some(python) = std::env::var_os("VOLERY_PEERS_PYTHON").map(PathBuf::from) else {
        eprintln!("SKIPPED: peers (VOLERY_PEERS_PYTHON names no Python that has them)");
        return all;
    };
    for (module, name, script) in
        [("openmvg_rs", "openmvg-rs", "sfm_openmvg_rs.py"), ("pycolmap", "COLMAP", "sfm_colmap.py")]
    {
        let check = Command::new(&python).args(["-c", &format!("import {module}")]).output();
        if check.is_ok_and(|output| output.status.success()) {
            all.push(Runner::Peer(name, python.clone(), script));
        } else {
            eprintln!("SKIPPED: {name} (no Python module {module})");
        }
    }
    all
}

impl Runner {
    fn name(&self) -> &'static str {
        match self {
            Self::Ours => "Volery",
            Self::Peer(name, ..) => name,
        }
    }
}

fn run(runner: &Runner, set: &SharedSet, alignment: Alignment, round: usize) -> Run {
    let folder = std::env::temp_dir().join(format!("volery-bench-{}", std::process::id()));
    let out = folder.join(format!("{}-{round}", runner.name()));
    let _ = std::fs::remove_dir_all(&out);
    let _ = std::fs::create_dir_all(&out);
    let mut command = match runner {
        Runner::Ours => {
            let this = std::env::current_exe().unwrap_or_else(|_| "volery-benches".into());
            let mut command = Command::new(this);
            command.arg(CHILD).arg(&set.name).arg(&out);
            command
        }
        Runner::Peer(_, python, script) => {
            let tools = repository_root().join("../shared/tools/peers");
            let mut command = Command::new(python);
            command.arg(tools.join(script)).arg(&set.images_dir);
            command.arg("--out").arg(&out);
            peer_camera(&mut command, script, set, &out);
            command
        }
    };
    let (output, cost) = measure_children(|| command.stderr(Stdio::null()).output());
    let note = match &output {
        Ok(output) if output.status.success() => note(runner, &output.stdout),
        Ok(output) => format!("failed: {}", output.status),
        Err(error) => format!("failed: {error}"),
    };
    let poses = read_poses(&out.join(map_folder::file::POSES));
    let num_registered = poses.as_ref().map(std::collections::BTreeMap::len);
    let figures = poses.and_then(|poses| evaluate(&poses, &set.truth, alignment));
    let _ = std::fs::remove_dir_all(&folder);
    Run { cost, figures, num_registered, note }
}

/// Gives a peer the same knowledge of the camera that ours has.
fn peer_camera(command: &mut Command, script: &str, set: &SharedSet, out: &Path) {
    let Some(camera) = &set.camera else { return };
    if script == "sfm_colmap.py" {
        let params: Vec<String> = camera.params().iter().map(f64::to_string).collect();
        command.args(["--camera-model", camera.model.name(), "--fix-intrinsics"]);
        command.arg("--camera-params").arg(params.join(","));
    } else if camera.params().len() <= 4 {
        let (f, c) = (camera.focal(), camera.principal_point());
        let k = format!("{} 0 {}\n0 {} {}\n0 0 1\n", f.x, c.x, f.y, c.y);
        let path = out.with_extension("K.txt");
        if std::fs::write(&path, k).is_ok() {
            command.arg("--intrinsics").arg(path);
        }
    }
}

fn note(runner: &Runner, stdout: &[u8]) -> String {
    match runner {
        Runner::Ours => {
            String::from_utf8_lossy(stdout).lines().last().unwrap_or_default().to_owned()
        }
        Runner::Peer(..) => {
            let json: serde_json::Value = serde_json::from_slice(stdout).unwrap_or_default();
            json["peer"].as_str().unwrap_or_default().to_owned()
        }
    }
}

/// The child's side: reconstructs one set and prints a line about it.
pub(crate) fn reconstruct_child(name: &str, out: &Path) -> Result<(), String> {
    let set = SharedSet::open(name).ok_or("the set is absent")?;
    let images =
        set.images.iter().map(|name| ImageInput::new(name, set.images_dir.join(name))).collect();
    let camera = set.camera.as_ref().map(CameraSpec::from);
    let spec = JobSpec { camera, stages: vec![StageGroup::Sfm], ..JobSpec::new(images) };
    let work = out.join("work");
    let summary = reconstruct(&spec, &work, out, &NoProgress).map_err(|e| e.to_string())?;
    println!("{}", line(&summary));
    Ok(())
}

fn line(summary: &Summary) -> String {
    let stages: Vec<String> =
        summary.stages.iter().map(|s| format!("{} {:.1}", s.name, s.cpu_s)).collect();
    let memory = summary.peak_rss_mib.map_or(String::new(), |mib| format!(", {mib:.0} MiB"));
    let error = summary.mean_reprojection_px.map_or(String::new(), |px| format!(", {px:.2} px"));
    let verdict = format!("{:?}", summary.quality.verdict).to_lowercase();
    format!(
        "{verdict}, {} mapper, {} points{error}{memory}; CPU s: {}",
        summary.mapper,
        summary.num_points,
        stages.join(", ")
    )
}
