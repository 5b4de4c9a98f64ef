//! The viewer's static files, embedded in the binary: no build step, nothing to install, nothing from the network.

/// One file of the viewer.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// Path it is asked for by.
    pub path: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Content.
    pub bytes: &'static [u8],
}

macro_rules! assets {
    ($($path:literal $file:literal $media_type:literal,)+) => {
        /// All files; `/` is the page.
        pub const ASSETS: &[Asset] =
            &[$(Asset { path: $path, media_type: $media_type, bytes: include_bytes!(concat!("viewer/", $file)) },)+];
    };
}

assets! {
    "/" "index.html" "text/html; charset=utf-8",
    "/style.css" "style.css" "text/css; charset=utf-8",
    "/icon.svg" "icon.svg" "image/svg+xml",
    "/main.js" "main.js" "text/javascript; charset=utf-8",
}

/// The file at a path.
pub fn asset(path: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.path == path)
}
