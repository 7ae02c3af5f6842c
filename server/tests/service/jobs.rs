//! Jobs by their invariants: one worker at a time, bounded attempts, nothing half-done is seen.

use std::time::Duration;

use crate::support::{Client, Server};
use serde_json::{Value, json};

async fn events(client: &Client, job: &str) -> Vec<Value> {
    let events = client.get(&format!("/v1/jobs/{job}/events")).await.expect(200).json();
    events["items"].as_array().unwrap().clone()
}

#[tokio::test]
async fn photos_become_a_map() {
    let server = Server::start().await;
    let client = &server.client;
    let job = client.reconstruct(&["a.jpg", "b.jpg"]).await;
    let job = client.finished(&job).await;
    assert_eq!(job["state"], "succeeded", "{job:#}");
    assert_eq!(job["progress"]["fraction"], 1.0);
    assert_eq!(job["attempt"], 1);
    let stages: Vec<_> =
        job["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(stages, ["features", "pairs", "matching", "mapping", "align", "export"]);
    assert!(job["stages"].as_array().unwrap().iter().all(|stage| stage["state"] == "done"));

    let id = job["id"].as_str().unwrap();
    let events = events(client, id).await;
    let numbers: Vec<_> = events.iter().map(|event| event["seq"].as_u64().unwrap()).collect();
    assert_eq!(numbers, (1..=events.len() as u64).collect::<Vec<_>>());
    assert_eq!(job["last_event"], events.len());
    let mut last = 0.0;
    for event in events.iter().filter(|event| event["type"] == "job.progress") {
        let fraction = event["data"]["fraction"].as_f64().unwrap();
        assert!(fraction >= last);
        last = fraction;
    }
    assert_eq!(events.last().unwrap()["data"]["state"], "succeeded");
    let log = client.get(&format!("/v1/jobs/{id}/log")).await.expect(200);
    assert!(String::from_utf8_lossy(&log.body).contains("info the map is written"));
    let errors = client.get(&format!("/v1/jobs/{id}/log?level=error")).await.expect(200);
    assert_eq!(String::from_utf8_lossy(&errors.body), "");
    let odd = client.get(&format!("/v1/jobs/{id}/log?level=loud")).await.expect(422);
    assert_eq!(odd.code(), "bad_level");
    let report = client.get(&format!("/v1/jobs/{id}/report")).await.expect(303);
    client.get(report.header("location").unwrap()).await.expect(200);

    client.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    client.get(&format!("/v1/jobs/{id}")).await.expect(404);
    let map = job["outputs"]["map_id"].as_str().unwrap();
    client.get(&format!("/v1/maps/{map}")).await.expect(200);
}

/// Maps are joined by a job of its own kind; what makes no sense is refused before it waits.
#[tokio::test]
async fn maps_are_joined_and_extended() {
    let server = Server::start().await;
    let client = &server.client;
    let mut maps = Vec::new();
    for name in ["a.jpg", "b.jpg"] {
        let job = client.reconstruct(&[name]).await;
        let job = client.finished(&job).await;
        maps.push(job["outputs"]["map_id"].as_str().unwrap().to_owned());
    }
    let request = json!({"maps": maps, "map_name": "both"});
    let queued = client.post("/v1/maps:register", request).await.expect(202);
    let job = queued.json();
    assert_eq!(
        queued.header("location").unwrap(),
        format!("/v1/jobs/{}", job["id"].as_str().unwrap())
    );
    let job = client.finished(job["id"].as_str().unwrap()).await;
    assert_eq!((&job["state"], &job["kind"]), (&json!("succeeded"), &json!("register_maps")));
    let joined = job["outputs"]["map_id"].as_str().unwrap();
    assert!(!maps.iter().any(|map| map == joined));
    let map = client.get(&format!("/v1/maps/{joined}")).await.expect(200).json();
    assert_eq!(map["name"], "both");
    assert_eq!(map["active"]["info"]["photos"], json!([1, 1]));
    // The photos of a joined map are those of its parts, also when those are gone.
    client.delete(&format!("/v1/maps/{}", maps[1])).await.expect(204);
    let again = json!({"maps": [maps[0], joined], "method": "points", "with_scale": false});
    let job = client.post("/v1/maps:register", again).await.expect(202).json();
    let job = client.finished(job["id"].as_str().unwrap()).await;
    let again = job["outputs"]["map_id"].as_str().unwrap();
    let map = client.get(&format!("/v1/maps/{again}")).await.expect(200).json();
    assert_eq!(map["active"]["info"]["photos"], json!([1, 2]));
    maps[1] = again.to_owned();

    let set = client.imageset(&["c.jpg", "d.jpg"]).await;
    let request = json!({"kind": "extend_map", "map_id": maps[0], "imageset_ids": [set]});
    let job = client.post("/v1/jobs", request).await.expect(202).json();
    let job = client.finished(job["id"].as_str().unwrap()).await;
    assert_eq!(job["outputs"], json!({"map_id": maps[0], "version": 2}), "{job:#}");
    let kinds = client.get("/v1/jobs?kind=extend_map").await.expect(200).json();
    assert_eq!(kinds["items"].as_array().unwrap().len(), 1);

    let unknown = "01900000-0000-7000-8000-000000000000";
    for (request, code) in [
        (json!({"maps": [maps[0]]}), "bad_map_ids"),
        (json!({"maps": [maps[0], maps[0]]}), "repeated_map"),
        (json!({"maps": [maps[0], unknown]}), "unknown_map"),
        (json!({"maps": maps, "map_id": unknown}), "unknown_map"),
    ] {
        assert_eq!(client.post("/v1/maps:register", request).await.expect(422).code(), code);
    }
    for (request, code) in [
        (json!({"kind": "extend_map", "imageset_ids": [set]}), "no_map"),
        (json!({"kind": "extend_map", "map_id": maps[0]}), "no_images"),
        (json!({"imageset_ids": [set], "map_ids": maps}), "bad_map_ids"),
        (
            json!({"kind": "register_maps", "map_ids": maps, "imageset_ids": [set]}),
            "unused_imagesets",
        ),
    ] {
        assert_eq!(client.post("/v1/jobs", request).await.expect(422).code(), code);
    }
}

#[tokio::test]
async fn the_same_key_is_the_same_job() {
    let server = Server::start().await;
    let client = &server.client;
    let set = client.imageset(&["a.jpg", "b.jpg"]).await;
    let request = json!({"imageset_ids": [set], "seed": 7});
    let key = [("Idempotency-Key", "k")];
    let first = client.json("POST", "/v1/jobs", &key, request.clone()).await.expect(202).json();
    let second = client.json("POST", "/v1/jobs", &key, request).await.expect(202).json();
    assert_eq!(first["id"], second["id"]);
    let list = client.get("/v1/jobs").await.json();
    assert_eq!(list["items"].as_array().unwrap().len(), 1);
    let other = json!({"imageset_ids": [second["request"]["imageset_ids"][0]], "seed": 8});
    client.json("POST", "/v1/jobs", &key, other).await.expect(409);
}

/// What is worth having before a worker's death stays worth having.
#[tokio::test]
async fn a_worker_that_dies_after_the_sparse_map_leaves_it() {
    let server = Server::start().await;
    let client = &server.client;
    let job = client.reconstruct(&["late death.jpg", "b.jpg"]).await;
    let job = client.finished(&job).await;
    assert_eq!((&job["state"], &job["attempt"]), (&json!("partial"), &json!(3)), "{job:#}");
    assert_eq!(job["error"]["code"], "worker_crashed");
    let map = job["outputs"]["map_id"].as_str().unwrap();
    client.get(&format!("/v1/maps/{map}/export/sparse.ply")).await.expect(200);
}

#[tokio::test]
async fn a_poison_job_fails_after_its_attempts_and_others_run() {
    let server = Server::start().await;
    let client = &server.client;
    let poison = client.reconstruct(&["crash.jpg", "b.jpg"]).await;
    let good = client.reconstruct(&["c.jpg", "d.jpg"]).await;
    let poison = client.finished(&poison).await;
    assert_eq!(poison["state"], "failed");
    assert_eq!(poison["attempt"], 3);
    assert_eq!(poison["error"]["code"], "worker_crashed");
    let detail = poison["error"]["detail"].as_str().unwrap();
    assert!(detail.contains("matching") && detail.contains("something terrible"), "{detail}");
    assert_eq!(client.finished(&good).await["state"], "succeeded");
}

#[tokio::test]
async fn a_refusal_is_final_and_explained() {
    let server = Server::start().await;
    let client = &server.client;
    let id = client.reconstruct(&["refuse.jpg"]).await;
    let job = client.finished(&id).await;
    assert_eq!((job["state"].as_str(), job["attempt"].as_u64()), (Some("failed"), Some(1)));
    assert_eq!(job["error"], json!({"code": "no_overlap", "detail": "none", "hint": "take more"}));
    let report = client.get(&format!("/v1/jobs/{id}/report")).await.expect(409);
    assert_eq!(report.code(), "no_report");
    assert_eq!(client.get("/v1/maps").await.json()["items"], json!([]));
}

/// The cause of a failure is in its last lines.
#[tokio::test]
async fn a_log_is_whole_however_long() {
    let server = Server::start().await;
    let client = &server.client;
    let id = client.reconstruct(&["talkative.jpg", "refuse.jpg"]).await;
    client.finished(&id).await;
    assert_eq!(events(client, &id).await.len(), 1000, "and there are more");

    let log = async |query: &str| {
        let log = client.get(&format!("/v1/jobs/{id}/log{query}")).await.expect(200);
        String::from_utf8(log.body).unwrap()
    };
    let whole = log("").await;
    let messages: Vec<_> = whole.lines().filter_map(|line| line.split_once(" line ")).collect();
    assert_eq!(messages.len(), 1100);
    for (number, (_, told)) in messages.iter().enumerate() {
        assert_eq!(*told, number.to_string());
    }
    let last: Vec<_> = whole.lines().rev().take(2).collect();
    assert!(last[0].ends_with(" info job failed") && last[1].ends_with(" error the cause"));
    assert!(log("?level=error").await.ends_with(" error the cause\n"));
    assert_eq!(log("?level=error").await.lines().count(), 1);
    assert_eq!(log("?limit=1000").await.lines().count(), 1000, "progress does not count");
    let too_many = client.get(&format!("/v1/jobs/{id}/log?limit=1001")).await.expect(422);
    assert_eq!(too_many.code(), "bad_limit");
}

#[tokio::test]
async fn jobs_are_cancelled_waiting_and_running() {
    let server = Server::start().await;
    let client = &server.client;
    let running = client.reconstruct(&["endless.jpg", "b.jpg"]).await;
    let waiting = client.reconstruct(&["c.jpg", "d.jpg"]).await;
    client.wait_for(&running, &["running"]).await;
    let position = client.job(&waiting).await;
    assert_eq!((&position["state"], &position["queue_position"]), (&json!("queued"), &json!(0)));
    for id in [&waiting, &running] {
        client.post(&format!("/v1/jobs/{id}/cancel"), json!({})).await.expect(202);
        assert_eq!(client.finished(id).await["state"], "cancelled");
        let again = client.post(&format!("/v1/jobs/{id}/cancel"), json!({})).await.expect(409);
        assert_eq!(again.code(), "job_finished");
    }
    let retried = client.post(&format!("/v1/jobs/{waiting}/retry"), json!({})).await.expect(202);
    assert_eq!(retried.json()["error"], Value::Null);
    assert_eq!(client.finished(&waiting).await["state"], "succeeded");
    client.post(&format!("/v1/jobs/{waiting}/retry"), json!({})).await.expect(409);
}

/// What was finished is told and not done again, but for what a retry wants anew.
#[tokio::test]
async fn a_retry_takes_what_is_finished_up_to_a_stage() {
    let server = Server::start().await;
    let client = &server.client;
    let id = client.reconstruct(&["partial.jpg", "b.jpg"]).await;
    let units_of = |job: Value| -> Vec<(String, u64)> {
        let stages = job["stages"].as_array().unwrap().iter();
        let told = |stage: &Value| {
            (stage["name"].as_str().unwrap().to_owned(), stage["cached"].as_u64().unwrap())
        };
        stages.map(told).collect()
    };
    let first = client.finished(&id).await;
    assert_eq!(first["warnings"][0]["code"], "not_metric", "{first:#}");
    assert!(units_of(first).iter().all(|(_, cached)| *cached == 0));
    let retry = |query: &str| {
        let (client, path) = (client.clone(), format!("/v1/jobs/{id}/retry{query}"));
        let id = id.clone();
        async move {
            let queued = client.post(&path, json!({})).await.expect(202).json();
            assert_eq!(queued["warnings"], json!([]));
            client.finished(&id).await
        }
    };
    assert!(units_of(retry("").await).iter().all(|(_, cached)| *cached == 3));
    for (name, cached) in units_of(retry("?from_stage=matching").await) {
        let kept = ["features", "pairs"].contains(&name.as_str());
        assert_eq!(cached, if kept { 3 } else { 0 }, "{name}");
    }
    assert!(units_of(retry("").await).iter().all(|(_, cached)| *cached == 3), "forgotten once");
    let odd =
        client.post(&format!("/v1/jobs/{id}/retry?from_stage=../.."), json!({})).await.expect(422);
    assert_eq!(odd.code(), "bad_stage");
}

/// What the table of options lists is what a job may say, and what a preset means.
#[tokio::test]
async fn options_are_those_of_the_table() {
    let server = Server::start().await;
    let client = &server.client;
    let set = client.imageset(&["a.jpg", "b.jpg"]).await;
    let submit = |options: Value| client_job(client, &set, options);
    let presets = client.get("/v1/presets").await.expect(200).json();
    assert_eq!(presets[1]["is_default"], true);
    for option in client.get("/v1/options").await.expect(200).json().as_array().unwrap() {
        let name = option["name"].as_str().unwrap();
        for preset in presets.as_array().unwrap() {
            let own = &preset["values"][name];
            assert_eq!(*own, option["defaults"][preset["name"].as_str().unwrap()], "{name}");
        }
        let most = option["maximum"].as_u64().unwrap();
        let job = submit(json!({ name: most })).await.expect(202).json();
        assert_eq!(job["request"]["options"], json!({ name: most }));
        let beyond = submit(json!({ name: most + 1 })).await.expect(422);
        assert_eq!(beyond.code(), "bad_option", "{name}");
    }
    assert_eq!(submit(json!({"speed": 1})).await.expect(422).code(), "unknown_field");
}

async fn client_job(
    client: &crate::support::Client,
    set: &str,
    options: Value,
) -> crate::support::Answer {
    client.post("/v1/jobs", json!({"imageset_ids": [set], "options": options})).await
}

#[tokio::test]
async fn a_queue_has_an_end() {
    let server = Server::start_with(|config| config.limits.queued_jobs = 1).await;
    let client = &server.client;
    let first = client.reconstruct(&["endless.jpg", "b.jpg"]).await;
    client.wait_for(&first, &["running"]).await;
    client.delete(&format!("/v1/jobs/{first}")).await.expect(409);
    client.reconstruct(&["c.jpg"]).await;
    let set = client.imageset(&["d.jpg"]).await;
    let full = client.post("/v1/jobs", json!({"imageset_ids": [set]})).await.expect(429);
    assert_eq!(full.code(), "queue_full");
    assert!(full.header("retry-after").is_some());
}

#[tokio::test]
async fn a_job_that_runs_too_long_is_ended() {
    let server = Server::start_with(|c| c.jobs.timeout = Duration::from_millis(500)).await;
    let job = server.client.reconstruct(&["endless.jpg", "b.jpg"]).await;
    let job = server.client.finished(&job).await;
    assert_eq!(job["error"]["code"], "job_timeout");
}

/// A worker that loses its lease writes nothing more: two services would otherwise finish one job.
#[tokio::test]
async fn a_lapsed_lease_is_taken_over_and_the_loser_is_fenced_off() {
    let server = Server::start_with(|config| {
        config.jobs.lease = Duration::from_millis(300);
        // No runner renews its lease.
        config.jobs.heartbeat = Duration::from_secs(3600);
        config.jobs.parallel = 4;
    })
    .await;
    let client = &server.client;
    let job = client.reconstruct(&["endless.jpg", "b.jpg"]).await;
    let job = client.finished(&job).await;
    assert_eq!(job["state"], "failed");
    assert_eq!(job["error"]["code"], "worker_lost");
    assert_eq!(job["attempt"], 3);
    let claims = events(client, job["id"].as_str().unwrap()).await;
    let claims = claims.iter().filter(|event| event["data"]["state"] == "running").count();
    assert_eq!(claims, 3);
}

#[tokio::test]
async fn a_partial_map_does_not_replace_a_good_one() {
    let server = Server::start().await;
    let client = &server.client;
    let map = client.map().await;
    let set = client.imageset(&["partial.jpg", "b.jpg"]).await;
    let request = json!({"imageset_ids": [set], "map_id": map});
    let job = client.post("/v1/jobs", request).await.expect(202).json();
    let job = client.finished(job["id"].as_str().unwrap()).await;
    assert_eq!(job["state"], "partial");
    assert_eq!(job["outputs"], json!({"map_id": map, "version": 2}));
    let map = client.get(&format!("/v1/maps/{map}")).await.json();
    assert_eq!((&map["active_version"], &map["latest_version"]), (&json!(1), &json!(2)));
}

#[tokio::test]
async fn a_stop_puts_the_job_back_and_costs_it_no_attempt() {
    let server = Server::start().await;
    let client = server.client.clone();
    let job = client.reconstruct(&["slow-1.jpg", "slow-2.jpg"]).await;
    client.wait_for(&job, &["running"]).await;
    server.running.stop().await;
    let again =
        volery_server::start(crate::support::config(&server.folder.0.join("data"))).await.unwrap();
    let client = Client { addr: again.addr, ..client };
    let job = client.finished(&job).await;
    assert_eq!((job["state"].as_str(), job["attempt"].as_u64()), (Some("succeeded"), Some(1)));
    again.stop().await;
}
