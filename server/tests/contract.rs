//! The contract: `openapi.yaml` is what the routes are.

use expect_test::expect_file;
use volery_server::openapi;

/// `UPDATE_EXPECT=1 cargo test -p volery-server --test contract` rewrites the file.
#[test]
fn openapi_yaml_is_current() {
    expect_file!["../../openapi.yaml"].assert_eq(&volery_server::openapi_yaml());
}

/// The standard asks for one, and some tools refuse the file without.
#[test]
fn every_response_is_described() {
    let openapi = serde_json::to_value(openapi()).unwrap();
    for (path, item) in openapi["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            for (status, response) in operation["responses"].as_object().unwrap() {
                let text = response["description"].as_str().unwrap_or_default();
                assert!(!text.is_empty(), "{method} {path} {status}");
            }
            let summary = operation["summary"].as_str().unwrap_or_default();
            assert!(!summary.is_empty(), "{method} {path}");
        }
    }
}
