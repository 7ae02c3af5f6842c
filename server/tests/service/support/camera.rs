//! A camera that serves motion JPEG over HTTP, well or badly.

use std::{
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    task::{JoinHandle, JoinSet},
};

use super::photo;

/// Between two pictures.
const INTERVAL: Duration = Duration::from_millis(50);

/// What a camera answers.
#[derive(Debug, Clone)]
pub(crate) enum Answer {
    /// Pictures without end, with lengths and times; the clock begins with the connection.
    Pictures,
    /// Pictures without end, with neither.
    BarePictures,
    /// These bytes, and then nothing more.
    Bytes(Vec<u8>),
    /// These bytes, and the end.
    BytesAndEnd(Vec<u8>),
    /// A head, and then a byte now and then.
    Drip,
}

/// Runs until it is dropped; everybody who looks is then cut off.
#[derive(Debug)]
pub(crate) struct TestCamera {
    pub(crate) addr: SocketAddr,
    /// Connections so far.
    pub(crate) num_asked: Arc<AtomicUsize>,
    /// Those that are open.
    pub(crate) num_open: Arc<AtomicUsize>,
    run: JoinHandle<()>,
}

impl TestCamera {
    pub(crate) async fn start(answer: Answer) -> Self {
        Self::start_at(([127, 0, 0, 1], 0).into(), answer).await
    }

    pub(crate) async fn start_at(addr: SocketAddr, answer: Answer) -> Self {
        let listener = TcpListener::bind(addr).await.unwrap();
        let addr = listener.local_addr().unwrap();
        let (num_asked, num_open) = <(Arc<AtomicUsize>, Arc<AtomicUsize>)>::default();
        let run = tokio::spawn({
            let (num_asked, num_open) = (Arc::clone(&num_asked), Arc::clone(&num_open));
            async move {
                let mut connections = JoinSet::new();
                loop {
                    let (stream, _) = listener.accept().await.unwrap();
                    num_asked.fetch_add(1, Ordering::Relaxed);
                    num_open.fetch_add(1, Ordering::Relaxed);
                    let (answer, num_open) = (answer.clone(), Arc::clone(&num_open));
                    connections.spawn(async move {
                        // Whoever looked is gone.
                        let _ = serve(stream, answer).await;
                        num_open.fetch_sub(1, Ordering::Relaxed);
                    });
                }
            }
        });
        Self { addr, num_asked, num_open, run }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}/stream", self.addr)
    }
}

impl Drop for TestCamera {
    fn drop(&mut self) {
        self.run.abort();
    }
}

async fn serve(mut stream: TcpStream, answer: Answer) -> std::io::Result<()> {
    let mut request = Vec::new();
    while !request.ends_with(b"\r\n\r\n") {
        if stream.read_buf(&mut request).await? == 0 {
            return Ok(());
        }
    }
    let head = b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=cut\r\n\r\n";
    match answer {
        Answer::Bytes(bytes) => {
            stream.write_all(&bytes).await?;
            let mut rest = Vec::new();
            stream.read_to_end(&mut rest).await.map(drop)
        }
        Answer::BytesAndEnd(bytes) => stream.write_all(&bytes).await,
        Answer::Drip => {
            stream.write_all(head).await?;
            stream.write_all(b"--cut\r\n\r\n").await?;
            loop {
                stream.write_all(b"x").await?;
                tokio::time::sleep(Duration::from_millis(200)).await;
            }
        }
        Answer::Pictures | Answer::BarePictures => {
            stream.write_all(head).await?;
            let start = Instant::now();
            for number in 0.. {
                let picture = photo(&format!("picture {number}"));
                let fields = match answer {
                    Answer::Pictures => format!(
                        "Content-Length: {}\r\nX-Timestamp: {:.6}\r\n",
                        picture.len(),
                        start.elapsed().as_secs_f64()
                    ),
                    _ => "Content-Type: image/jpeg\r\n".to_owned(),
                };
                let head = format!("--cut\r\n{fields}\r\n");
                let part = [head.as_bytes(), &picture, b"\r\n"];
                stream.write_all(&part.concat()).await?;
                tokio::time::sleep(INTERVAL).await;
            }
            Ok(())
        }
    }
}
