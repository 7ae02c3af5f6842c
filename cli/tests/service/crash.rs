//! The service is killed in every stage of a job and in the midst of uploads. It goes on at every
//! start, loses nothing that it answered, and ends with the bytes of an undisturbed run.
//!
//! `VOLERY_LONG=1` kills twenty times, on `../shared/data/fountain_p11` where that is present.

use std::{
    collections::BTreeMap,
    path::Path,
    time::{Duration, Instant},
};

use tokio::sync::mpsc::UnboundedSender;
use uuid::Uuid;
use volery_api::Job;
use volery_client::Client;
use volery_tests::SharedSet;

use crate::{
    server::{Photos, Server, glance_until, map_content, mapped, submit, upload},
    support::{Folder, hall_photos, noise_png},
};

const STAGES: [&str; 6] = ["features", "pairs", "matching", "mapping", "align", "export"];

/// A moment of a job: the given share of the units of a stage is done, and then the given share of
/// the time that the stage takes has passed.
struct Moment {
    stage: &'static str,
    done: f64,
    wait: f64,
}

/// `counts[i]` moments spread over the i-th stage, in order of time: what a stage has finished is
/// not done again.
fn moments(counts: [usize; 6]) -> Vec<Moment> {
    let mut moments = Vec::new();
    for (stage, count) in STAGES.into_iter().zip(counts) {
        for i in 0..count {
            // The golden ratio spreads the waits, too.
            let wait = 0.3 * ((moments.len() as f64 * 0.618_034) % 1.0);
            // The mapper starts over, and export takes moments.
            let share = if matches!(stage, "features" | "matching") { 0.8 } else { 0.0 };
            let wait = if stage == "export" { 0.0 } else { wait };
            moments.push(Moment { stage, done: share * i as f64 / count as f64, wait });
        }
    }
    moments
}

fn position(stage: &str) -> usize {
    STAGES.iter().position(|known| *known == stage).expect("a known stage")
}

/// Whether a job has come to a moment, or beyond.
fn is_at(job: &Job, moment: &Moment) -> bool {
    let Some(stage) = &job.stage else { return false };
    let (now, then) = (position(stage), position(moment.stage));
    let done = job.progress.done as f64 / job.progress.total.max(1) as f64;
    now > then || (now == then && done >= moment.done)
}

/// Seconds between the first events of the stages of a job, the last one's to its end.
async fn durations(client: &Client, id: Uuid) -> BTreeMap<String, f64> {
    let mut begins: Vec<(String, Instant)> = Vec::new();
    client
        .watch_job(id, |event| {
            let name = match event.kind.as_str() {
                "job.stage" => event.data["stage"].as_str().unwrap(),
                _ => "end",
            };
            begins.push((name.to_owned(), Instant::now()));
        })
        .await
        .unwrap();
    let mut durations = BTreeMap::new();
    for (i, (name, at)) in begins.iter().enumerate().filter(|(_, (name, _))| name != "end") {
        let next = begins[i + 1..].iter().find(|(next, _)| next != "end").or(begins.last());
        durations.insert(name.clone(), next.map_or(0.0, |(_, next)| (*next - *at).as_secs_f64()));
    }
    durations
}

/// Uploads small photos one after another, and tells each that was answered.
async fn upload_on(client: Client, set: Uuid, life: u32, kept: UnboundedSender<(String, Vec<u8>)>) {
    for number in 0.. {
        let name = format!("{life}-{number}.png");
        let bytes = noise_png(life << 16 | number);
        let answer = client.upload_bytes(set, &name, bytes.clone(), None).await;
        if answer.is_ok_and(|result| result.image_id.is_some()) {
            let _ = kept.send((name, bytes));
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// What a crash test is made over.
fn photos(folder: &Path) -> Photos {
    if let Some(set) = is_long().then(|| SharedSet::open("fountain_p11")).flatten() {
        return Photos::in_folder(&set.images_dir, set.camera);
    }
    let hall = hall_photos(folder);
    Photos::in_folder(&folder.join("scan"), Some(*hall.camera()))
}

fn is_long() -> bool {
    std::env::var_os("VOLERY_LONG").is_some()
}

#[test]
fn a_job_killed_in_every_stage_ends_with_the_same_map_and_no_upload_is_lost() {
    let folder = Folder::new("crash");
    let photos = photos(&folder.0);
    let plan = moments(if is_long() { [6, 1, 5, 5, 1, 2] } else { [1, 0, 1, 1, 1, 1] });
    let runtime = tokio::runtime::Runtime::new().unwrap();

    let server = Server::start(&folder.join("calm"));
    let client = server.client();
    let (durations, expected) = runtime.block_on(async {
        let job = submit(&client, upload(&client, &photos).await).await;
        let durations = durations(&client, job.id).await;
        let job = mapped(&client, job.id).await;
        (durations, map_content(&client, &job).await)
    });
    drop(server);

    let data = folder.join("rough");
    let mut server = Server::start(&data);
    let (job, others) = runtime.block_on(async {
        let client = server.client();
        let others = client.create_imageset("others", None).await.unwrap().id;
        (submit(&client, upload(&client, &photos).await).await.id, others)
    });
    let mut kills: BTreeMap<String, usize> = BTreeMap::new();
    let (sender, mut kept) = tokio::sync::mpsc::unbounded_channel();
    for (life, moment) in plan.iter().enumerate() {
        let client = server.client();
        let uploads = upload_on(server.client(), others, life as u32, sender.clone());
        let uploads = runtime.spawn(uploads);
        let last = runtime.block_on(async {
            glance_until(&client, job, |job| is_at(job, moment)).await;
            tokio::time::sleep(Duration::from_secs_f64(moment.wait * durations[moment.stage]))
                .await;
            client.job(job).await.unwrap()
        });
        server.kill();
        uploads.abort();
        if last.state.is_final() {
            break;
        }
        *kills.entry(last.stage.unwrap_or_default()).or_default() += 1;
        server = Server::start(&data);
    }
    drop(sender);
    server.kill();
    let server = Server::start(&data);
    let client = server.client();
    runtime.block_on(async {
        let job = mapped(&client, job).await;
        assert_eq!(job.attempt, 1, "deaths of the service are not the job's");
        assert_eq!(map_content(&client, &job).await, expected, "the same map, bit for bit");

        let stored = client.images(others).await.unwrap();
        let mut num_kept = 0;
        while let Some((name, bytes)) = kept.recv().await {
            let image = stored.iter().find(|image| image.name == name);
            let image = image.unwrap_or_else(|| panic!("{name} was answered and is lost"));
            assert!(client.image_bytes(image.id).await.unwrap() == bytes, "{name}");
            num_kept += 1;
        }
        println!("kills by stage: {kills:?}; {num_kept} uploads answered, 0 lost");
        assert!(num_kept > 0);
    });
    for stages in [&["features"][..], &["matching"], &["mapping"], &["align", "export"]] {
        assert!(stages.iter().any(|&stage| kills.contains_key(stage)), "no kill in {stages:?}");
    }
}
