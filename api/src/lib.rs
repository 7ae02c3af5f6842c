//! Wire types of openapi.yaml.
