//! Blobs that nothing refers to, deleted once they are old.
//!
//! An upload writes its blob first and its row last, so a young blob without a row may be on its
//! way. A row goes before its file; a crash between leaves a file without a row, which the next
//! round finds.

use std::{
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use super::{Store, blobs::Blobs};
use crate::error::ApiResult;

impl Store {
    /// Deletes blobs that nothing has referred to and nobody has written for `age`; answers how
    /// many.
    pub(crate) async fn collect_blobs(&self, blobs: &Blobs, age: Duration) -> ApiResult<u64> {
        let mut deleted = 0;
        for prefix in 0..=255_u8 {
            let folder = blobs.folder(prefix);
            for path in tokio::task::spawn_blocking(move || files(&folder)).await?? {
                deleted += u64::from(self.collect(blobs, &path, age).await?);
            }
        }
        Ok(deleted)
    }

    async fn collect(&self, blobs: &Blobs, path: &Path, age: Duration) -> ApiResult<bool> {
        let Some(sha256) = path.file_name().and_then(|name| name.to_str()) else {
            return Ok(false);
        };
        // No blob is written between the look at its age and its end.
        let _gate = blobs.gate.write().await;
        let written = tokio::fs::metadata(path).await?.modified()?;
        if SystemTime::now().duration_since(written).unwrap_or_default() < age {
            return Ok(false);
        }
        let mut tx = self.begin().await?;
        let row = sqlx::query(
            "SELECT EXISTS (SELECT 1 FROM images WHERE sha256 = ?1)
             OR EXISTS (SELECT 1 FROM map_files WHERE sha256 = ?1) AS held",
        )
        .bind(sha256)
        .fetch_one(&mut *tx)
        .await?;
        if sqlx::Row::try_get::<i64, _>(&row, "held")? != 0 {
            return Ok(false);
        }
        sqlx::query("DELETE FROM blobs WHERE sha256 = ?1").bind(sha256).execute(&mut *tx).await?;
        tx.commit().await?;
        tokio::fs::remove_file(path).await?;
        blobs.drop_thumbnails(sha256).await;
        Ok(true)
    }
}

fn files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use uuid::Uuid;
    use volery_api::{CreateImageSet, worker::ImageCheck};

    use super::*;
    use crate::{
        idempotency::Identity,
        store::{NewImage, thumbnails::THUMBNAIL_SIZES},
    };

    #[tokio::test]
    async fn only_old_blobs_that_nothing_holds_are_deleted() {
        let data = std::env::temp_dir().join(format!("volery-collect-{}", Uuid::now_v7()));
        std::fs::create_dir_all(&data).unwrap();
        let blobs = Blobs::open(&data, 0).unwrap();
        let store = Store::open(&data.join("volery.db")).await.unwrap();
        let put = |bytes: &'static [u8]| {
            let blobs = blobs.clone();
            tokio::task::spawn_blocking(move || blobs.put(bytes).unwrap())
        };
        let (held, loose) = (put(b"held").await.unwrap(), put(b"loose").await.unwrap());
        let identity = Identity { id: Uuid::now_v7(), keyed: false };
        let set = CreateImageSet { name: "hall".to_owned(), ..CreateImageSet::default() };
        let set = store.insert_imageset(&identity, &set).await.unwrap();
        let check = ImageCheck {
            width: 1,
            height: 1,
            format: "png".to_owned(),
            exif: BTreeMap::new(),
            warnings: Vec::new(),
        };
        let image = NewImage {
            imageset: set.id,
            name: "a.png",
            blob: &held,
            check: &check,
            prior: None,
            capture_time_ns: None,
        };
        store.insert_image(&image, 10).await.unwrap();

        let day = Duration::from_secs(24 * 3600);
        assert_eq!(store.collect_blobs(&blobs, day).await.unwrap(), 0);
        assert_eq!(store.collect_blobs(&blobs, Duration::ZERO).await.unwrap(), 1);
        assert!(blobs.path(&held.sha256).exists() && !blobs.path(&loose.sha256).exists());
        let thumbnail = blobs.thumbnail(&held.sha256, THUMBNAIL_SIZES[0]);
        let keep = |sha256: &str| {
            let (blobs, sha256) = (blobs.clone(), sha256.to_owned());
            let keep = move || blobs.put_thumbnail(&sha256, THUMBNAIL_SIZES[0], b"small");
            tokio::task::spawn_blocking(keep)
        };
        keep(&held.sha256).await.unwrap().unwrap();
        keep(&loose.sha256).await.unwrap().expect_err("of no photo, no copy");
        assert_eq!(store.collect_blobs(&blobs, Duration::ZERO).await.unwrap(), 0);
        assert_eq!(std::fs::read(&thumbnail).unwrap(), b"small");
        store.delete_imageset(set.id).await.unwrap();
        assert_eq!(store.collect_blobs(&blobs, Duration::ZERO).await.unwrap(), 1);
        assert!(!thumbnail.exists(), "it goes with its photo");
        store.close().await;
        std::fs::remove_dir_all(data).unwrap();
    }
}
