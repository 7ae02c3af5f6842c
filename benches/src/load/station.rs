//! The server under load, a process of its own.

use std::io::{BufRead, BufReader, Result, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A running server over a folder of its own.
pub(crate) struct Station {
    process: Child,
    program: PathBuf,
    folder: PathBuf,
    pub(crate) http: SocketAddr,
    pub(crate) mavlink: SocketAddr,
    pub(crate) token: String,
}

impl Station {
    /// Starts the program that was built with this one.
    pub(crate) fn start(key: &[u8; 32]) -> Result<Self> {
        let program = std::env::current_exe()?.with_file_name("volery");
        let folder = std::env::temp_dir().join(format!("volery-load-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        let key_file = folder.join("key");
        let hex: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
        std::fs::File::create(&key_file)?.write_all(hex.as_bytes())?;
        let mut process = Command::new(&program)
            .args(["serve", "--listen", "127.0.0.1:0", "--mavlink", "udp:127.0.0.1:0", "--data"])
            .arg(folder.join("data"))
            .arg("--mavlink-key")
            .arg(key_file)
            .env("VOLERY_LOG", "warn")
            .stdout(Stdio::piped())
            .spawn()?;
        let out = process.stdout.take().ok_or_else(|| std::io::Error::other("no output"))?;
        let said: Vec<String> = BufReader::new(out).lines().take(3).collect::<Result<_>>()?;
        let after = |line: usize, start: &str| {
            let rest = said.get(line).and_then(|line| line.strip_prefix(start));
            rest.map(str::to_owned).ok_or_else(|| std::io::Error::other(format!("{said:?}")))
        };
        let address = |text: String| text.parse().map_err(std::io::Error::other);
        Ok(Self {
            program,
            folder,
            http: address(after(0, "volery listens on http://")?)?,
            mavlink: address(after(1, "drones are heard on udp:")?)?,
            token: after(2, "admin token (shown this once): ")?,
            process,
        })
    }

    /// Has the server reconstruct `photos`; another process waits for it.
    pub(crate) fn reconstruct(&self, photos: &Path) -> Result<Child> {
        Command::new(&self.program)
            .args(["upload", "--reconstruct", "--server", &format!("http://{}", self.http)])
            .arg(photos)
            .env("VOLERY_TOKEN", &self.token)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
    }

    /// CPU seconds of the server itself, its children apart.
    pub(crate) fn cpu_s(&self) -> f64 {
        crate::clock::cpu_s(&format!("/proc/{}/stat", self.process.id()))[0]
    }

    /// Datagrams that the kernel has dropped before the server took them.
    pub(crate) fn num_dropped(&self) -> u64 {
        let port = format!(":{:04X}", self.mavlink.port());
        let table = std::fs::read_to_string("/proc/net/udp").unwrap_or_default();
        let mut rows = table.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
        rows.find(|row| row.get(1).is_some_and(|local| local.ends_with(&port)))
            .and_then(|row| row.last()?.parse().ok())
            .unwrap_or(0)
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
