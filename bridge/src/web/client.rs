//! Shell: one viewer's WebSocket. It sends the newest frames and reads next to nothing.
//!
//! A client costs a cursor, one frame on its way and the socket's buffers ([`WRITE_BUFFER_MAX`] and the kernel's
//! [`SEND_BUFFER_BYTES`]): under 8 MB, however slow it is. One that takes no byte for [`SEND_TIMEOUT`] is closed.
//! The only message understood is `{"want": ["map", ...]}`, the layers to send; all others are ignored.

use super::hub::Hub;
use super::slots::Cursor;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use serde::Deserialize;
use std::time::Duration;
use tokio::time::timeout;

/// Longest message read from a client, bytes: a list of layer names.
const MESSAGE_MAX: usize = 4096;
/// Most bytes waiting in user space: the largest frame (1 MB) and the bytes before it.
const WRITE_BUFFER_MAX: usize = 4 << 20;
/// The kernel's buffer a connection; fixed, because the kernel would grow it to several megabytes for slow clients.
pub const SEND_BUFFER_BYTES: u32 = 512 << 10;
/// Time a client may take for one frame.
const SEND_TIMEOUT: Duration = Duration::from_secs(20);

/// What a client may ask for.
#[derive(Deserialize)]
struct Subscription {
    want: Vec<String>,
}

/// Bounds of the socket, before it is upgraded.
pub fn bounded(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    upgrade
        .max_message_size(MESSAGE_MAX)
        .max_frame_size(MESSAGE_MAX)
        .read_buffer_size(MESSAGE_MAX)
        .write_buffer_size(0)
        .max_write_buffer_size(WRITE_BUFFER_MAX)
}

/// Serves one client until it leaves or stops reading.
pub async fn serve(mut socket: WebSocket, hub: &Hub) {
    let mut cursor = Cursor::default();
    let mut changes = hub.changes();
    loop {
        changes.mark_unchanged();
        if let Some(frame) = hub.next(&mut cursor) {
            let sent = timeout(SEND_TIMEOUT, socket.send(Message::Binary(frame))).await;
            if !matches!(sent, Ok(Ok(()))) {
                return;
            }
            // Look for a message without waiting for one, so that a busy stream does not deafen us.
            if let Ok(message) = timeout(Duration::ZERO, socket.recv()).await
                && !hear(message, &mut cursor)
            {
                return;
            }
            continue;
        }
        let goes_on = tokio::select! {
            message = socket.recv() => hear(message, &mut cursor),
            changed = changes.changed() => changed.is_ok(),
        };
        if !goes_on {
            return;
        }
    }
}

/// Takes a message in; false where the client is gone.
fn hear(message: Option<Result<Message, axum::Error>>, cursor: &mut Cursor) -> bool {
    match message {
        Some(Ok(Message::Text(text))) => {
            if let Ok(subscription) = serde_json::from_str::<Subscription>(&text) {
                cursor.subscribe(|layer| subscription.want.iter().any(|wanted| wanted == layer));
            }
            true
        }
        Some(Ok(Message::Close(_)) | Err(_)) | None => false,
        Some(Ok(_)) => true,
    }
}
