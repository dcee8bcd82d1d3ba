//! The files of the page, which are part of the program.

/// A file that is served.
#[derive(Debug, Clone, Copy)]
pub struct Asset {
    /// Its path, from the root and without it: `app.js`, `steps/track.js`.
    pub path: &'static str,
    /// Its media type, as in HTTP.
    pub content_type: &'static str,
    /// Its contents.
    pub bytes: &'static [u8],
}

/// Lists files of `web/` with their media types.
macro_rules! web {
    ($($content_type:literal: $($path:literal)*;)*) => {
        &[$($(Asset {
            path: $path,
            content_type: $content_type,
            bytes: include_bytes!(concat!("../web/", $path)),
        },)*)*]
    };
}

/// The files of the page; the first is the page.
pub(crate) const PAGE: &[Asset] = web! {
    "text/html; charset=utf-8": "index.html";
    "text/css; charset=utf-8": "studio.css";
    "text/javascript; charset=utf-8":
        "app.js" "connection.js" "elements.js" "picture.js"
        "steps/camera.js" "steps/colors.js" "steps/pose.js" "steps/sources.js" "steps/targets.js" "steps/track.js";
    "image/svg+xml": "icon.svg";
};
