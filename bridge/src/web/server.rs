//! Shell: the HTTP server on a thread of its own. Read-only; it serves the page, its stream and the bridge's health.
//!
//! In: a configuration and the hub. Out: an address that answers. It binds before it returns, so that an address in
//! use is an error of the caller, in words. Every answer carries headers that allow the page itself and nothing
//! else; every request passes the guard.

#![allow(clippy::disallowed_methods, reason = "shell: the one place of the bridge that listens on a socket")]

use super::assets::asset;
use super::client;
use super::guard::Guard;
use super::hub::Hub;
use crate::config::Config;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Router, body::Body};
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::oneshot;

/// Connections the kernel keeps waiting.
const BACKLOG: u32 = 64;

/// The page may load from and talk to this server alone.
const CONTENT_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; \
     connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const SECURITY_HEADERS: [(&str, &str); 6] = [
    ("content-security-policy", CONTENT_POLICY),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-resource-policy", "same-origin"),
    ("cross-origin-opener-policy", "same-origin"),
];

/// Why the page is not served.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address is not one.
    #[error("[bridge] listen = {0:?} is not an address and a port, like 127.0.0.1:8151")]
    Address(String),
    /// The address is taken or not ours.
    #[error("cannot listen on {address}: {source}; end what uses it, or set [bridge] listen (port 0 takes any)")]
    Bind {
        /// The configured address.
        address: SocketAddr,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// No thread or no reactor.
    #[error("cannot start the web server: {0}")]
    Start(std::io::Error),
}

/// A running server; it ends when this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Server {
    /// Binds and serves.
    pub fn start(config: &Config, hub: Arc<Hub>) -> Result<Self, ServerError> {
        let wanted: SocketAddr = config.listen.parse().map_err(|_| ServerError::Address(config.listen.clone()))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(ServerError::Start)?;
        let listener = {
            let _inside = runtime.enter();
            bind(wanted).map_err(|source| ServerError::Bind { address: wanted, source })?
        };
        let address = listener.local_addr().map_err(ServerError::Start)?;
        let site = Arc::new(Site { guard: Guard::new(config, address), hub, clients_max: config.max_clients });
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name("bridge-web".into())
            .spawn(move || runtime.block_on(serve(listener, site, stopped)))
            .map_err(ServerError::Start)?;
        Ok(Self { address, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it listens: the port that was taken, where 0 was configured.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The page's address, for people.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic of the server was already printed; there is nobody to pass it to.
            let _ = thread.join();
        }
    }
}

/// Listens with bounded kernel buffers for each connection; call it within a runtime.
pub(crate) fn bind(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    // Accepted connections inherit it.
    socket.set_send_buffer_size(client::SEND_BUFFER_BYTES)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// What every request sees.
struct Site {
    guard: Guard,
    hub: Arc<Hub>,
    clients_max: usize,
}

async fn serve(listener: TcpListener, site: Arc<Site>, stopped: oneshot::Receiver<()>) {
    let router = Router::new()
        .route("/ws", get(stream))
        .route("/health", get(health))
        .route("/metrics", get(metrics))
        .fallback(get(file))
        .layer(middleware::from_fn_with_state(Arc::clone(&site), guarded))
        .with_state(site);
    // Dropping the server's future on stop closes every connection at once; viewers reconnect by themselves.
    tokio::select! {
        ended = axum::serve(listener, router).into_future() => {
            if let Err(error) = ended {
                tracing::error!(%error, "the web server ended");
            }
        }
        _ = stopped => {}
    }
}

/// Refuses foreign requests, and adds the security headers to every answer.
async fn guarded(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    let mut response = match refusal(&site.guard, request.headers()) {
        Some(reason) => {
            tracing::warn!(%reason, "request refused");
            (StatusCode::FORBIDDEN, reason + "\n").into_response()
        }
        None => next.run(request).await,
    };
    for (name, value) in SECURITY_HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// A header that is no text is no name anyone allowed.
fn refusal(guard: &Guard, headers: &HeaderMap) -> Option<String> {
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("\u{fffd}"));
    guard.refusal(text(header::HOST), text(header::ORIGIN))
}

async fn file(uri: Uri) -> Response {
    match asset(uri.path()) {
        Some(asset) => {
            let headers = [(header::CONTENT_TYPE, asset.media_type), (header::CACHE_CONTROL, "no-cache")];
            (headers, Body::from(asset.bytes)).into_response()
        }
        None => (StatusCode::NOT_FOUND, "no such file: the page is at /\n").into_response(),
    }
}

async fn stream(State(site): State<Arc<Site>>, upgrade: WebSocketUpgrade) -> Response {
    let Some(admission) = site.hub.admit(site.clients_max) else {
        let reason = format!("{} viewers are connected, [bridge] max_clients allows no more\n", site.clients_max);
        return (StatusCode::SERVICE_UNAVAILABLE, reason).into_response();
    };
    client::bounded(upgrade).on_upgrade(move |socket| async move {
        client::serve(socket, &site.hub).await;
        drop(admission);
    })
}

async fn health(State(site): State<Arc<Site>>) -> Response {
    let mut report = site.hub.report();
    report["clients"] = site.hub.clients().into();
    report["held_bytes"] = site.hub.bytes().into();
    ([(header::CONTENT_TYPE, "application/json")], format!("{report}\n")).into_response()
}

async fn metrics(State(site): State<Arc<Site>>) -> (HeaderMap, String) {
    let media_type = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
    let headers = HeaderMap::from_iter([(header::CONTENT_TYPE, media_type)]);
    (headers, super::metrics::metrics_text(&site.hub.report(), site.hub.clients()))
}
