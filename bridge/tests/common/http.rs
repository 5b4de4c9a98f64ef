//! Small hands for the bridge's tests: raw HTTP and a WebSocket as bytes, so that nothing is hidden by a client.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Sends one request with the given header lines and returns the connection and the answer up to its empty line.
pub fn ask(address: SocketAddr, path: &str, headers: &[&str]) -> (TcpStream, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let lines: String = headers.iter().map(|line| format!("{line}\r\n")).collect();
    write!(stream, "GET {path} HTTP/1.1\r\n{lines}\r\n").unwrap();
    let (mut head, mut byte) = (Vec::new(), [0]);
    while !head.ends_with(b"\r\n\r\n") && stream.read(&mut byte).unwrap() == 1 {
        head.push(byte[0]);
    }
    (stream, String::from_utf8(head).unwrap())
}

/// The body of an answer whose connection is closed at its end.
pub fn get(address: SocketAddr, path: &str) -> (String, String) {
    let (mut stream, head) = ask(address, path, &[&format!("Host: {address}"), "Connection: close"]);
    let mut body = String::new();
    stream.read_to_string(&mut body).unwrap();
    (head, body)
}

/// What a browser sends to open a WebSocket, with this Host and Origin.
pub fn upgrade<'a>(host: &'a str, origin: &'a str) -> [&'a str; 6] {
    let key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==";
    ["Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13", key, host, origin]
}

/// Reads one message of a server: never masked, never fragmented by ours.
pub fn read_message(stream: &mut TcpStream) -> Vec<u8> {
    let mut head = [0; 2];
    stream.read_exact(&mut head).unwrap();
    let length = match head[1] {
        126 => u16::from_be_bytes(read_array(stream)).into(),
        127 => u64::from_be_bytes(read_array(stream)),
        short => u64::from(short),
    };
    let mut payload = vec![0; usize::try_from(length).unwrap()];
    stream.read_exact(&mut payload).unwrap();
    payload
}

fn read_array<const N: usize>(stream: &mut TcpStream) -> [u8; N] {
    let mut bytes = [0; N];
    stream.read_exact(&mut bytes).unwrap();
    bytes
}

/// Sends a short text message, masked with zeros as the standard allows a client to.
pub fn send_text(stream: &mut TcpStream, text: &str) {
    assert!(text.len() < 126);
    stream.write_all(&[0x81, 0x80 | text.len() as u8, 0, 0, 0, 0]).unwrap();
    stream.write_all(text.as_bytes()).unwrap();
}
