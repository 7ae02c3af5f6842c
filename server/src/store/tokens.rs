//! Tokens: only the hashes of their secrets are kept.

use sqlx::{Row, sqlite::SqliteRow};
use uuid::Uuid;
use volery_api::{Page, Role, Token};

use super::{PageAt, Store, uuid};
use crate::{clock, error::ApiResult};

/// What a request's token says.
#[derive(Debug, Clone)]
pub(crate) struct TokenRow {
    pub(crate) id: Uuid,
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) hash: Vec<u8>,
    pub(crate) expires_ms: Option<i64>,
}

impl Store {
    /// Keeps a token.
    pub(crate) async fn insert_token(
        &self,
        name: &str,
        role: Role,
        hash: &[u8; 32],
        expires_ms: Option<i64>,
    ) -> ApiResult<Token> {
        let id = Uuid::now_v7();
        let created_ms = clock::now_ms();
        sqlx::query(
            "INSERT INTO tokens (id, name, role, hash, created_ms, expires_ms)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
        )
        .bind(id.to_string())
        .bind(name)
        .bind(role.name())
        .bind(&hash[..])
        .bind(created_ms)
        .bind(expires_ms)
        .execute(&self.writer)
        .await?;
        Ok(Token {
            id,
            name: name.to_owned(),
            role,
            created: clock::rfc3339(created_ms),
            expires: expires_ms.map(clock::rfc3339),
        })
    }

    /// By the hash of its secret.
    pub(crate) async fn token_by_hash(&self, hash: &[u8; 32]) -> ApiResult<Option<TokenRow>> {
        let row =
            sqlx::query("SELECT id, name, role, hash, expires_ms FROM tokens WHERE hash = ?1")
                .bind(&hash[..])
                .fetch_optional(&self.readers)
                .await?;
        let Some(row) = row else { return Ok(None) };
        Ok(Some(TokenRow {
            id: uuid(row.try_get("id")?)?,
            name: row.try_get("name")?,
            role: role(&row)?,
            hash: row.try_get("hash")?,
            expires_ms: row.try_get("expires_ms")?,
        }))
    }

    /// Whether a token is still valid.
    pub(crate) async fn token_lives(&self, id: Uuid) -> ApiResult<bool> {
        let row = sqlx::query(
            "SELECT EXISTS (SELECT 1 FROM tokens WHERE id = ?1 AND
             (expires_ms IS NULL OR expires_ms > ?2)) AS lives",
        )
        .bind(id.to_string())
        .bind(clock::now_ms())
        .fetch_one(&self.readers)
        .await?;
        Ok(row.try_get::<i64, _>("lives")? != 0)
    }

    /// Whether there is any token.
    pub(crate) async fn has_tokens(&self) -> ApiResult<bool> {
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM tokens) AS any_token")
            .fetch_one(&self.readers)
            .await?;
        Ok(row.try_get::<i64, _>("any_token")? != 0)
    }

    /// In the order of their making.
    pub(crate) async fn tokens(&self, at: PageAt) -> ApiResult<Page<Token>> {
        let rows = sqlx::query("SELECT * FROM tokens WHERE seq > ?1 ORDER BY seq LIMIT ?2")
            .bind(at.after)
            .bind(at.limit + 1)
            .fetch_all(&self.readers)
            .await?;
        let tokens = rows.iter().map(|row| Ok((row.try_get("seq")?, token(row)?)));
        Ok(at.page(tokens.collect::<Result<_, sqlx::Error>>()?))
    }

    /// Whether there was one to delete.
    pub(crate) async fn delete_token(&self, id: Uuid) -> ApiResult<bool> {
        let result = sqlx::query("DELETE FROM tokens WHERE id = ?1")
            .bind(id.to_string())
            .execute(&self.writer)
            .await?;
        Ok(result.rows_affected() > 0)
    }
}

fn role(row: &SqliteRow) -> Result<Role, sqlx::Error> {
    let name: &str = row.try_get("role")?;
    Role::from_name(name).ok_or_else(|| sqlx::Error::Decode(format!("role {name:?}").into()))
}

fn token(row: &SqliteRow) -> Result<Token, sqlx::Error> {
    Ok(Token {
        id: uuid(row.try_get("id")?)?,
        name: row.try_get("name")?,
        role: role(row)?,
        created: clock::rfc3339(row.try_get("created_ms")?),
        expires: row.try_get::<Option<i64>, _>("expires_ms")?.map(clock::rfc3339),
    })
}
