//! Shell: the channels and the `foxglove` crate's server behind the door, on a thread of their own.
//!
//! In: messages of the translator. Out: a WebSocket at the configured address. Logging a message never waits: the crate
//! keeps a bounded number for each client and drops the oldest.

#![allow(clippy::disallowed_methods, reason = "shell: it listens on a socket and draws random numbers")]

use super::config::Config;
use super::convert;
use super::front::{Door, hidden_address, serve};
use crate::ros2::messages::AnyMessage;
use crate::ros2::sink::TopicSpec;
use crate::web::guard::Guard;
use crate::web::server::bind;
use foxglove::messages::{FrameTransforms, Grid, LaserScan, PointCloud, SceneUpdate};
use foxglove::{Channel, ChannelBuilder, Context, WebSocketServer};
use std::io::{Error, Read};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use tokio::runtime::{Builder, Runtime};

/// Messages waiting for a client: the crate counts messages, not bytes, and control messages need some room.
const BACKLOG_MESSAGES: usize = 32;

/// One channel.
enum Lane {
    Transforms(Channel<FrameTransforms>),
    Cloud(Channel<PointCloud>),
    Grid(Channel<Grid>),
    Scene(Channel<SceneUpdate>),
    Scan(Channel<LaserScan>),
    /// Not drawn.
    None,
}

/// A running server; it ends when this is dropped.
pub struct Server {
    address: SocketAddr,
    door: Arc<Door>,
    lanes: Vec<Lane>,
    // Channels and server know it weakly: without this nothing is ever offered to a client.
    _context: Arc<Context>,
    // Dropped last: its threads serve the rest.
    _runtime: Runtime,
}

impl Server {
    /// Binds, offers a channel a topic, and serves.
    pub fn start(config: &Config, topics: &[TopicSpec]) -> Result<Self, Error> {
        let wanted: SocketAddr = config.listen.parse().map_err(Error::other)?;
        let runtime = Builder::new_multi_thread().worker_threads(1).thread_name("foxglove").enable_all().build()?;
        let context = Context::new();
        let behind = runtime.block_on(start_behind(&context, &runtime))?;
        let listener = runtime.block_on(async { bind(wanted) })?;
        let address = listener.local_addr()?;
        let guard = Guard::of(&config.allowed_hosts, &config.allowed_origins, address);
        let door = Door { guard, behind, clients_max: config.max_clients, clients: AtomicUsize::new(0) };
        let door = Arc::new(door);
        runtime.spawn(serve(listener, Arc::clone(&door)));
        let lanes = topics.iter().map(|topic| lane(topic, &context)).collect();
        Ok(Self { address, door, lanes, _context: context, _runtime: runtime })
    }

    /// Where it listens, for people.
    pub fn url(&self) -> String {
        format!("ws://{}", self.address)
    }

    /// Clients now.
    pub fn clients(&self) -> usize {
        self.door.clients.load(Ordering::Relaxed)
    }

    /// Whether a client subscribes to the channel of a topic.
    pub fn wants(&self, topic: usize) -> bool {
        match self.lanes.get(topic) {
            Some(Lane::Transforms(channel)) => channel.has_sinks(),
            Some(Lane::Cloud(channel)) => channel.has_sinks(),
            Some(Lane::Grid(channel)) => channel.has_sinks(),
            Some(Lane::Scene(channel)) => channel.has_sinks(),
            Some(Lane::Scan(channel)) => channel.has_sinks(),
            Some(Lane::None) | None => false,
        }
    }

    /// Sends a message to whoever wants its channel.
    pub fn send(&self, topic: usize, message: &AnyMessage) {
        match (self.lanes.get(topic), message) {
            (Some(Lane::Transforms(channel)), AnyMessage::TfMessage(m)) => channel.log(&convert::transforms(m)),
            (Some(Lane::Cloud(channel)), AnyMessage::PointCloud2(m)) => channel.log(&convert::point_cloud(m)),
            (Some(Lane::Grid(channel)), AnyMessage::OccupancyGrid(m)) => channel.log(&convert::grid(m)),
            (Some(Lane::Grid(channel)), AnyMessage::GridMap(m)) => channel.log(&convert::brush(m)),
            (Some(Lane::Scene(channel)), AnyMessage::Detection3DArray(m)) => channel.log(&convert::scene(m)),
            (Some(Lane::Scan(channel)), AnyMessage::LaserScan(m)) => channel.log(&convert::scan(m)),
            _ => {}
        }
    }
}

/// Starts the crate's server where nobody looks for it.
async fn start_behind(context: &Arc<Context>, runtime: &Runtime) -> Result<SocketAddr, Error> {
    let mut random = [0; 3];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut random)?;
    let hidden = hidden_address(random);
    let handle = WebSocketServer::new()
        .name(concat!("tsense ", env!("CARGO_PKG_VERSION")))
        .bind(hidden.to_string(), 0)
        .capabilities([])
        .message_backlog_size(BACKLOG_MESSAGES)
        .tokio_runtime(runtime.handle())
        .context(context)
        .start()
        .await
        .map_err(Error::other)?;
    Ok(SocketAddr::from((hidden, handle.port())))
}

fn lane(topic: &TopicSpec, context: &Arc<Context>) -> Lane {
    let builder = ChannelBuilder::new(topic.name.as_str()).context(context);
    match topic.type_name {
        "tf2_msgs/msg/TFMessage" => Lane::Transforms(builder.build()),
        "sensor_msgs/msg/PointCloud2" => Lane::Cloud(builder.build()),
        "nav_msgs/msg/OccupancyGrid" | "grid_map_msgs/msg/GridMap" => Lane::Grid(builder.build()),
        "vision_msgs/msg/Detection3DArray" => Lane::Scene(builder.build()),
        "sensor_msgs/msg/LaserScan" => Lane::Scan(builder.build()),
        _ => Lane::None,
    }
}
