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
    "/camera.js" "camera.js" "text/javascript; charset=utf-8",
    "/colours.js" "colours.js" "text/javascript; charset=utf-8",
    "/connection.js" "connection.js" "text/javascript; charset=utf-8",
    "/gestures.js" "gestures.js" "text/javascript; charset=utf-8",
    "/gl.js" "gl.js" "text/javascript; charset=utf-8",
    "/grid.js" "grid.js" "text/javascript; charset=utf-8",
    "/hook.js" "hook.js" "text/javascript; charset=utf-8",
    "/legend.js" "legend.js" "text/javascript; charset=utf-8",
    "/main.js" "main.js" "text/javascript; charset=utf-8",
    "/matrix.js" "matrix.js" "text/javascript; charset=utf-8",
    "/objects.js" "objects.js" "text/javascript; charset=utf-8",
    "/pace.js" "pace.js" "text/javascript; charset=utf-8",
    "/panel.js" "panel.js" "text/javascript; charset=utf-8",
    "/pick.js" "pick.js" "text/javascript; charset=utf-8",
    "/protocol.js" "protocol.js" "text/javascript; charset=utf-8",
    "/scan.js" "scan.js" "text/javascript; charset=utf-8",
    "/solids.js" "solids.js" "text/javascript; charset=utf-8",
    "/vehicle.js" "vehicle.js" "text/javascript; charset=utf-8",
    "/voxels.js" "voxels.js" "text/javascript; charset=utf-8",
    "/world.js" "world.js" "text/javascript; charset=utf-8",
}

/// The file at a path.
pub fn asset(path: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.path == path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_viewer_is_served_and_refers_to_nothing_outside() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/web/viewer");
        let files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().file_name()).collect();
        assert_eq!(files.len(), ASSETS.len(), "a file that is not embedded: {files:?}");
        for asset in ASSETS {
            let text = std::str::from_utf8(asset.bytes).unwrap();
            let foreign = text.lines().find(|line| {
                line.contains("://") && !line.contains("http://www.w3.org/2000/svg") && !line.contains("location.host")
            });
            assert_eq!(foreign, None, "{} reaches outside", asset.path);
        }
    }
}
