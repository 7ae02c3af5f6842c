//! A child that answers questions on its standard input.

use std::process::Stdio;

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    process::{ChildStdin, ChildStdout},
};
use volery_api::worker::MAX_WORKER_HEADER;

use super::process::{command, confine};
use crate::config::Config;

/// It ends with its handle.
#[derive(Debug)]
pub(super) struct Child {
    _process: tokio::process::Child,
    stdin: ChildStdin,
    stdout: ChildStdout,
}

impl Child {
    /// `<program> <word>` with `bytes` of address space.
    pub(super) fn start(config: &Config, word: &str, bytes: u64) -> std::io::Result<Self> {
        let mut process = command(config, word).stderr(Stdio::null()).spawn()?;
        confine(&process, bytes, 0);
        let (stdin, stdout) = process.stdin.take().zip(process.stdout.take()).ok_or_else(|| {
            std::io::Error::other("the worker's standard input and output are not piped")
        })?;
        Ok(Self { _process: process, stdin, stdout })
    }

    /// Header and payload of the answer. A child whose answer was not waited for is of no use.
    pub(super) async fn ask(
        &mut self,
        header: &[u8],
        payload: &[u8],
    ) -> std::io::Result<(Vec<u8>, Vec<u8>)> {
        let too_long = || std::io::Error::from(std::io::ErrorKind::InvalidInput);
        for part in [header, payload] {
            let len = u32::try_from(part.len()).map_err(|_| too_long())?;
            self.stdin.write_all(&len.to_le_bytes()).await?;
            self.stdin.write_all(part).await?;
        }
        self.stdin.flush().await?;
        Ok((self.read_part().await?, self.read_part().await?))
    }

    async fn read_part(&mut self) -> std::io::Result<Vec<u8>> {
        let len = self.stdout.read_u32_le().await? as usize;
        if len > MAX_WORKER_HEADER {
            return Err(std::io::ErrorKind::InvalidData.into());
        }
        let mut part = vec![0; len];
        self.stdout.read_exact(&mut part).await?;
        Ok(part)
    }
}
