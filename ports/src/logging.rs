//! Log lines on standard error: for people, or JSON on request, each with the name of its process.
//!
//! `TSENSE_LOG` overrides the configured filter, in the notation of tracing-subscriber: `debug`, or
//! `info,tsense_mapper=debug`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::fmt::Write as _;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::prelude::*;
use tracing_subscriber::registry::LookupSpan;

/// How log lines look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogFormat {
    /// One line of text.
    #[default]
    Human,
    /// One JSON object a line.
    Json,
}

/// Starts logging for this process; a second call does nothing. `filter` is a level or a list of `target=level`.
pub fn start(process: &str, filter: &str, format: LogFormat) {
    let wanted = std::env::var("TSENSE_LOG").unwrap_or_else(|_| filter.to_owned());
    let filter = filter_of(&wanted);
    // The middleware reports what it recovers from as if it were trouble: only its errors, unless one debugs.
    let middleware =
        if wanted.contains("trace") { iceoryx2::prelude::LogLevel::Debug } else { iceoryx2::prelude::LogLevel::Fatal };
    iceoryx2::prelude::set_log_level(middleware);
    let lines = Lines { process: process.into(), format };
    let to_stderr = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).event_format(lines);
    let _ = tracing_subscriber::registry().with(to_stderr).with(filter).try_init();
}

/// What is wanted, or `info` where that cannot be read. The DDS library warns twenty times a second of what is none of ours,
/// Zenoh every other second while a station is away, which the process says in its state: of them only errors, unless named.
/// At each end the DDS library leaves a multicast group on a device that it did not join it on, and calls that an error.
fn filter_of(wanted: &str) -> Targets {
    let others = "rustdds=error,rustdds::network::udp_listener=off,zenoh=error";
    let quiet = |wanted: &str| format!("{others},{wanted}").parse::<Targets>();
    quiet(wanted).or_else(|_| quiet("info")).unwrap_or_default()
}

struct Lines {
    process: String,
    format: LogFormat,
}

impl<S, N> FormatEvent<S, N> for Lines
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, _: &FmtContext<'_, S, N>, mut out: Writer<'_>, event: &Event<'_>) -> std::fmt::Result {
        let mut fields = Fields::default();
        event.record(&mut fields);
        let line = match self.format {
            LogFormat::Human => self.human(event, &fields),
            LogFormat::Json => self.json(event, fields).to_string(),
        };
        writeln!(out, "{line}")
    }
}

impl Lines {
    fn human(&self, event: &Event<'_>, fields: &Fields) -> String {
        let mut line = format!("{} {:5} {}: {}", utc(), event.metadata().level(), self.process, fields.message);
        for (name, value) in &fields.others {
            let _ = match value {
                Value::String(text) => write!(line, " {name}={text:?}"),
                value => write!(line, " {name}={value}"),
            };
        }
        line
    }

    fn json(&self, event: &Event<'_>, fields: Fields) -> Value {
        let mut line = Map::new();
        line.insert("time".into(), utc().into());
        line.insert("level".into(), event.metadata().level().as_str().to_lowercase().into());
        line.insert("process".into(), self.process.clone().into());
        line.insert("target".into(), event.metadata().target().into());
        line.insert("message".into(), fields.message.into());
        for (name, value) in fields.others {
            line.entry(name).or_insert(value);
        }
        line.into()
    }
}

#[derive(Default)]
struct Fields {
    message: String,
    others: Map<String, Value>,
}

impl Fields {
    fn put(&mut self, field: &Field, value: Value) {
        self.others.insert(field.name().into(), value);
    }
}

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "message" {
            self.message = format!("{value:?}");
        } else {
            self.put(field, format!("{value:?}").into());
        }
    }
    fn record_str(&mut self, field: &Field, value: &str) {
        self.put(field, value.into());
    }
    fn record_i64(&mut self, field: &Field, value: i64) {
        self.put(field, value.into());
    }
    fn record_u64(&mut self, field: &Field, value: u64) {
        self.put(field, value.into());
    }
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.put(field, value.into());
    }
    fn record_bool(&mut self, field: &Field, value: bool) {
        self.put(field, value.into());
    }
}

/// The time of day, UTC, to the millisecond.
fn utc() -> String {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
    let seconds = now.tv_sec.rem_euclid(86_400);
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    format!("{hours:02}:{minutes:02}:{seconds:02}.{:03}", now.tv_nsec / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libraries_of_others_say_errors_only_unless_they_are_named() {
        let directives = |wanted: &str| {
            let mut list: Vec<_> = filter_of(wanted).to_string().split(',').map(str::to_owned).collect();
            list.sort();
            list
        };
        let leaving = "rustdds::network::udp_listener=off";
        assert_eq!(directives("debug"), ["debug", leaving, "rustdds=error", "zenoh=error"]);
        assert_eq!(directives("info,rustdds=debug"), ["info", leaving, "rustdds=debug", "zenoh=error"]);
        assert_eq!(directives("a=b=c"), ["info", leaving, "rustdds=error", "zenoh=error"]);
    }
}
