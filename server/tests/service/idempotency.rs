//! The same key from the same caller: done once, answered again.

use serde_json::{Value, json};
use volery_simulator::{DroneOptions, Flavor};

use crate::support::{Answer, Client, Server, field, field::Field};

const KEY: [(&str, &str); 1] = [("Idempotency-Key", "once")];

async fn keyed(client: &Client, path: &str, body: Value) -> Answer {
    client.json("POST", path, &KEY, body).await
}

/// Whose answer is lost asks again: the drone is told once. A second take-off would be refused, and
/// an older target would take the place of a newer one.
#[tokio::test]
async fn a_command_with_a_key_is_given_once() {
    let server = field::server().await;
    let client = &server.client;
    let (ann, bob) = (client.pilot("ann").await, client.pilot("bob").await);
    let start = DroneOptions::new(1, Flavor::ArduPilot, [0.0, 0.0, 0.0].into());
    let path = "/v1/drones/1/commands";
    let take_off = json!({"type": "takeoff", "height": 1.0});

    // What was refused did nothing.
    keyed(&ann, path, take_off.clone()).await.expect(404);
    let field = Field::open(&server, vec![start]);
    field.take_off(&[1], 1.0).await;

    let go = json!({"type": "goto", "position": [0.5, 0.0, 1.0]});
    let first = keyed(&ann, path, go.clone()).await.expect(202);
    let newer = ann.post(path, json!({"type": "hold"})).await.expect(202).json();
    let again = keyed(&ann, path, go.clone()).await.expect(202);
    assert_eq!(again.header("idempotency-replayed"), Some("true"));
    assert_eq!(first.header("idempotency-replayed"), None);
    assert_eq!(again.header("location"), first.header("location"));
    assert_eq!(again.json(), first.json(), "the answer of then");
    let status = client.get(first.header("location").unwrap()).await.expect(200).json();
    assert_eq!(status["state"], "superseded", "the newer one stands");

    // The key is hers, and names one request.
    let other = json!({"type": "goto", "position": [0.6, 0.0, 1.0]});
    assert_eq!(keyed(&ann, path, other).await.expect(409).code(), "idempotency_key_reused");
    let his = keyed(&bob, path, go).await.expect(202).json();
    assert!(his["id"].as_u64() > newer["id"].as_u64(), "{his} after {newer}");
    field.close().await;
}

/// A job that failed again is not tried a third time by the repeat of a request, nor are repeats
/// refused that come while the first is under way.
#[tokio::test]
async fn a_job_is_retried_once() {
    let server = Server::start().await;
    let client = &server.client;
    let job = client.reconstruct(&["refuse.jpg", "b.jpg"]).await;
    client.finished(&job).await;
    let retry = format!("/v1/jobs/{job}/retry");
    let asked = (0..20).map(|_| keyed(client, &retry, json!(null)));
    let answers = futures_util::future::join_all(asked).await;
    let is_again = |answer: &&Answer| answer.header("idempotency-replayed") == Some("true");
    assert_eq!(answers.iter().filter(is_again).count(), 19);
    for answer in answers {
        answer.expect(202);
    }
    client.finished(&job).await;
    keyed(client, &retry, json!(null)).await.expect(202);
    assert_eq!(client.job(&job).await["state"], "failed", "it does not run");
    let other = keyed(client, &format!("{retry}?from_stage=mapping"), json!(null)).await;
    assert_eq!(other.expect(409).code(), "idempotency_key_reused");
    // Without a token nothing is remembered or told.
    keyed(&client.with_token(None), &retry, json!(null)).await.expect(401);
}
