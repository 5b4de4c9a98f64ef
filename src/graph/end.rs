//! Why a graph ends: somebody asked, or it could not go on; each with its exit code.

use tsense_ports::PortError;
use tsense_ports::signals::StopSignal;

/// Who asked the graph to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// SIGINT: Ctrl-C.
    Interrupt,
    /// SIGTERM: a service manager.
    Terminate,
    /// `tsense stop`.
    Stop,
}

impl From<StopSignal> for Asked {
    fn from(signal: StopSignal) -> Self {
        match signal {
            StopSignal::Interrupt => Self::Interrupt,
            StopSignal::Terminate => Self::Terminate,
        }
    }
}

impl Asked {
    /// The exit code of a graph ended this way.
    pub fn exit_code(self) -> u8 {
        match self {
            Self::Interrupt => 130,
            Self::Terminate | Self::Stop => 0,
        }
    }
}

/// Why a graph could not start or go on.
#[derive(Debug, thiserror::Error)]
pub enum GraphError {
    /// Shared memory, signals or the graph's files.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The configuration has faults.
    #[error("{0}")]
    Config(String),
    /// A child refused to work, and starting it again would not help.
    #[error("process `{process}` {words}; starting it again would not help, see its log above")]
    Refused {
        /// Its name.
        process: String,
        /// How it ended.
        words: String,
        /// Its exit code.
        code: u8,
    },
    /// The circuit breaker.
    #[error(
        "process `{process}` {words}; it was started again {restarts} times within {window_s} s already: giving up \
         ([graph] restarts_max, restart_window_s)"
    )]
    KeptDying {
        /// Its name.
        process: String,
        /// How it ended.
        words: String,
        /// Restarts within the window.
        restarts: usize,
        /// The window, seconds.
        window_s: f64,
    },
    /// The operating system refused something.
    #[error("{doing}: {source}")]
    System {
        /// What was being done.
        doing: String,
        /// Its answer.
        source: std::io::Error,
    },
}

impl GraphError {
    /// The exit code that says what kind of failure this is.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_) => 3,
            Self::Refused { code, .. } => *code,
            Self::KeptDying { .. } => 5,
            Self::Port(_) | Self::System { .. } => 1,
        }
    }

    pub(super) fn system(doing: impl Into<String>, source: impl Into<std::io::Error>) -> Self {
        Self::System { doing: doing.into(), source: source.into() }
    }
}
