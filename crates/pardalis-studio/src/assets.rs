//! The files of the page, which are part of the program.

use std::borrow::Cow;

/// A file that is served.
#[derive(Debug, Clone)]
pub struct Asset {
    /// Its path, from the root and without it: `app.js`, `steps/track.js`.
    pub path: Cow<'static, str>,
    /// Its media type, as in HTTP.
    pub content_type: &'static str,
    /// Its contents.
    pub bytes: &'static [u8],
}

/// Lists files of `web/` with their media types.
macro_rules! web {
    ($($content_type:literal: $($path:literal)*;)*) => {
        &[$($(Asset {
            path: Cow::Borrowed($path),
            content_type: $content_type,
            bytes: include_bytes!(concat!("../web/", $path)),
        },)*)*]
    };
}

/// The page, in which `{{nonce}}` and `{{imports}}` are to be replaced.
pub(crate) const PAGE: &str = include_str!("../web/index.html");

/// The other files of the page.
pub(crate) const FILES: &[Asset] = web! {
    "text/css; charset=utf-8": "studio.css";
    "text/javascript; charset=utf-8":
        "app.js" "connection.js" "elements.js" "picture.js"
        "steps/board.js" "steps/camera.js" "steps/colors.js" "steps/compare.js" "steps/pose.js" "steps/record.js" "steps/replay.js" "steps/sources.js" "steps/targets.js" "steps/track.js" "steps/wave.js";
    "image/svg+xml": "icon.svg";
};
