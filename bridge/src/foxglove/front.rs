//! Shell: the door in front of the `foxglove` crate's server, which answers whoever asks: a page of another site in the
//! operator's browser could read the map.
//!
//! It reads the head of the request, lets the guard decide on Host and Origin, and passes bytes both ways from then on.
//! The server behind it listens on a port and an address in 127.0.0.0/8 that are drawn anew each time, so that no page can
//! find the way around the door: 40 bits to guess.

#![allow(clippy::disallowed_methods, reason = "shell: it listens on a socket")]

use crate::web::guard::Guard;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, copy_bidirectional_with_sizes};
use tokio::net::{TcpListener, TcpSocket, TcpStream};

/// Longest head of a request, bytes: browsers send less than 2 kB, and nothing else is read before the guard decides.
const HEAD_MAX: usize = 8192;
/// Longest time a client may take for it.
const HEAD_TIMEOUT: Duration = Duration::from_secs(5);
/// Bytes on their way in each direction of a connection.
const PIPE_BYTES: usize = 16 << 10;

/// The kernel's buffer between the server and the door; fixed, because the kernel would grow it for slow clients.
const RECEIVE_BUFFER_BYTES: u32 = 256 << 10;

/// Who may come in, where to, and how many.
#[derive(Debug)]
pub struct Door {
    /// Decides on Host and Origin.
    pub guard: Guard,
    /// The server behind.
    pub behind: SocketAddr,
    /// Most connections at a time.
    pub clients_max: usize,
    /// Connections now.
    pub clients: AtomicUsize,
}

/// A loopback address out of 16 million, from random bytes; never that of the door.
pub fn hidden_address(random: [u8; 3]) -> Ipv4Addr {
    let [a, b, c] = random;
    // 127.0.0.0/16 holds the addresses that people use.
    Ipv4Addr::new(127, a.max(1), b, c.clamp(1, 254))
}

/// Answers until the listener fails.
pub async fn serve(listener: TcpListener, door: Arc<Door>) {
    loop {
        match listener.accept().await {
            Ok((stream, _)) => {
                let door = Arc::clone(&door);
                tokio::spawn(async move {
                    if let Err(error) = door.admit(stream).await {
                        tracing::debug!(%error, "connection ended");
                    }
                });
            }
            Err(error) => {
                // Out of descriptors, most likely: it passes when a connection ends.
                tracing::warn!(%error, "connection not accepted");
                tokio::time::sleep(Duration::from_millis(200)).await;
            }
        }
    }
}

impl Door {
    async fn admit(&self, mut stream: TcpStream) -> io::Result<()> {
        if self.clients.fetch_add(1, Ordering::Relaxed) >= self.clients_max {
            self.clients.fetch_sub(1, Ordering::Relaxed);
            // An answer before the request is read would be lost: closing with unread bytes is a reset.
            let _ = tokio::time::timeout(HEAD_TIMEOUT, read_head(&mut stream)).await;
            return answer(&mut stream, "503 Service Unavailable", "[bridge.foxglove] max_clients allows no more")
                .await;
        }
        let ended = self.pass(&mut stream).await;
        self.clients.fetch_sub(1, Ordering::Relaxed);
        ended
    }

    async fn pass(&self, stream: &mut TcpStream) -> io::Result<()> {
        let head = match tokio::time::timeout(HEAD_TIMEOUT, read_head(stream)).await {
            Ok(head) => head?,
            Err(_) => return answer(stream, "408 Request Timeout", "no request came").await,
        };
        if let Some(reason) = refusal(&self.guard, &head) {
            tracing::warn!(%reason, "request refused");
            return answer(stream, "403 Forbidden", &reason).await;
        }
        let server = TcpSocket::new_v4()?;
        server.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
        let mut server = server.connect(self.behind).await?;
        server.write_all(&head).await?;
        copy_bidirectional_with_sizes(stream, &mut server, PIPE_BYTES, PIPE_BYTES).await?;
        Ok(())
    }
}

/// Reads up to the empty line that ends the head, and whatever came with it.
async fn read_head(stream: &mut TcpStream) -> io::Result<Vec<u8>> {
    let mut head = Vec::with_capacity(1024);
    while !head.windows(4).any(|end| end == b"\r\n\r\n") {
        if head.len() >= HEAD_MAX || stream.read_buf(&mut head).await? == 0 {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "no head of a request"));
        }
    }
    Ok(head)
}

async fn answer(stream: &mut TcpStream, status: &str, reason: &str) -> io::Result<()> {
    let length = reason.len() + 1;
    let head = format!("HTTP/1.1 {status}\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n{reason}\n");
    stream.write_all(head.as_bytes()).await?;
    stream.shutdown().await
}

/// Why a request may not pass, or nothing. Only one that asks for a WebSocket may; a header that comes twice may not.
pub fn refusal(guard: &Guard, head: &[u8]) -> Option<String> {
    let head = String::from_utf8_lossy(head);
    let head = head.split("\r\n\r\n").next().unwrap_or_default();
    let value = |wanted: &str| {
        let lines = head.split("\r\n").skip(1).filter_map(|line| line.split_once(':'));
        lines.filter(|(name, _)| name.eq_ignore_ascii_case(wanted)).map(|(_, v)| v.trim()).collect::<Vec<_>>()
    };
    let one = |wanted: &str| match value(wanted)[..] {
        [] => Ok(None),
        [one] => Ok(Some(one)),
        _ => Err(format!("the request names {wanted} more than once")),
    };
    let (host, origin) = match (one("host"), one("origin")) {
        (Ok(host), Ok(origin)) => (host, origin),
        (Err(reason), _) | (_, Err(reason)) => return Some(reason),
    };
    if !value("upgrade").iter().any(|protocol| protocol.eq_ignore_ascii_case("websocket")) {
        return Some("this is a WebSocket for Foxglove or Lichtblick, not a page".into());
    }
    guard.refusal(host, origin)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(headers: &[&str]) -> Option<String> {
        let guard = Guard::of(&[], &["https://app.foxglove.dev".into()], "127.0.0.1:8765".parse().unwrap());
        refusal(&guard, format!("GET / HTTP/1.1\r\n{}\r\n\r\n", headers.join("\r\n")).as_bytes())
    }

    #[test]
    fn programs_and_allowed_pages_pass_and_others_do_not() {
        let (host, upgrade) = ("Host: localhost:8765", "Upgrade: websocket");
        assert_eq!(refused(&[host, upgrade]), None);
        assert_eq!(refused(&["hOST:127.0.0.1:8765", "upgrade:  WebSocket", "Origin: https://app.foxglove.dev"]), None);
        for headers in [
            &[host, upgrade, "Origin: http://evil.example"][..],
            &[host, upgrade, "Origin: null"],
            &["Host: evil.example", upgrade],
            &[upgrade],
            &[host],
            &[host, upgrade, "Origin: https://app.foxglove.dev", "origin: http://evil.example"],
            &[host, upgrade, "Host: evil.example"],
        ] {
            assert!(refused(headers).is_some(), "{headers:?}");
        }
    }

    #[test]
    fn the_hidden_address_is_loopback_and_never_a_usual_one() {
        for random in [[0, 0, 0], [255, 255, 255], [7, 0, 1]] {
            let address = hidden_address(random);
            assert!(address.is_loopback() && address.octets()[1] != 0 && address.octets()[3] != 0, "{address}");
        }
    }
}
