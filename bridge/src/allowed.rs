//! Which words may stand in lists of who may ask: hosts as a browser names them, and origins of pages.

use tsense_contract::Checks;

/// Checks the lists `allowed_hosts` and `allowed_origins` of a section; `example` is how an origin is written.
pub(crate) fn check(check: &mut Checks, hosts: &[String], origins: &[String], example: &str) {
    for host in hosts {
        check.require(is_host(host), "allowed_hosts", host, "a host name without port: tractor.local");
    }
    for origin in origins {
        check.require(is_origin(origin), "allowed_origins", origin, &format!("scheme, host, port: {example}"));
    }
}

/// The name of a host, without a port.
fn is_host(host: &str) -> bool {
    !host.is_empty() && !host.contains(['/', ':', ' '])
}

/// A scheme and an authority, no path: what a browser sends.
fn is_origin(origin: &str) -> bool {
    let authority = origin.strip_prefix("https://").or_else(|| origin.strip_prefix("http://"));
    authority.is_some_and(|a| !a.is_empty() && !a.contains(['/', ' ', '*']))
}
