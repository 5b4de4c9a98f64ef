//! Who may ask: the Host and Origin of a request against what is allowed. A pure decision.
//!
//! A page of another site in the operator's browser can reach 127.0.0.1: without the Origin check it could read the
//! map, and without the Host check it could do so under its own name (DNS rebinding). So the Host must be a loopback
//! name, the address that is listened on, or a configured one; and an Origin, which browsers always send with a
//! WebSocket, must be this server itself or a configured one. Programs without a browser send no Origin.

use crate::config::Config;
use std::net::{IpAddr, SocketAddr};

/// What is allowed beyond this machine.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    hosts: Vec<String>,
    origins: Vec<String>,
}

impl Guard {
    /// From the configuration and the address that is listened on.
    pub fn new(config: &Config, address: SocketAddr) -> Self {
        Self::of(&config.allowed_hosts, &config.allowed_origins, address)
    }

    /// From hosts and origins, and the address that is listened on.
    pub fn of(allowed_hosts: &[String], allowed_origins: &[String], address: SocketAddr) -> Self {
        let mut hosts: Vec<String> = allowed_hosts.iter().map(|h| h.to_ascii_lowercase()).collect();
        if !address.ip().is_unspecified() {
            hosts.push(address.ip().to_string());
        }
        let origins = allowed_origins.iter().map(|o| o.to_ascii_lowercase()).collect();
        Self { hosts, origins }
    }

    /// Nothing where the request may be answered, else why not.
    pub fn refusal(&self, host: Option<&str>, origin: Option<&str>) -> Option<String> {
        let Some(host) = host else {
            return Some("the request names no Host".into());
        };
        let host = host.to_ascii_lowercase();
        if !self.host_allowed(&host) {
            return Some(format!("Host {host:?} is neither this machine nor in allowed_hosts"));
        }
        let origin = origin?.to_ascii_lowercase();
        let own = origin == format!("http://{host}") || origin == format!("https://{host}");
        if own || self.origins.contains(&origin) {
            return None;
        }
        Some(format!("Origin {origin:?} is neither this page nor in allowed_origins"))
    }

    fn host_allowed(&self, host: &str) -> bool {
        let Some(name) = host_name(host) else {
            return false;
        };
        let loopback = name == "localhost" || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
        loopback || self.hosts.iter().any(|allowed| allowed == name)
    }
}

/// The name of `name`, `name:port`, `[v6]` or `[v6]:port`.
fn host_name(host: &str) -> Option<&str> {
    let (name, rest) = match host.strip_prefix('[') {
        Some(v6) => v6.split_once(']')?,
        None => host.find(':').map_or((host, ""), |colon| host.split_at(colon)),
    };
    let port_fits = rest.is_empty() || rest.strip_prefix(':').is_some_and(|port| port.parse::<u16>().is_ok());
    port_fits.then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard() -> Guard {
        let config = Config {
            allowed_hosts: vec!["Tractor.local".into()],
            allowed_origins: vec!["https://fleet.example".into()],
            ..Config::default()
        };
        Guard::new(&config, "127.0.0.1:8151".parse().unwrap())
    }

    fn refused(host: &str, origin: Option<&str>) -> bool {
        guard().refusal(Some(host), origin).is_some()
    }

    #[test]
    fn this_machine_under_its_loopback_names_is_answered() {
        for host in ["localhost", "localhost:8151", "127.0.0.1:8151", "127.1.2.3", "[::1]:9000", "LOCALHOST:1"] {
            assert!(!refused(host, None), "{host}");
            assert!(!refused(host, Some(&format!("http://{host}"))), "{host}");
        }
    }

    #[test]
    fn foreign_hosts_are_refused_whatever_they_resemble() {
        for host in [
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1.evil.example:8151",
            "128.0.0.1",
            "",
            "localhost:port",
            "[::1",
            "[::1]x",
            "localhost:8151@evil.example",
        ] {
            assert!(refused(host, None), "{host}");
        }
        assert!(guard().refusal(None, None).unwrap().contains("no Host"));
    }

    #[test]
    fn foreign_origins_are_refused_even_from_another_port_of_this_machine() {
        for origin in ["http://evil.example", "null", "http://localhost:3000", "http://127.0.0.1", "file://"] {
            assert!(refused("127.0.0.1:8151", Some(origin)), "{origin}");
        }
        let reason = guard().refusal(Some("127.0.0.1:8151"), Some("http://evil.example")).unwrap();
        assert!(reason.contains("evil.example") && reason.contains("allowed_origins"), "{reason}");
    }

    #[test]
    fn configured_hosts_and_origins_are_answered() {
        assert!(!refused("tractor.LOCAL:8151", Some("http://tractor.local:8151")));
        assert!(!refused("localhost:8151", Some("https://Fleet.example")));
    }
}
