//! `pardalis studio`: from a source to a track in a browser. The command line is the same in programs that are built without it.

#[cfg(feature = "studio")]
mod answers;
#[cfg(feature = "studio")]
mod board;
#[cfg(feature = "studio")]
mod collected;
#[cfg(feature = "studio")]
mod earlier;
#[cfg(feature = "studio")]
mod edits;
#[cfg(feature = "studio")]
mod places;
#[cfg(feature = "studio")]
mod player;
#[cfg(feature = "studio")]
mod pose;
#[cfg_attr(not(feature = "studio"), path = "without_program.rs")]
mod program;
#[cfg(feature = "studio")]
mod project;
#[cfg(feature = "studio")]
mod replay;
#[cfg(feature = "studio")]
mod rig;
#[cfg(feature = "studio")]
mod running;
#[cfg(feature = "studio")]
mod runs;
#[cfg(feature = "studio")]
mod session;
#[cfg(feature = "studio")]
mod state;
#[cfg(feature = "studio")]
mod steps;
#[cfg(feature = "studio")]
mod targets;
#[cfg(feature = "studio")]
mod waved;

use std::net::IpAddr;
use std::path::PathBuf;

pub(crate) use program::{Watching, run};

/// Sets up and tracks a scene in a browser
///
/// Serves one page on this computer that leads from cameras to a track in six steps: sources, camera, pose, colours, targets, track. It saves the scene
/// file that `track` reads. Give a scene to go on with it; folders, videos and cameras are added to it as sources.
///
/// The page reaches files only below the folders given here and that of the scene. Ctrl-C ends it. Needs a program that was built with the feature
/// studio.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis studio                        begins scene.toml in this folder
  pardalis studio ride.mp4               with a video
  pardalis studio /dev/video0            with a webcam
  pardalis studio rtsp://10.0.0.7/live   with a network camera
  pardalis studio ball.toml              goes on with a scene")]
pub(crate) struct Arguments {
    /// A scene, folders of images, videos, cameras or addresses
    #[arg(value_name = "SCENE|FOLDER|VIDEO|DEVICE")]
    inputs: Vec<String>,
    /// The scene file to write [default: the scene given, else scene.toml]
    #[arg(short, long, value_name = "SCENE.toml")]
    output: Option<PathBuf>,
    /// The port; 0 for any that is free
    #[arg(long, default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Serves the page to other computers, too: an address of this computer, or 0.0.0.0 for all
    ///
    /// Every request then needs the token in the address that is printed. The connection is not encrypted: use it in networks that you trust, or
    /// through a tunnel (ssh -L).
    #[arg(long, value_name = "ADDRESS", value_parser = listened)]
    listen: Option<IpAddr>,
}

/// A page that shows a run while it goes on.
#[derive(Debug, clap::Args)]
pub(crate) struct WatchOptions {
    /// Shows the run in a browser while it goes on: images, outlines, states, 3D view and plots
    ///
    /// Other programs read the estimates as lines of JSON from a WebSocket at the same address, with the path /lines.
    /// Needs a program that was built with the feature studio.
    #[arg(long)]
    watch: bool,
    /// The port of the page; 0 for any that is free
    #[arg(
        long,
        default_value_t = 0,
        hide_default_value = true,
        requires = "watch"
    )]
    port: u16,
    /// Serves the page to other computers, too: an address of this computer, or 0.0.0.0 for all
    ///
    /// Every request then needs the token in the address that is printed. The connection is not encrypted.
    #[arg(long, value_name = "ADDRESS", value_parser = listened, requires = "watch")]
    listen: Option<IpAddr>,
}

/// Reads an address at which the page is served.
fn listened(text: &str) -> Result<IpAddr, &'static str> {
    text.parse().map_err(|_| {
        "allowed: an address of this computer in numbers, such as 192.168.1.7, or 0.0.0.0 for all of them; leave the option out for this computer alone"
    })
}
