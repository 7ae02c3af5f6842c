//! Maps, exports, localization.

use reqwest::{Method, header};
use serde::de::DeserializeOwned;
use uuid::Uuid;
use volery_api::{
    ActivateMap, AlignRequest, Aligned, Camera, Job, LocalizeAnswer, LocalizeManyAnswer,
    LocalizeMethod, LocalizePrior, Map, MapCameras, MapVersion, RegisterMaps, RenderRequest,
};

use crate::{Client, ClientError, client::parsed};

/// A photo to be localized.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LocalizeQuery {
    /// JPEG or PNG.
    pub image: Vec<u8>,
    /// Its camera; the map's own camera or EXIF when absent.
    pub camera: Option<Camera>,
    /// Where it may be.
    pub prior: Option<LocalizePrior>,
    /// The active version when absent.
    pub version: Option<u32>,
    /// The server's choice when absent.
    pub method: Option<LocalizeMethod>,
}

impl LocalizeQuery {
    /// Version and method as a query, with `more` before them.
    fn parameters(&self, more: Option<String>) -> Result<String, ClientError> {
        let mut parameters: Vec<String> = more.into_iter().collect();
        parameters.extend(self.version.map(|version| format!("version={version}")));
        if let Some(method) = &self.method {
            let word = serde_json::to_string(method)
                .map_err(|e| ClientError::BadArgument(e.to_string()))?;
            parameters.push(format!("method={}", word.trim_matches('"')));
        }
        let start = if parameters.is_empty() { "" } else { "?" };
        Ok(format!("{start}{}", parameters.join("&")))
    }
}

impl Client {
    /// All maps.
    pub async fn maps(&self) -> Result<Vec<Map>, ClientError> {
        self.list("/v1/maps").await
    }

    /// A map with its active version.
    pub async fn map(&self, id: Uuid) -> Result<Map, ClientError> {
        self.get(&format!("/v1/maps/{id}")).await
    }

    /// All versions of a map.
    pub async fn map_versions(&self, id: Uuid) -> Result<Vec<MapVersion>, ClientError> {
        self.list(&format!("/v1/maps/{id}/versions")).await
    }

    /// Makes a version the one that answers.
    pub async fn activate_version(&self, id: Uuid, version: u32) -> Result<Map, ClientError> {
        let path = format!("/v1/maps/{id}/activate");
        self.call(Method::POST, &path, &ActivateMap { version }).await
    }

    /// Forgets a map with all its versions.
    pub async fn delete_map(&self, id: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/maps/{id}")).await
    }

    /// A new version in another frame or scale.
    pub async fn align_map(
        &self,
        id: Uuid,
        request: &AlignRequest,
    ) -> Result<Aligned, ClientError> {
        self.call(Method::POST, &format!("/v1/maps/{id}/align"), request).await
    }

    /// Queues a job that joins maps which share a part.
    pub async fn register_maps(&self, request: &RegisterMaps) -> Result<Job, ClientError> {
        self.call(Method::POST, "/v1/maps:register", request).await
    }

    /// Poses and cameras of a map.
    pub async fn map_cameras(&self, id: Uuid) -> Result<MapCameras, ClientError> {
        self.get(&format!("/v1/maps/{id}/cameras")).await
    }

    /// An export of a map: `colmap.zip`, `dense.ply`, `map.glb`, ...; `/v1/info` lists them.
    pub async fn export(
        &self,
        id: Uuid,
        name: &str,
        version: Option<u32>,
    ) -> Result<bytes::Bytes, ClientError> {
        let version = version.map_or(String::new(), |v| format!("?version={v}"));
        let path = format!("/v1/maps/{id}/export/{name}{version}");
        self.send(self.request(Method::GET, &path)).await
    }

    /// Where the air of a map is free, occupied or unseen: a grid of voxels as `openapi.yaml`
    /// describes it.
    pub async fn map_free_space(&self, id: Uuid) -> Result<bytes::Bytes, ClientError> {
        let path = format!("/v1/maps/{id}/freespace");
        self.send(self.request(Method::GET, &path)).await
    }

    /// What a virtual camera sees of the active version of a map: a PNG, or for
    /// [`volery_api::RenderWhat::DepthF32`] the depths.
    pub async fn render_map(
        &self,
        id: Uuid,
        request: &RenderRequest,
    ) -> Result<bytes::Bytes, ClientError> {
        let path = format!("/v1/maps/{id}/render");
        self.send(self.request(Method::POST, &path).json(request)).await
    }

    /// The pose of a photo, or why there is none.
    pub async fn localize(
        &self,
        map: Uuid,
        query: &LocalizeQuery,
    ) -> Result<LocalizeAnswer, ClientError> {
        let parameters = query.parameters(None)?;
        self.ask(&format!("/v1/maps/{map}/localize{parameters}"), query).await
    }

    /// The pose of a photo in the active version of one of several maps, or why there is none.
    pub async fn localize_in_maps(
        &self,
        maps: &[Uuid],
        query: &LocalizeQuery,
    ) -> Result<LocalizeManyAnswer, ClientError> {
        if query.version.is_some() {
            let detail = "several maps have no version in common".to_owned();
            return Err(ClientError::BadArgument(detail));
        }
        let ids: Vec<_> = maps.iter().map(Uuid::to_string).collect();
        let parameters = query.parameters(Some(format!("map_ids={}", ids.join(","))))?;
        self.ask(&format!("/v1/localize{parameters}"), query).await
    }

    async fn ask<T: DeserializeOwned>(
        &self,
        path: &str,
        query: &LocalizeQuery,
    ) -> Result<T, ClientError> {
        let json = |value: Result<String, serde_json::Error>| {
            value.map_err(|e| ClientError::BadArgument(e.to_string()))
        };
        let camera = query.camera.as_ref().map(serde_json::to_string).map(json).transpose()?;
        let prior = query.prior.as_ref().map(serde_json::to_string).map(json).transpose()?;
        let mut request = self
            .request(Method::POST, path)
            .header(header::CONTENT_TYPE, "application/octet-stream")
            .body(query.image.clone());
        if let Some(camera) = camera {
            request = request.header("X-Camera", camera);
        }
        if let Some(prior) = prior {
            request = request.header("X-Pose-Prior", prior);
        }
        parsed(&self.send(request).await?)
    }
}
