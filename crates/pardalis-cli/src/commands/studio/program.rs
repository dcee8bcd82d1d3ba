//! Runs the studio, and shows runs of `track`.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use pardalis_studio::{Asset, Extension, Feed, Lines, Program, Server};
use serde_json::{Value, json};

use super::places::Places;
use super::project::Project;
use super::session::Session;
use super::{Arguments, WatchOptions};
use crate::interrupt;
use crate::output::{Shown, note, warn};
use crate::source::decode::media_kind;
use crate::tracking::Watch;
use crate::user_error::user_error;

/// How often the program looks for Ctrl-C.
const POLL: Duration = Duration::from_millis(100);

/// How long pages may take to show that a run is over. Those on a slow machine or network are far behind.
const LAST_MESSAGE: Duration = Duration::from_secs(5);

/// How long pages may then fetch the last rows.
const LAST_ROWS: Duration = Duration::from_millis(1500);

/// Serves the page, with the viewer of tracks, and prints its address.
fn serve(
    (listen, port): (Option<IpAddr>, u16),
    program: Arc<dyn Program>,
    (feed, lines): (Feed, Lines),
) -> Result<Server> {
    let ip = listen.unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST));
    let address = SocketAddr::new(ip, port);
    let folder = "viewer/";
    let assets = pardalis_viewer::ASSETS.iter().map(|asset| Asset {
        path: format!("{folder}{}", asset.path).into(),
        content_type: asset.content_type,
        bytes: asset.bytes,
    });
    let extension = Extension {
        assets: assets.collect(),
        import_map: pardalis_viewer::import_map(&format!("/{folder}")),
        lines,
    };
    let server = Server::start(address, program, feed, extension).map_err(|error| {
        let remedy = match error.kind() {
            ErrorKind::AddrNotAvailable => {
                "--listen takes an address of this computer, or 0.0.0.0 for all"
            }
            ErrorKind::AddrInUse => {
                "another program has this port, perhaps another run; choose another --port"
            }
            _ => "choose another --port, or an address of this computer with --listen",
        };
        user_error!("{address}: the page cannot be served there: {error}; {remedy}")
    })?;
    let elsewhere = if ip.is_unspecified() {
        format!(
            "; on another computer, with this one's number, such as 192.168.1.7, in place of {ip}"
        )
    } else {
        String::new()
    };
    note(format_args!(
        "Open {} in a browser{elsewhere}. Ctrl-C ends it.",
        server.address()
    ));
    Ok(server)
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Inputs {
        given,
        sources,
        path,
    } = Inputs::of(arguments)?;
    let mut project = Project::open(given.as_ref().unwrap_or(&path))?;
    project.rename(&path)?;
    let mut places = vec![folder_of(&path)];
    places.extend(given.as_ref().map(|scene| folder_of(scene)));
    let is_file = |input: &&&String| !input.contains("://") && !input.starts_with("/dev/");
    places.extend(sources.iter().filter(is_file).map(PathBuf::from));
    let feed = Feed::default();
    let session = Session::new(project, Places::of(&places)?, feed.clone());
    if given.is_some() {
        session.warn_of_problems();
    }
    for source in sources {
        if session.has_source(source) {
            note(format_args!("{source} is in {} already.", path.shown()));
        } else {
            session.add_source(source, None)?;
        }
    }
    session.follow();
    // What the command line added is added by it again.
    let began = session.text();
    interrupt::listen();
    let program = Arc::clone(&session);
    let place = (arguments.listen, arguments.port);
    let server = serve(place, program, (feed, session.lines.clone()))?;
    while !interrupt::requested() {
        std::thread::sleep(POLL);
    }
    drop(server);
    session.wait();
    if !session.is_saved() && session.text() != began {
        warn(format!("{}: the last changes were not saved", path.shown()));
    }
    Ok(())
}

/// What the command line names.
struct Inputs<'a> {
    /// The scene to go on with.
    given: Option<PathBuf>,
    /// What is added to it.
    sources: Vec<&'a String>,
    /// The scene to write.
    path: PathBuf,
}

impl<'a> Inputs<'a> {
    fn of(arguments: &'a Arguments) -> Result<Self> {
        let is_scene = |input: &&String| {
            let path = Path::new(input);
            is_toml(path) && media_kind(path).is_none()
        };
        let (scenes, sources): (Vec<_>, Vec<_>) = arguments.inputs.iter().partition(is_scene);
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
        // One that does not exist is refused when it is added.
        let place = |input: &String| std::fs::canonicalize(input).unwrap_or_else(|_| input.into());
        for (number, source) in sources.iter().enumerate() {
            if sources[..number]
                .iter()
                .any(|other| place(other) == place(source))
            {
                return Err(user_error!("{source}: is given twice; give it once"));
            }
        }
        let path = arguments.output.clone().or_else(|| given.clone());
        let path = path.unwrap_or_else(|| PathBuf::from("scene.toml"));
        if !is_toml(&path) {
            return Err(user_error!(
                "-o {}: a scene is a TOML file; choose a name ending in .toml",
                path.shown()
            ));
        }
        Ok(Self {
            given,
            sources,
            path,
        })
    }
}

fn is_toml(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "toml")
}

fn folder_of(file: &Path) -> PathBuf {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// A page that shows a run, until it is dropped.
pub(crate) struct Watching {
    /// What shows the run.
    pub(crate) watch: Watch,
    feed: Feed,
    _server: Server,
}

impl Watching {
    /// Serves the page of a run of the scene in this file, if that is asked for.
    pub(crate) fn start(options: &WatchOptions, scene_path: &Path) -> Result<Option<Self>> {
        if !options.watch {
            return Ok(None);
        }
        let feed = Feed::default();
        let lines = Lines::default();
        let watch = Watch::of(&feed, &lines);
        let program = Watched {
            watch: watch.clone(),
            scene: scene_path.shown(),
        };
        let place = (options.listen, options.port);
        Ok(Some(Self {
            watch,
            _server: serve(place, Arc::new(program), (feed.clone(), lines))?,
            feed,
        }))
    }

    /// Leaves open pages the time to fetch the last rows.
    pub(crate) fn finish(self) {
        self.feed.show("over", &json!(true));
        if self.feed.is_watched() {
            self.feed.wait_until_shown(LAST_MESSAGE);
            std::thread::sleep(LAST_ROWS);
        }
    }
}

/// Answers the pages that show a run.
struct Watched {
    watch: Watch,
    scene: String,
}

impl Program for Watched {
    fn answer(&self, request: &str, value: Value) -> Result<Value, String> {
        match (request, value["from"].as_u64()) {
            ("state", _) => Ok(json!({ "watched": self.scene })),
            ("rows", Some(from)) => Ok(self.watch.rows_from(from as usize)),
            _ => Err(format!("{request}: this page only shows a run")),
        }
    }
}
