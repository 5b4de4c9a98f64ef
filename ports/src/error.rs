//! What can go wrong between a process and its graph; each error says what was seen and what to do.

/// An error of a port, a process or a graph's domain.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The graph offers this topic with other types.
    #[error(
        "{topic}: this program speaks {ours}, but the running graph offers another version or type; \
         stop the graph and start it again with one version of tsense"
    )]
    OtherVersion {
        /// The topic.
        topic: String,
        /// Our type names.
        ours: String,
    },
    /// The service could not be opened or created.
    #[error("{topic}: {seen} (tried for {tried_s:.1} s); {advice}")]
    Service {
        /// The topic.
        topic: String,
        /// What the middleware answered.
        seen: String,
        /// How long it was tried, seconds.
        tried_s: f64,
        /// What to do.
        advice: &'static str,
    },
    /// All places of a kind are taken.
    #[error("{topic}: {seen}; every place is taken by a living process: a topic has one writer, and few readers")]
    Full {
        /// The topic.
        topic: String,
        /// What the middleware answered.
        seen: String,
    },
    /// A sample with more items than the topic carries.
    #[error("{topic}: {len} items, but a sample carries at most {max}")]
    TooManyItems {
        /// The topic.
        topic: String,
        /// Items asked for.
        len: usize,
        /// Items possible.
        max: usize,
    },
    /// A sample could not be sent.
    #[error("{topic}: sending failed: {seen}")]
    Send {
        /// The topic.
        topic: String,
        /// What the middleware answered.
        seen: String,
    },
    /// A sample could not be received.
    #[error("{topic}: receiving failed: {seen}; a reader holds at most {borrow} samples at once")]
    Receive {
        /// The topic.
        topic: String,
        /// What the middleware answered.
        seen: String,
        /// Samples a reader may hold.
        borrow: usize,
    },
    /// Nobody answered a request in time.
    #[error(
        "{service}: no answer within {timeout_s:.1} s; the process that serves it is down or busy, see `tsense status`"
    )]
    NoAnswer {
        /// The service.
        service: String,
        /// Seconds waited.
        timeout_s: f64,
    },
    /// The graph is not there.
    #[error("no graph named `{name}` is running ({seen}); start one with `tsense run CONFIG`")]
    NoGraph {
        /// Its name.
        name: String,
        /// What was seen.
        seen: String,
    },
    /// A child that was not started by its graph.
    #[error(
        "process `{process}` belongs to graph `{name}` of launcher {launcher}, but its parent is {parent}; \
         processes are started by `tsense run CONFIG`, not by hand"
    )]
    NotOurParent {
        /// The process.
        process: String,
        /// Its graph.
        name: String,
        /// The launcher's process id.
        launcher: u32,
        /// The actual parent.
        parent: u32,
    },
    /// Another launcher holds this graph.
    #[error(
        "graph `{name}` is already running (process {pid}); stop it with Ctrl-C there, or give this one another name"
    )]
    AlreadyRunning {
        /// Its name.
        name: String,
        /// Process id of its launcher, 0 where it could not be read.
        pid: u32,
    },
    /// A name that cannot be a graph's.
    #[error("graph name `{name}`: {problem}")]
    BadName {
        /// The name as given.
        name: String,
        /// What is wrong, and what is allowed.
        problem: String,
    },
    /// Too little shared memory.
    #[error(
        "{path} has {free_mb} MB free, but this graph can need {needed_mb} MB; free some, or enlarge it \
         (`mount -o remount,size=2G {path}`, or `--shm-size=2g` for a container)"
    )]
    NoMemory {
        /// Where.
        path: String,
        /// Megabytes free.
        free_mb: u64,
        /// Megabytes that can be needed.
        needed_mb: u64,
    },
    /// The operating system refused something.
    #[error("{doing}: {source}")]
    System {
        /// What was being done.
        doing: String,
        /// Its answer.
        source: std::io::Error,
    },
    /// The middleware refused something outside any topic.
    #[error("{doing}: {seen}")]
    Middleware {
        /// What was being done.
        doing: &'static str,
        /// Its answer.
        seen: String,
    },
}

impl PortError {
    /// An operating system error with what was being done.
    pub fn system(doing: impl Into<String>, source: impl Into<std::io::Error>) -> Self {
        Self::System { doing: doing.into(), source: source.into() }
    }
}
