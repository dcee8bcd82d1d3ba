//! What ffmpeg says about the images of a camera.

/// A format of a camera's images.
#[derive(Debug, PartialEq)]
pub(crate) struct Formats {
    /// ffmpeg's name of the compression, or of the pixel format.
    pub(crate) name: String,
    pub(crate) is_compressed: bool,
    /// Widths and heights in pixels; empty for any.
    pub(crate) sizes_px: Vec<[usize; 2]>,
}

impl Formats {
    /// Returns the largest size with at most this number of pixels, or else the smallest.
    pub(crate) fn size_px(&self, most_px: usize) -> Option<[usize; 2]> {
        let area = |&[width, height]: &[usize; 2]| width.saturating_mul(height);
        let sizes = || self.sizes_px.iter().copied();
        let fitting = sizes().filter(|size| area(size) <= most_px);
        fitting
            .max_by_key(area)
            .or_else(|| sizes().min_by_key(area))
    }

    /// Returns the line of a scene that asks for it.
    pub(crate) fn line(&self) -> String {
        let key = if self.is_compressed {
            "codec"
        } else {
            "pixel_format"
        };
        format!("input.{key} = \"{}\"", self.name)
    }
}

/// Returns the format that a scene had best ask for: most cameras reach their full rate only with single compressed images.
pub(crate) fn best(formats: &[Formats]) -> Option<&Formats> {
    let rank = |format: &&Formats| match (&*format.name, format.is_compressed) {
        ("mjpeg", true) => 0,
        (_, false) => 1,
        _ => 2,
    };
    formats.iter().min_by_key(rank)
}

/// Parses ffmpeg's list of the formats of a camera, such as
///
/// ```text
/// [video4linux2,v4l2 @ 0x5581] Compressed:       mjpeg :          Motion-JPEG : 1280x720 640x480
/// [video4linux2,v4l2 @ 0x5581] Raw       :     yuyv422 :           YUYV 4:2:2 : 640x480 320x240
/// /dev/video0: Immediate exit requested
/// ```
///
/// Formats that ffmpeg does not support are left out. Nothing at all gives no formats. Fails with ffmpeg's reason if there is
/// another message instead.
pub(crate) fn formats_in(messages: &str) -> Result<Vec<Formats>, String> {
    let formats: Vec<_> = messages.lines().filter_map(format_in).collect();
    let last = messages.lines().rfind(|line| !line.trim().is_empty());
    match last {
        Some(last) if formats.is_empty() => {
            let message = last.rsplit_once("] ").map_or(last, |(_, message)| message);
            Err(format!(
                "it delivers no images that ffmpeg can read: {}",
                message.trim()
            ))
        }
        _ => Ok(formats),
    }
}

fn format_in(line: &str) -> Option<Formats> {
    let (_, entry) = line.split_once("] ")?;
    let (kind, entry) = entry.split_once(':')?;
    let is_compressed = match kind.trim() {
        "Compressed" => true,
        "Raw" => false,
        _ => return None,
    };
    let (name, entry) = entry.split_once(" :")?;
    let (_, sizes) = entry.rsplit_once(" :")?;
    let size = |text: &str| {
        let (width, height) = text.split_once('x')?;
        Some([width.parse().ok()?, height.parse().ok()?])
    };
    let name = name.trim();
    (name != "Unsupported").then(|| Formats {
        name: name.to_owned(),
        is_compressed,
        sizes_px: sizes.split_whitespace().filter_map(size).collect(),
    })
}
