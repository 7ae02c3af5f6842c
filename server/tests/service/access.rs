//! Tokens, roles, limits, errors.

use crate::support::{Client, Server};
use serde_json::json;
use volery_api::Role;

/// Every operation of the description, with ids filled in.
fn operations() -> Vec<(String, String)> {
    let openapi = serde_json::to_value(volery_server::openapi()).unwrap();
    let id = "01900000-0000-7000-8000-000000000000";
    let mut operations = Vec::new();
    for (path, item) in openapi["paths"].as_object().unwrap() {
        for method in item.as_object().unwrap().keys() {
            let path = path.replace("{id}", id).replace("{name}", "poses.csv");
            operations.push((method.to_uppercase(), path));
        }
    }
    assert!(operations.len() > 35, "{}", operations.len());
    operations
}

async fn token(client: &Client, role: &str) -> String {
    let made = client.post("/v1/tokens", json!({"name": role, "role": role})).await.expect(201);
    made.json()["secret"].as_str().unwrap().to_owned()
}

/// Who may: readers ask, mappers make maps, pilots command, admins hand out tokens and keys.
fn least_role(method: &str, path: &str) -> Role {
    let asks = ["/localize", "/render", "/estimate"];
    if path.starts_with("/v1/tokens") || path.starts_with("/v1/audit") {
        return Role::Admin;
    }
    // Its address may hold a password.
    if path.starts_with("/v1/drones/") && path.ends_with("/camera") {
        return Role::Pilot;
    }
    if method == "GET" || asks.iter().any(|end| path.ends_with(end)) {
        return Role::Viewer;
    }
    match path.strip_prefix("/v1/").unwrap_or(path).split('/').next() {
        Some("drones") if matches!(method, "PUT" | "PATCH" | "DELETE") => Role::Admin,
        Some("drones" | "flights" | "geofences" | "leases" | "recordings" | "all-stop") => {
            Role::Pilot
        }
        _ => Role::Mapper,
    }
}

#[tokio::test]
async fn every_route_asks_for_a_token_of_its_role() {
    let server = Server::start().await;
    let client = &server.client;
    let open = ["/", "/healthz", "/readyz", "/openapi.yaml"];
    let viewer = client.with_token(Some(&token(client, "viewer").await));
    let mapper = client.with_token(Some(&token(client, "mapper").await));
    let pilot = client.with_token(Some(&token(client, "pilot").await));
    for (method, path) in operations() {
        let status = |client: Client| {
            let (method, path) = (method.clone(), path.clone());
            async move { client.send(&method, &path, &[], b"").await.status }
        };
        let nobody = status(client.with_token(None)).await;
        if open.contains(&path.as_str()) {
            assert_eq!(nobody, 200, "{method} {path}");
            continue;
        }
        assert_eq!(nobody, 401, "{method} {path} without a token");
        let may = |role| role >= least_role(&method, &path);
        for (client, role) in
            [(&viewer, Role::Viewer), (&mapper, Role::Mapper), (&pilot, Role::Pilot)]
        {
            let refused = status(client.clone()).await == 403;
            assert_eq!(refused, !may(role), "{method} {path} as {role:?}");
        }
        assert!(!matches!(status(client.clone()).await, 401 | 403 | 500..), "{method} {path}");
    }
    server.running.stop().await;
}

#[tokio::test]
async fn guesses_are_slowed_down_and_valid_tokens_are_not() {
    let server = Server::start().await;
    server.client.get("/v1/info").await.expect(200);
    let guess = server.client.with_token(Some("vly_guess"));
    let mut refused = 0;
    for _ in 0..30 {
        let answer = guess.get("/v1/info").await;
        match answer.status {
            401 => assert_eq!(answer.code(), "unauthorized"),
            _ => {
                assert!(answer.expect(429).header("retry-after").is_some());
                refused += 1;
            }
        }
    }
    assert_eq!(refused, 20);
    server.client.get("/v1/info").await.expect(200);
}

#[tokio::test]
async fn tokens_end_by_time_and_by_hand() {
    let server = Server::start().await;
    let client = &server.client;
    let short = json!({"name": "short", "role": "viewer", "expires_in_s": 0});
    let short = client.post("/v1/tokens", short).await.expect(201).json();
    let expired = client.with_token(short["secret"].as_str()).get("/v1/info").await.expect(401);
    assert_eq!(expired.code(), "token_expired");

    let made = client.post("/v1/tokens", json!({"name": "x", "role": "viewer"})).await.json();
    let theirs = client.with_token(made["secret"].as_str());
    theirs.get("/v1/info").await.expect(200);
    client.delete(&format!("/v1/tokens/{}", made["id"].as_str().unwrap())).await.expect(204);
    theirs.get("/v1/info").await.expect(401);

    let list = client.get("/v1/tokens").await.expect(200);
    assert!(!String::from_utf8_lossy(&list.body).contains("vly_"), "no secret is shown again");
    assert_eq!(list.json()["items"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn loopback_needs_no_token_only_when_told_so() {
    let server = Server::start_with(|config| config.loopback_without_token = true).await;
    let nobody = server.client.with_token(None);
    nobody.get("/v1/tokens").await.expect(200);
    let page = [("Origin", "https://evil.example")];
    nobody.send("GET", "/v1/tokens", &page, b"").await.expect(401);

    let folder = crate::support::Folder::new();
    let mut config = crate::support::config(&folder.0);
    config.loopback_without_token = true;
    config.listen = "0.0.0.0:0".parse().unwrap();
    assert!(volery_server::start(config).await.is_err());
}

#[tokio::test]
async fn one_service_per_folder_and_one_first_token() {
    let server = Server::start().await;
    let data = server.folder.0.join("data");
    assert!(volery_server::start(crate::support::config(&data)).await.is_err());
    server.running.stop().await;
    let again = volery_server::start(crate::support::config(&data)).await.unwrap();
    assert_eq!(again.admin_token, None);
    let client = Client { addr: again.addr, ..server.client };
    client.get("/v1/info").await.expect(200);
    again.stop().await;
}

#[tokio::test]
async fn errors_are_problems_with_stable_codes() {
    let server = Server::start().await;
    let client = &server.client;
    let json = [("Content-Type", "application/json")];
    for (method, path, body, status, code) in [
        ("GET", "/nothing", "", 404, "no_such_route"),
        ("PUT", "/v1/info", "", 405, "method_not_allowed"),
        ("GET", "/v1/jobs/../../etc/passwd", "", 404, "no_such_route"),
        ("GET", "/v1/jobs/7", "", 400, "bad_request"),
        ("GET", "/v1/jobs/01900000-0000-7000-8000-000000000000", "", 404, "not_found"),
        ("GET", "/v1/jobs?limit=0", "", 422, "bad_limit"),
        ("GET", "/v1/jobs?limits=5", "", 422, "unknown_field"),
        ("GET", "/v1/jobs?cursor=x", "", 422, "bad_cursor"),
        ("GET", "/v1/jobs?state=lost", "", 422, "bad_state"),
        ("GET", "/v1/jobs?kind=fly", "", 422, "bad_kind"),
        ("POST", "/v1/imagesets", "{", 400, "bad_request"),
        ("POST", "/v1/imagesets", r#"{"name":"x","nme":"y"}"#, 422, "unknown_field"),
        ("POST", "/v1/imagesets", r#"{"name":7}"#, 422, "invalid_body"),
        ("POST", "/v1/imagesets", r#"{"name":" "}"#, 422, "bad_name"),
        ("POST", "/v1/jobs", r#"{"imageset_ids":[]}"#, 422, "no_images"),
        (
            "POST",
            "/v1/jobs",
            r#"{"imageset_ids":["01900000-0000-7000-8000-000000000000"]}"#,
            422,
            "unknown_imageset",
        ),
        (
            "POST",
            "/v1/cameras",
            r#"{"name":"c","camera":{"model":"PINHOLE","width":1,"height":1,"params":[1]}}"#,
            422,
            "bad_camera",
        ),
    ] {
        let answer = client.send(method, path, &json, body.as_bytes()).await.expect(status);
        assert_eq!(answer.code(), code, "{method} {path} {body}");
        let instance = answer.json()["instance"].as_str().unwrap().to_owned();
        assert!(path.starts_with(&instance), "{instance}");
    }
    let answer = client.send("POST", "/v1/imagesets", &[], b"{}").await.expect(415);
    assert_eq!(answer.code(), "unsupported_media_type");
}

#[tokio::test]
async fn a_body_over_the_limit_is_refused_before_it_is_read() {
    let server = Server::start_with(|config| config.limits.json_bytes = 1000).await;
    let long = json!({"name": "x".repeat(2000)});
    let answer = server.client.post("/v1/imagesets", long).await.expect(413);
    assert_eq!(answer.code(), "too_large");
}

#[tokio::test]
async fn the_page_is_served_packed_cached_and_under_a_strict_policy() {
    let server = Server::start().await;
    let client = server.client.with_token(None);
    let page = client.get("/").await.expect(200);
    assert!(page.header("content-type").unwrap().starts_with("text/html"));
    let policy = page.header("content-security-policy").unwrap();
    assert!(policy.starts_with("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
    // Places of the page are the page; what is no place of its is none.
    let (path, tag) = ("/maps/4711", page.header("etag").unwrap());
    assert_eq!(client.get(path).await.expect(200).body, page.body);
    client.send("GET", path, &[("If-None-Match", tag)], b"").await.expect(304);
    for nowhere in ["/nowhere", "/v1/nowhere", "/assets/nowhere.js", "/assets/..%2findex.html"] {
        assert_eq!(
            client.with_token(Some("x")).get(nowhere).await.expect(404).code(),
            "no_such_route"
        );
    }
    let text = String::from_utf8(page.body.clone()).unwrap();
    let assets: Vec<&str> = text.split('"').filter(|part| part.starts_with("/assets/")).collect();
    assert!(assets.iter().any(|path| path.ends_with(".js")), "{text}");
    for path in assets {
        let plain = client.get(path).await.expect(200);
        assert!(plain.header("cache-control").unwrap().contains("immutable"), "{path}");
        let accept = [("Accept-Encoding", "br, gzip;q=0.5")];
        let packed = client.send("GET", path, &accept, b"").await.expect(200);
        assert_eq!(packed.header("content-encoding"), Some("gzip"));
        assert_ne!(packed.header("etag"), plain.header("etag"));
        assert!(packed.body.starts_with(&[0x1f, 0x8b]) && packed.body.len() < plain.body.len());
        let refused = [("Accept-Encoding", "gzip;q=0")];
        assert_eq!(client.send("GET", path, &refused, b"").await.body, plain.body);
    }
}

#[tokio::test]
async fn cameras_are_made_replaced_and_listed() {
    let server = Server::start().await;
    let client = &server.client;
    let camera = |focal: f64| {
        json!({"model": "PINHOLE", "width": 640, "height": 480,
            "params": [focal, focal, 320.0, 240.0]})
    };
    let body = json!({"name": "drone 1", "camera": camera(500.0)});
    let made = client.post("/v1/cameras", body).await.expect(201);
    let path = made.header("location").unwrap().to_owned();
    assert_eq!(client.get(&path).await.expect(200).json(), made.json());
    let body = json!({"name": "drone 1, calibrated", "camera": camera(457.0)});
    let replaced = client.json("PUT", &path, &[], body).await.expect(200).json();
    assert_eq!(replaced["id"], made.json()["id"]);
    assert_eq!(replaced["camera"]["params"][0], 457.0);
    assert_eq!(client.get("/v1/cameras").await.json()["items"], json!([replaced]));
    let bad = json!({"name": "x", "camera": camera(-1.0)});
    assert_eq!(client.json("PUT", &path, &[], bad).await.expect(422).code(), "bad_camera");
    let nowhere = "/v1/cameras/01900000-0000-7000-8000-000000000000";
    let body = json!({"name": "x", "camera": camera(1.0)});
    client.json("PUT", nowhere, &[], body).await.expect(404);
}

#[tokio::test]
async fn readiness_names_what_is_missing() {
    let server = Server::start().await;
    server.client.get("/readyz").await.expect(200);
    let broken = Server::start_with(|config| config.worker_program = "/nowhere".into()).await;
    let health = broken.client.get("/readyz").await.expect(503).json();
    assert_eq!(health["status"], "unavailable");
    let metrics = server.client.get("/metrics").await.expect(200);
    let text = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(text.contains("volery_http_responses_total{class=\"2xx\"}"), "{text}");
}
