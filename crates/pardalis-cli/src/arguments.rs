//! Parsers of command-line values that several commands share.

/// Parses `WIDTHxHEIGHT` in pixels.
pub(crate) fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides = text
        .split_once('x')
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let allowed = 1..=pardalis_core::error::MAX_IMAGE_SIDE_PX;
    sides
        .filter(|(width, height)| allowed.contains(width) && allowed.contains(height))
        .ok_or_else(|| {
            format!(
                "allowed: width and height in pixels up to {}, such as 640x480",
                allowed.end()
            )
        })
}
