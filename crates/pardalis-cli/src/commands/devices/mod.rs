//! `pardalis devices`: lists the cameras of this computer, and how a scene names them.

pub(crate) mod formats;
mod nodes;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow};
use pardalis_scene::is_name;

use crate::output::{Shown, print, warn};
use crate::source::CameraFormats;
#[cfg(feature = "studio")]
use crate::user_error::user_error;
use formats::{Formats, formats_in};
use nodes::{Node, nodes};

/// Images of a camera are not larger than this in the lines that are suggested, in pixels.
const SUGGESTED_PX: usize = 1280 * 720;

/// The line that asks a camera for its rate.
const FPS_LINE: &str = "fps = 30  # asked for; the camera may have another";

/// Names of cameras that are suggested are not longer than this, so that a number can follow.
const LONGEST_NAME: usize = 40;

/// Lists the cameras of this computer, with the lines of a scene for each
///
/// For each camera of Linux (/dev/video...) it prints the name, the formats and sizes of its images, and a table to put into a
/// scene. Formats and sizes come from ffmpeg, which must be installed. It says why a camera cannot be opened.
/// Network cameras are not found: their addresses are in their settings or manuals.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis devices                      the cameras, and lines for a scene
  pardalis devices >> scene.toml        adds them to a scene, which also needs their calibrations

Exit codes: 0 if there is a camera, even one that cannot be opened; 1 if there is none.")]
pub(crate) struct Arguments {}

/// Runs the command.
pub(crate) fn run(_: &Arguments) -> Result<()> {
    if !cfg!(target_os = "linux") {
        return Err(anyhow!(
            "cameras are listed on Linux only; on macOS, `ffmpeg -f avfoundation -list_devices true -i \"\"` lists them, on Windows \
             `ffmpeg -f dshow -list_devices true -i dummy` (docs/cameras-live.md says how scenes name them)"
        ));
    }
    let ffmpeg = CameraFormats::find();
    let messages_about = |device: &Path| match &ffmpeg {
        Ok(ffmpeg) => ffmpeg.messages_about(device),
        Err(_) => Ok(String::new()),
    };
    let cameras = cameras(Path::new("/dev"), Path::new("/sys"), &messages_about)?;
    if let Err(error) = &ffmpeg {
        warn(format!("{error:#}; formats and sizes are not known"));
    }
    for text in cameras {
        print(text);
    }
    Ok(())
}

/// Returns the place and the name of each camera of this computer that can be opened; none on other systems than Linux.
#[cfg(feature = "studio")]
pub(crate) fn listed() -> Vec<(String, String)> {
    let nodes = nodes(Path::new("/dev"), Path::new("/sys")).into_iter();
    let usable = nodes.filter(|node| node.trouble.is_none());
    usable
        .map(|node| (node.path.to_string_lossy().into_owned(), node.name))
        .collect()
}

/// What a scene had best ask a camera of this computer for.
#[cfg(feature = "studio")]
#[derive(Debug, Default)]
pub(crate) struct Asked {
    /// Lines of the camera's table.
    pub(crate) lines: String,
    /// Width and height of its images, in pixels.
    pub(crate) size_px: Option<[usize; 2]>,
}

#[cfg(feature = "studio")]
impl Asked {
    /// Asks ffmpeg what a camera delivers.
    ///
    /// Errors: it delivers no images; ffmpeg is not installed.
    pub(crate) fn of(device: &Path) -> Result<Self> {
        let messages = CameraFormats::find()?.messages_about(device)?;
        let formats =
            formats_in(&messages).map_err(|why| user_error!("{}: {why}", device.shown()))?;
        let best = formats::best(&formats);
        let format = best.map_or(String::new(), |best| format!("{}\n", best.line()));
        Ok(Self {
            lines: format!("{FPS_LINE}\n{format}"),
            size_px: best.and_then(|best| best.size_px(SUGGESTED_PX)),
        })
    }
}

/// Describes the cameras below these roots of `/dev` and `/sys`, each as comments and a table of a scene. `messages_about`
/// returns what ffmpeg says about a device; empty without ffmpeg.
///
/// Errors: there is no camera.
fn cameras(
    dev: &Path,
    sys: &Path,
    messages_about: &dyn Fn(&Path) -> Result<String>,
) -> Result<Vec<String>> {
    let nodes = nodes(dev, sys);
    let mut names = Vec::new();
    let mut texts = Vec::new();
    let mut count = 0;
    for node in &nodes {
        let found = match &node.trouble {
            Some(trouble) => Err(trouble.clone()),
            None => formats_in(&messages_about(&node.path)?),
        };
        let mut text = format!("# {}: {}", node.path.shown(), node.name);
        match found {
            Ok(formats) => {
                count += 1;
                text += &table(node, &formats, &mut names);
            }
            Err(why) => {
                count += usize::from(node.trouble.is_some());
                // Writing to a String cannot fail.
                let _ = write!(text, "\n#   {why}");
            }
        }
        texts.push(text);
    }
    if count > 0 {
        return Ok(texts);
    }
    let others = match nodes.len() {
        0 => format!("there is no {}/video...", dev.shown()),
        1 => format!("{} delivers no images", nodes[0].path.shown()),
        many => format!(
            "none of the {many} devices {}/video... delivers images",
            dev.shown()
        ),
    };
    Err(anyhow!(
        "no camera was found: {others}; plug one in, or pass it on to a container or virtual machine \
         (docker run --device /dev/video0); the cameras of a Raspberry Pi come through a pipe, and network cameras have \
         addresses (docs/cameras-live.md)"
    ))
}

/// Returns the formats of a camera as comments, and its table. `names` are the names of the cameras before it.
fn table(node: &Node, formats: &[Formats], names: &mut Vec<String>) -> String {
    let mut text = String::new();
    for format in formats {
        let sizes: Vec<_> = format
            .sizes_px
            .iter()
            .map(|[w, h]| format!("{w}x{h}"))
            .collect();
        let sizes = if sizes.is_empty() {
            "any size".to_owned()
        } else {
            sizes.join(" ")
        };
        let _ = write!(text, "\n#   {}: {sizes}", format.name);
    }
    let name = unused_name(&node.name, names);
    let device = toml::Value::from(node.path.to_string_lossy().into_owned());
    let _ = write!(text, "\n[cameras.{name}]\nvideo = {device}\n{FPS_LINE}");
    if let Some(best) = formats::best(formats) {
        if let Some([width, height]) = best.size_px(SUGGESTED_PX) {
            let _ = write!(
                text,
                "\nsize_px = [{width}, {height}]  # that of the calibration"
            );
        }
        let _ = write!(text, "\n{}", best.line());
    }
    text += "\n# calibration = \"camera.toml\"";
    if let Some(link) = &node.stable_link {
        let link = toml::Value::from(link.to_string_lossy().into_owned());
        let _ = write!(
            text,
            "\n# The same camera after a restart or at another place among several, instead of video above:\n# video = {link}"
        );
    }
    names.push(name);
    text + "\n"
}

/// Returns a name for a scene from that of a camera, such as `hd-pro-webcam-c920`.
fn unused_name(of: &str, names: &[String]) -> String {
    // Many drivers give the name twice, with a colon between.
    let of = of.split(':').next().unwrap_or_default();
    let words = of.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<_> = words.filter(|word| !word.is_empty()).collect();
    let mut name = words.join("-").to_ascii_lowercase();
    name.truncate(LONGEST_NAME);
    let name = if is_name(&name) { &*name } else { "camera" };
    let numbered = (2..).map(|number| format!("{name}-{number}"));
    let mut candidates = std::iter::once(name.to_owned()).chain(numbered);
    let unused = candidates.find(|name| !names.contains(name));
    unused.unwrap_or_else(|| name.to_owned())
}

#[cfg(test)]
#[path = "devices_tests.rs"]
mod tests;
