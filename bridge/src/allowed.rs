//! Which words may stand in lists of who may ask: hosts as a browser names them, and origins of pages.

/// The name of a host, without a port.
pub(crate) fn is_host(host: &str) -> bool {
    !host.is_empty() && !host.contains(['/', ':', ' '])
}

/// A scheme and an authority, no path: what a browser sends.
pub(crate) fn is_origin(origin: &str) -> bool {
    let authority = origin.strip_prefix("https://").or_else(|| origin.strip_prefix("http://"));
    authority.is_some_and(|a| !a.is_empty() && !a.contains(['/', ' ', '*']))
}
