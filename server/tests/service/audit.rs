//! Who did what when.

use std::time::{Duration, Instant};

use crate::support::{Client, Server};
use serde_json::{Value, json};

/// The newest entries, once `enough` of them say so.
async fn entries(client: &Client, enough: impl Fn(&[Value]) -> bool) -> Vec<Value> {
    let start = Instant::now();
    loop {
        let list = client.get("/v1/audit").await.expect(200).json();
        let entries = list["items"].as_array().unwrap().clone();
        if enough(&entries) {
            return entries;
        }
        assert!(start.elapsed() < Duration::from_secs(30), "{entries:#?}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test]
async fn what_changes_something_is_noted_with_its_caller_and_its_end() {
    let server = Server::start().await;
    let admin = &server.client;
    let made = admin.post("/v1/tokens", json!({"name": "guest", "role": "viewer"})).await.json();
    let guest = admin.with_token(made["secret"].as_str());
    guest.get("/v1/info").await.expect(200);
    guest.post("/v1/imagesets", json!({"name": "hall"})).await.expect(403);
    admin.with_token(None).post("/v1/imagesets", json!({"name": "hall"})).await.expect(401);
    admin.post("/v1/imagesets", json!({"name": "hall"})).await.expect(201);

    let told = entries(admin, |entries| entries.len() >= 3).await;
    let short = |entry: &Value| {
        let field = |name: &str| entry[name].as_str().unwrap().to_owned();
        let status = entry["status"].as_u64().unwrap();
        (field("role"), field("method"), field("path"), status)
    };
    let row = |role: &str, path: &str, status: u64| {
        (role.to_owned(), "POST".to_owned(), path.to_owned(), status)
    };
    let newest_first = [
        row("admin", "/v1/imagesets", 201),
        row("viewer", "/v1/imagesets", 403),
        row("admin", "/v1/tokens", 201),
    ];
    assert_eq!(told.iter().map(short).collect::<Vec<_>>(), newest_first);
    assert_eq!((&told[1]["name"], &told[1]["token_id"]), (&json!("guest"), &made["id"]));

    let page = admin.get("/v1/audit?limit=2").await.expect(200).json();
    let rest = format!("/v1/audit?limit=2&cursor={}", page["next_cursor"].as_str().unwrap());
    let rest = admin.get(&rest).await.expect(200).json();
    assert_eq!((&rest["items"][0], &rest["next_cursor"]), (&told[2], &Value::Null));
}

#[tokio::test]
async fn a_command_is_noted_in_words() {
    let server = crate::support::field::server().await;
    let command = json!({"type": "takeoff", "height": 1.0});
    server.client.post("/v1/drones/9/commands", command).await.expect(404);
    let told = entries(&server.client, |entries| !entries.is_empty()).await;
    assert_eq!(told[0]["path"], "/v1/drones/9/commands");
    assert!(told[0]["detail"].as_str().unwrap().contains("takeoff"), "{told:#?}");
}
