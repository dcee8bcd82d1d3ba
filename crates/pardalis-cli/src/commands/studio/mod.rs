//! `pardalis studio`: from a source to a track in a browser.

mod edits;
mod places;
mod player;
mod pose;
mod project;
mod running;
mod session;
mod state;
mod steps;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use pardalis_studio::{Asset, Extension, Feed, Program, Server};

use crate::interrupt;
use crate::output::{Shown, print, warn};
use crate::source::decode::media_kind;
use crate::user_error::user_error;
use places::Places;
use project::Project;
use session::Session;

/// How often the program looks for Ctrl-C.
const POLL: Duration = Duration::from_millis(100);

/// Sets up and tracks a scene in a browser
///
/// Serves one page on this computer that leads from cameras to a track in six steps: sources, camera, pose, colours, targets, track. It saves the scene
/// file that `track` reads. Give a scene to go on with it; folders, videos and cameras are added to it as sources.
///
/// The page reaches files only below the folders given here and that of the scene. Ctrl-C ends it.
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
    #[command(flatten)]
    page: PageOptions,
}

/// Where the page is served.
#[derive(Debug, clap::Args)]
pub(crate) struct PageOptions {
    /// The port; 0 for any that is free
    #[arg(long, default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Serves the page to other computers, too: an address of this computer, or 0.0.0.0 for all
    ///
    /// Every request then needs the token in the address that is printed. The connection is not encrypted: use it in networks that you trust, or
    /// through a tunnel (ssh -L).
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<IpAddr>,
}

impl PageOptions {
    /// Serves the page, with the viewer of tracks, and prints its address.
    pub(crate) fn serve(&self, program: Arc<dyn Program>, feed: Feed) -> Result<Server> {
        let ip = self.listen.unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST));
        let address = SocketAddr::new(ip, self.port);
        let folder = "viewer/";
        let assets = pardalis_viewer::ASSETS.iter().map(|asset| Asset {
            path: format!("{folder}{}", asset.path).into(),
            content_type: asset.content_type,
            bytes: asset.bytes,
        });
        let extension = Extension {
            assets: assets.collect(),
            import_map: pardalis_viewer::import_map(&format!("/{folder}")),
        };
        let server = Server::start(address, program, feed, extension).map_err(|error| {
            user_error!(
                "{address}: the page cannot be served there: {error}; choose another --port, or an address of this computer with --listen"
            )
        })?;
        print(format!(
            "Open {} in a browser; Ctrl-C ends it.",
            server.address()
        ));
        Ok(server)
    }
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let is_scene = |input: &&String| {
        let path = Path::new(input);
        path.extension().is_some_and(|ending| ending == "toml") && media_kind(path).is_none()
    };
    let scenes: Vec<&String> = arguments.inputs.iter().filter(is_scene).collect();
    let given = match scenes[..] {
        [] => None,
        [scene] => Some(PathBuf::from(scene)),
        [_, second, ..] => {
            return Err(user_error!("{second}: is a second scene; give one"));
        }
    };
    if let Some(scene) = given.as_ref().filter(|scene| !scene.exists()) {
        return Err(user_error!(
            "{}: there is no such file; check the name, or give -o {} to begin it",
            scene.shown(),
            scene.shown()
        ));
    }
    let path = arguments.output.clone().or_else(|| given.clone());
    let path = path.unwrap_or_else(|| PathBuf::from("scene.toml"));
    let mut project = Project::open(given.as_ref().unwrap_or(&path))?;
    project.rename(&path)?;
    let sources: Vec<&String> = arguments
        .inputs
        .iter()
        .filter(|input| !is_scene(input))
        .collect();
    let mut places = vec![folder_of(&path)];
    places.extend(given.as_ref().map(|scene| folder_of(scene)));
    let is_file = |input: &&&String| !input.contains("://") && !input.starts_with("/dev/");
    places.extend(sources.iter().filter(is_file).map(PathBuf::from));
    let feed = Feed::default();
    let session = Session::new(project, Places::of(&places)?, feed.clone());
    for source in sources {
        session.add_source(source, None)?;
    }
    session.follow();
    interrupt::listen();
    let program = Arc::clone(&session);
    let server = arguments.page.serve(program, feed)?;
    while !interrupt::requested() {
        std::thread::sleep(POLL);
    }
    drop(server);
    session.wait();
    if !session.is_saved() {
        warn(format!("{}: the last changes were not saved", path.shown()));
    }
    Ok(())
}

fn folder_of(file: &Path) -> PathBuf {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}
