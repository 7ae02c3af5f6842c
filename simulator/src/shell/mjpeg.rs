//! Motion JPEG over HTTP, as an ESP32-CAM serves it.

use std::net::SocketAddr;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::SimulationError;
use super::feed::Pictures;

/// Longest request that is read.
const MAX_REQUEST: usize = 8192;

/// Opens the port; the future serves whoever comes.
pub(super) async fn serve_mjpeg(
    bind: SocketAddr,
    pictures: Pictures,
) -> Result<(SocketAddr, impl Future<Output = ()> + Send + 'static), SimulationError> {
    let failed = |source| SimulationError::Bind { bind, source };
    let listener = TcpListener::bind(bind).await.map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    let serve = async move {
        while let Ok((socket, _)) = listener.accept().await {
            // A viewer that leaves ends its own connection alone.
            tokio::spawn(show(socket, pictures.clone()));
        }
    };
    Ok((address, serve))
}

async fn show(mut socket: TcpStream, mut pictures: Pictures) -> std::io::Result<()> {
    let mut request = Vec::new();
    while !request.windows(4).any(|w| w == b"\r\n\r\n") {
        if socket.read_buf(&mut request).await? == 0 || request.len() > MAX_REQUEST {
            return Ok(());
        }
    }
    if !request.starts_with(b"GET ") {
        let answer = b"HTTP/1.1 405 Method Not Allowed\r\nContent-Length: 0\r\n\r\n";
        return socket.write_all(answer).await;
    }
    socket
        .write_all(
            b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=frame\r\n\
              Cache-Control: no-store\r\nConnection: close\r\n\r\n",
        )
        .await?;
    loop {
        let next = pictures.borrow_and_update().clone();
        if let Some(picture) = next {
            let seconds = picture.captured_ns as f64 * 1e-9;
            let head = format!(
                "--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\
                 X-Timestamp: {seconds:.6}\r\n\r\n",
                picture.jpeg.len()
            );
            socket.write_all(head.as_bytes()).await?;
            socket.write_all(&picture.jpeg).await?;
            socket.write_all(b"\r\n").await?;
        }
        if pictures.changed().await.is_err() {
            return Ok(());
        }
    }
}
