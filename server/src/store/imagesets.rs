//! Image sets and images.

use std::collections::BTreeMap;

use sqlx::{Row, sqlite::SqliteRow};
use uuid::Uuid;
use volery_api::{
    CreateImageSet, Image, ImageSet, Page, PatchImageSet, Prior, PriorsReport, worker::ImageCheck,
};

use super::{PageAt, Store, blobs::Blob, json, uuid};
use crate::{
    clock,
    error::{ApiError, ApiResult, Code},
    idempotency::{Identity, same_request},
};

/// An image whose blob is safe on the disk.
pub(crate) struct NewImage<'a> {
    pub(crate) imageset: Uuid,
    pub(crate) name: &'a str,
    pub(crate) blob: &'a Blob,
    pub(crate) check: &'a ImageCheck,
    pub(crate) prior: Option<&'a Prior>,
    pub(crate) capture_time_ns: Option<u64>,
}

/// What became of a [`NewImage`].
pub(crate) enum StoredImage {
    Stored(Uuid),
    Duplicate(Uuid),
    NameTaken,
    SetFull,
}

const SELECT_SET: &str = "SELECT s.*, (SELECT COUNT(*) FROM images i WHERE i.imageset_id = s.id)
    AS num_images FROM imagesets s WHERE s.id = ?1";

impl Store {
    /// Keeps an image set; the same identity and request gives the same set again.
    pub(crate) async fn insert_imageset(
        &self,
        identity: &Identity,
        request: &CreateImageSet,
    ) -> ApiResult<ImageSet> {
        self.check_camera(request.camera_id).await?;
        let text = serde_json::to_string(request)?;
        sqlx::query(
            "INSERT INTO imagesets (id, request, name, camera_id, notes, created_ms)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6) ON CONFLICT (id) DO NOTHING",
        )
        .bind(identity.id.to_string())
        .bind(&text)
        .bind(&request.name)
        .bind(request.camera_id.map(|id| id.to_string()))
        .bind(&request.notes)
        .bind(clock::now_ms())
        .execute(&self.writer)
        .await?;
        let row =
            sqlx::query(SELECT_SET).bind(identity.id.to_string()).fetch_one(&self.writer).await?;
        same_request(row.try_get("request")?, &text)?;
        Ok(imageset(&row)?)
    }

    async fn check_camera(&self, id: Option<Uuid>) -> ApiResult<()> {
        let Some(id) = id else { return Ok(()) };
        match self.camera(id).await {
            Err(ApiError { code: Code::NotFound, detail, .. }) => {
                Err(ApiError::new(Code::Unprocessable("unknown_camera"), detail))
            }
            result => result.map(|_| ()),
        }
    }

    /// By id.
    pub(crate) async fn imageset(&self, id: Uuid) -> ApiResult<ImageSet> {
        let row = sqlx::query(SELECT_SET)
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await?
            .ok_or_else(|| ApiError::not_found("image set", id))?;
        Ok(imageset(&row)?)
    }

    /// In the order of their making.
    pub(crate) async fn imagesets(&self, at: PageAt) -> ApiResult<Page<ImageSet>> {
        let rows = sqlx::query(
            "SELECT s.*, (SELECT COUNT(*) FROM images i WHERE i.imageset_id = s.id) AS num_images
             FROM imagesets s WHERE s.seq > ?1 ORDER BY s.seq LIMIT ?2",
        )
        .bind(at.after)
        .bind(at.limit + 1)
        .fetch_all(&self.readers)
        .await?;
        let sets = rows.iter().map(|row| Ok((row.try_get("seq")?, imageset(row)?)));
        Ok(at.page(sets.collect::<Result<_, sqlx::Error>>()?))
    }

    /// Changes what is named.
    pub(crate) async fn patch_imageset(
        &self,
        id: Uuid,
        patch: &PatchImageSet,
    ) -> ApiResult<ImageSet> {
        self.check_camera(patch.camera_id).await?;
        sqlx::query(
            "UPDATE imagesets SET name = COALESCE(?2, name), camera_id = COALESCE(?3, camera_id),
             notes = COALESCE(?4, notes) WHERE id = ?1",
        )
        .bind(id.to_string())
        .bind(&patch.name)
        .bind(patch.camera_id.map(|id| id.to_string()))
        .bind(&patch.notes)
        .execute(&self.writer)
        .await?;
        self.imageset(id).await
    }

    /// Whether there was one to delete. Its images go with it; maps made of them stay.
    pub(crate) async fn delete_imageset(&self, id: Uuid) -> ApiResult<bool> {
        let result = sqlx::query("DELETE FROM imagesets WHERE id = ?1")
            .bind(id.to_string())
            .execute(&self.writer)
            .await?;
        Ok(result.rows_affected() > 0)
    }

    /// Makes an image visible; the last step of an upload.
    pub(crate) async fn insert_image(
        &self,
        new: &NewImage<'_>,
        max_images: u64,
    ) -> ApiResult<StoredImage> {
        let set = new.imageset.to_string();
        let mut tx = self.begin().await?;
        let row = sqlx::query(
            "SELECT EXISTS (SELECT 1 FROM imagesets WHERE id = ?1) AS known,
             (SELECT COUNT(*) FROM images WHERE imageset_id = ?1) AS num_images,
             (SELECT id FROM images WHERE imageset_id = ?1 AND sha256 = ?2) AS equal,
             EXISTS (SELECT 1 FROM images WHERE imageset_id = ?1 AND name = ?3) AS name_taken",
        )
        .bind(&set)
        .bind(&new.blob.sha256)
        .bind(new.name)
        .fetch_one(&mut *tx)
        .await?;
        if row.try_get::<i64, _>("known")? == 0 {
            return Err(ApiError::not_found("image set", new.imageset));
        }
        if let Some(id) = row.try_get::<Option<String>, _>("equal")? {
            return Ok(StoredImage::Duplicate(uuid(&id)?));
        }
        if row.try_get::<i64, _>("name_taken")? != 0 {
            return Ok(StoredImage::NameTaken);
        }
        if row.try_get::<i64, _>("num_images")? as u64 >= max_images {
            return Ok(StoredImage::SetFull);
        }
        let id = Uuid::now_v7();
        let now = clock::now_ms();
        insert_blob(&mut tx, &new.blob.sha256, new.blob.size, now).await?;
        sqlx::query(
            "INSERT INTO images (id, imageset_id, name, sha256, size, format, width, height, exif,
             prior, capture_time_ns, created_ms)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
        )
        .bind(id.to_string())
        .bind(&set)
        .bind(new.name)
        .bind(&new.blob.sha256)
        .bind(new.blob.size as i64)
        .bind(&new.check.format)
        .bind(new.check.width)
        .bind(new.check.height)
        .bind(serde_json::to_string(&new.check.exif)?)
        .bind(new.prior.map(serde_json::to_string).transpose()?)
        .bind(new.capture_time_ns.map(|time| time as i64))
        .bind(now)
        .execute(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(StoredImage::Stored(id))
    }

    /// In the order of their upload.
    pub(crate) async fn images(&self, imageset: Uuid, at: PageAt) -> ApiResult<Page<Image>> {
        let rows = sqlx::query(
            "SELECT * FROM images WHERE imageset_id = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3",
        )
        .bind(imageset.to_string())
        .bind(at.after)
        .bind(at.limit + 1)
        .fetch_all(&self.readers)
        .await?;
        let images = rows.iter().map(|row| Ok((row.try_get("seq")?, image(row)?)));
        Ok(at.page(images.collect::<Result<_, sqlx::Error>>()?))
    }

    /// Every image of a set, by name.
    pub(crate) async fn images_by_name(&self, imageset: Uuid) -> ApiResult<Vec<Image>> {
        let rows = sqlx::query("SELECT * FROM images WHERE imageset_id = ?1 ORDER BY name")
            .bind(imageset.to_string())
            .fetch_all(&self.readers)
            .await?;
        Ok(rows.iter().map(image).collect::<Result<_, _>>()?)
    }

    /// By id.
    pub(crate) async fn image(&self, id: Uuid) -> ApiResult<Image> {
        let row = sqlx::query("SELECT * FROM images WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await?
            .ok_or_else(|| ApiError::not_found("image", id))?;
        Ok(image(&row)?)
    }

    /// Whether there was one to delete.
    pub(crate) async fn delete_image(&self, id: Uuid) -> ApiResult<bool> {
        let result = sqlx::query("DELETE FROM images WHERE id = ?1")
            .bind(id.to_string())
            .execute(&self.writer)
            .await?;
        Ok(result.rows_affected() > 0)
    }

    /// All or nothing, but for names that no image has.
    pub(crate) async fn put_priors(
        &self,
        imageset: Uuid,
        priors: &BTreeMap<String, Prior>,
    ) -> ApiResult<PriorsReport> {
        let mut report = PriorsReport::default();
        let mut tx = self.begin().await?;
        for (name, prior) in priors {
            let result =
                sqlx::query("UPDATE images SET prior = ?3 WHERE imageset_id = ?1 AND name = ?2")
                    .bind(imageset.to_string())
                    .bind(name)
                    .bind(serde_json::to_string(prior)?)
                    .execute(&mut *tx)
                    .await?;
            if result.rows_affected() > 0 {
                report.updated += 1;
            } else {
                report.unknown.push(name.clone());
            }
        }
        tx.commit().await?;
        Ok(report)
    }
}

/// A row that says that a blob is whole and on the disk.
pub(super) async fn insert_blob(
    connection: &mut sqlx::SqliteConnection,
    sha256: &str,
    size: u64,
    now: i64,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO blobs (sha256, size, created_ms) VALUES (?1, ?2, ?3)
         ON CONFLICT (sha256) DO UPDATE SET created_ms = excluded.created_ms",
    )
    .bind(sha256)
    .bind(size as i64)
    .bind(now)
    .execute(connection)
    .await?;
    Ok(())
}

fn imageset(row: &SqliteRow) -> Result<ImageSet, sqlx::Error> {
    Ok(ImageSet {
        id: uuid(row.try_get("id")?)?,
        name: row.try_get("name")?,
        camera_id: row.try_get::<Option<&str>, _>("camera_id")?.map(uuid).transpose()?,
        notes: row.try_get("notes")?,
        num_images: row.try_get::<i64, _>("num_images")? as u64,
        created: clock::rfc3339(row.try_get("created_ms")?),
    })
}

fn image(row: &SqliteRow) -> Result<Image, sqlx::Error> {
    Ok(Image {
        id: uuid(row.try_get("id")?)?,
        imageset_id: uuid(row.try_get("imageset_id")?)?,
        name: row.try_get("name")?,
        sha256: row.try_get("sha256")?,
        size: row.try_get::<i64, _>("size")? as u64,
        format: row.try_get("format")?,
        width: row.try_get("width")?,
        height: row.try_get("height")?,
        exif: json(row.try_get("exif")?)?,
        prior: row.try_get::<Option<&str>, _>("prior")?.map(json).transpose()?,
        capture_time_ns: row.try_get::<Option<i64>, _>("capture_time_ns")?.map(|t| t as u64),
        created: clock::rfc3339(row.try_get("created_ms")?),
    })
}
