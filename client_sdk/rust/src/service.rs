//! The service itself, tokens, cameras.

use reqwest::Method;
use uuid::Uuid;
use volery_api::{
    AuditEntry, Camera, CreateCamera, CreateToken, CreatedToken, Health, Info, Role, StoredCamera,
    Token,
};

use crate::{Client, ClientError, client::parsed};

impl Client {
    /// Facts and limits.
    pub async fn info(&self) -> Result<Info, ClientError> {
        self.get("/v1/info").await
    }

    /// Whether the server can work. One that cannot answers with a problem or an unready health.
    pub async fn ready(&self) -> Result<Health, ClientError> {
        let answer = self.request(Method::GET, "/readyz").send().await?;
        parsed(&answer.bytes().await?)
    }

    /// A new token; its secret is in the answer and nowhere else.
    pub async fn create_token(
        &self,
        name: &str,
        role: Role,
        expires_in_s: Option<u64>,
    ) -> Result<CreatedToken, ClientError> {
        let body = CreateToken { name: name.to_owned(), role, expires_in_s };
        self.call(Method::POST, "/v1/tokens", &body).await
    }

    /// All tokens.
    pub async fn tokens(&self) -> Result<Vec<Token>, ClientError> {
        self.list("/v1/tokens").await
    }

    /// Ends a token.
    pub async fn delete_token(&self, id: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/tokens/{id}")).await
    }

    /// Who did what when, newest first.
    pub async fn audit(&self) -> Result<Vec<AuditEntry>, ClientError> {
        self.list("/v1/audit").await
    }

    /// Keeps a camera.
    pub async fn create_camera(
        &self,
        name: &str,
        camera: Camera,
    ) -> Result<StoredCamera, ClientError> {
        let body = CreateCamera { name: name.to_owned(), camera };
        self.call(Method::POST, "/v1/cameras", &body).await
    }

    /// Another name and other intrinsics for a kept camera.
    pub async fn replace_camera(
        &self,
        id: Uuid,
        name: &str,
        camera: Camera,
    ) -> Result<StoredCamera, ClientError> {
        let body = CreateCamera { name: name.to_owned(), camera };
        self.call(Method::PUT, &format!("/v1/cameras/{id}"), &body).await
    }

    /// All kept cameras.
    pub async fn cameras(&self) -> Result<Vec<StoredCamera>, ClientError> {
        self.list("/v1/cameras").await
    }
}
