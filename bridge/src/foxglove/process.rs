//! Shell: the process `foxglove`. It reads topics, and draws them for Foxglove and Lichtblick.
//!
//! In: the topics of a translator. Out: a WebSocket at the configured address. It writes no topic. An address that cannot be
//! had stops nothing else: the process says so in its state and tries again.

use super::config::Config;
use crate::ros2;
use crate::ros2::shell::{Inboxes, SharedTranslator};
use std::collections::BTreeMap;
use tsense_contract::ProcessState;
use tsense_geometry::Timestamp;
use tsense_ports::{PortError, Process, Wake};

#[cfg(feature = "foxglove")]
use super::server::Server;

/// Time between two looks at the server, graph seconds.
const TEND_PERIOD_S: f64 = 0.5;
/// Time between two attempts to listen, graph seconds.
const LISTEN_PERIOD_S: f64 = 5.0;

/// Runs until the process is asked to stop. Frames are those of `ros2`, so that both call a place the same.
pub fn run(mut process: Process, config: &Config, ros2: &ros2::Config, mounts: ros2::Mounts) -> Result<(), PortError> {
    let clock = process.clock();
    let wanted = config.translator(ros2);
    let mut inboxes = Inboxes::open(&mut process, &wanted, &mounts)?;
    let mut translator = SharedTranslator::new(&wanted, mounts);
    let mut stage = Stage { config: config.clone(), server: None, tried: None, told: BTreeMap::new() };
    let mut tended = clock.now();
    stage.tend(&mut process, &translator, tended);
    while process.wait(TEND_PERIOD_S) != Wake::Stop {
        let now = clock.now();
        translator.want(|topic| stage.server.as_ref().is_some_and(|server| server.wants(topic)));
        inboxes.take(&mut process, &mut translator, now)?;
        for (topic, message) in translator.take_messages() {
            if let Some(server) = &stage.server {
                server.send(topic, &message);
                process.health().sent(1);
            }
        }
        if now.seconds_since(tended) >= TEND_PERIOD_S {
            tended = now;
            stage.tend(&mut process, &translator, now);
        }
    }
    Ok(())
}

/// The server, or why there is none.
struct Stage {
    config: Config,
    server: Option<Server>,
    tried: Option<Timestamp>,
    told: BTreeMap<&'static str, u64>,
}

impl Stage {
    /// Starts the server where there is none, states how it is, and counts what the translator dropped.
    fn tend(&mut self, process: &mut Process, translator: &SharedTranslator, now: Timestamp) {
        for (cause, total) in translator.drops() {
            let told = self.told.insert(cause, *total).unwrap_or(0);
            process.health().dropped(cause, total - told);
        }
        if let Some(server) = &self.server {
            let clients = server.clients();
            let words = format!("{}, {clients} client{}", server.url(), if clients == 1 { "" } else { "s" });
            return process.health().set(ProcessState::Running, &words);
        }
        if self.tried.is_some_and(|tried| now.seconds_since(tried) < LISTEN_PERIOD_S) {
            return;
        }
        self.tried = Some(now);
        match Server::start(&self.config, translator.topics()) {
            Ok(server) => {
                tracing::info!(url = server.url(), "served for Foxglove");
                process.health().set(ProcessState::Running, &format!("{}, 0 clients", server.url()));
                self.server = Some(server);
            }
            Err(error) => {
                let words = format!("cannot listen on {}: {error}", self.config.listen);
                tracing::error!("{words}, trying again every {LISTEN_PERIOD_S} s");
                process.health().set(ProcessState::Degraded, &words);
            }
        }
    }
}

/// A binary without the crate: it says so in the process's state.
#[cfg(not(feature = "foxglove"))]
struct Server;

#[cfg(not(feature = "foxglove"))]
impl Server {
    fn start(_: &Config, _: &[ros2::sink::TopicSpec]) -> Result<Self, std::io::Error> {
        Err(std::io::Error::other("this tsense was built without the server; build with --features foxglove"))
    }

    fn url(&self) -> &'static str {
        ""
    }

    fn clients(&self) -> usize {
        0
    }

    fn wants(&self, _: usize) -> bool {
        false
    }

    fn send(&self, _: usize, _: &ros2::messages::AnyMessage) {}
}
