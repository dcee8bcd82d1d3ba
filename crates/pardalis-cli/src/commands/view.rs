//! `pardalis view`: shows finished tracks in a browser.

use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::Value;

use crate::files::refuse_foreign;
use crate::output::{Shown, print, warn};
use crate::report::{self, CameraPoses, Compared, Comparison, PageCamera, PageScene};
use crate::results::{self, beside, folder_of, read_summary};
use crate::tracking::{CAMERAS, EARLIER, SUMMARY};
use crate::user_error::user_error;

/// Shows finished tracks in 3D, over time and in numbers
///
/// Writes a page and opens it in the browser. The page contains all that it shows, and loads nothing: it can be moved and shared.
///
/// Cameras and shapes are those of the scene that summary.json beside the tracks names, if it can still be read; cameras that move are where cameras.csv has them. Annotated frames (`track --annotate`) beside them are
/// part of the page as reduced copies, as many as fit into 20 MB.
///
/// With a second run of the same recording, such as with another seed, the page shows both over each other, and how far they differ. Rows are matched by their times,
/// targets by their names.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis view ball-tracks                     the track in this folder
  pardalis view ball-tracks/filtered.csv        before smoothing
  pardalis view ball-tracks run7                two runs over each other
  pardalis view ball-tracks/tracks.previous.csv ball-tracks   the earlier run and this one
  pardalis view ball-tracks -o ball.html --no-open")]
pub(crate) struct Arguments {
    /// tracks.csv, or the folder that holds it
    tracks: PathBuf,
    /// A second run of the same recording, which is compared with the first
    other: Option<PathBuf>,
    /// The page [default: view.html beside the tracks, or comparison.html of two runs]
    #[arg(short, long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    /// Only writes the page
    #[arg(long)]
    no_open: bool,
}

/// The rows of a run and what is beside them.
struct Results {
    tracks: PathBuf,
    folder: PathBuf,
    summary: Option<Value>,
}

impl Results {
    /// Finds the results that an argument names.
    fn of(argument: &Path) -> Result<Self> {
        let tracks = if argument.is_dir() {
            argument.join("tracks.csv")
        } else {
            argument.to_owned()
        };
        if !tracks.exists() || tracks.ends_with(SUMMARY) {
            return Err(user_error!(
                "{}: {}; give the folder with the results of `pardalis track`, or a file with rows in it, such as tracks.csv",
                argument.shown(),
                if argument.is_dir() {
                    "there is no tracks.csv in this folder"
                } else if tracks.exists() {
                    "has the summary and not the rows"
                } else {
                    "there is no such file"
                }
            ));
        }
        Ok(Self {
            folder: folder_of(&tracks),
            summary: read_summary(&tracks)?,
            tracks,
        })
    }

    /// Reports whether the studio has moved these results away for later ones in that folder.
    fn is_earlier_than(&self, later: &Self) -> bool {
        let folders = (self.folder.canonicalize(), later.folder.canonicalize());
        let (Ok(folder), Ok(later)) = folders else {
            return false;
        };
        folder.parent() == Some(&later.join(EARLIER))
    }

    /// Returns a name: that of the folder, with that of the file if it is not the usual one.
    fn name(&self) -> String {
        let folder = self.folder.canonicalize();
        let folder = folder.as_deref().unwrap_or(&self.folder);
        let name = |path: &Path| Path::new(path.file_name().unwrap_or_default()).shown();
        if self.tracks.ends_with("tracks.csv") {
            name(folder)
        } else {
            format!("{}/{}", name(folder), name(&self.tracks))
        }
    }
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let page = write_page(arguments)?;
    print(page.shown());
    if !arguments.no_open
        && let Err(error) = open::that_detached(&page)
    {
        warn(format!(
            "no browser can be opened here ({error}); open the page yourself"
        ));
    }
    Ok(())
}

/// Writes the comparison of a run with another beside the rows of the first; returns the page.
#[cfg(feature = "studio")]
pub(crate) fn write_comparison(tracks: &Path, other: &Path) -> Result<PathBuf> {
    write_page(&Arguments {
        tracks: tracks.to_owned(),
        other: Some(other.to_owned()),
        output: None,
        no_open: true,
    })
}

fn write_page(arguments: &Arguments) -> Result<PathBuf> {
    let results = Results::of(&arguments.tracks)?;
    let other = arguments.other.as_deref().map(Results::of).transpose()?;
    let page = match &arguments.output {
        Some(page) => page.clone(),
        None => results.folder.join(match other {
            None => report::VIEW,
            Some(_) => report::COMPARISON,
        }),
    };
    // The folder may have come from somebody else.
    if arguments.output.is_none() && page.is_symlink() {
        return Err(user_error!(
            "{}: is a link, through which the page could replace a file elsewhere; remove it, or give -o",
            page.shown()
        ));
    }
    refuse_foreign("-o", &page, "page of pardalis view", report::is_page)?;
    let comparison = match (&other, &arguments.other) {
        (Some(other), Some(given)) => {
            let mut names = [results.name(), other.name()];
            let is_earlier = other.is_earlier_than(&results);
            if is_earlier {
                names[1] = format!("{}/{EARLIER}/{}", names[0], names[1]);
            } else if names[0] == names[1] {
                names = [arguments.tracks.shown(), given.shown()];
            }
            let mut comparison = compared((&results, other), &names)?;
            comparison.other_is_earlier = is_earlier;
            Some(comparison)
        }
        _ => None,
    };
    let mut notes = Vec::new();
    let poses = beside(&results.tracks, CAMERAS);
    let poses = if poses.exists() {
        report::read_poses(&poses)?
    } else {
        CameraPoses::new()
    };
    let scene = page_scene(&results, poses, &mut notes);
    report::write(
        &page,
        (Some(&results.tracks), &results.folder),
        scene,
        results.summary.as_ref(),
        comparison,
        notes,
    )?;
    Ok(page)
}

/// Compares two runs, which are called so.
fn compared((first, second): (&Results, &Results), names: &[String; 2]) -> Result<Comparison> {
    let [first, second] = [(first, &names[0]), (second, &names[1])].map(|(run, name)| Compared {
        name,
        tracks: &run.tracks,
        summary: run.summary.as_ref(),
    });
    let comparison = report::compare(first, second)?;
    comparison.doubt.iter().for_each(warn);
    Ok(comparison)
}

/// Returns the scene of some results, and notes what is missing in it.
fn page_scene(results: &Results, poses: CameraPoses, notes: &mut Vec<String>) -> PageScene {
    let Some(summary) = &results.summary else {
        notes.push(format!(
            "Without cameras, shapes and settings: there is no {SUMMARY} beside the tracks."
        ));
        return PageScene::of_balls(report::title(&results.tracks), &[]);
    };
    scene_of(summary, &results.folder, poses).unwrap_or_else(|problem| {
        warn(format!("{problem}; the page shows no cameras"));
        notes.push(format!("Without cameras and shapes: {problem}."));
        PageScene::of_balls(title_of(summary), &report::diameters_m(summary))
    })
}

/// Returns the scene of a page that a summary names, if it can still be read.
fn scene_of(summary: &Value, folder: &Path, mut poses: CameraPoses) -> Result<PageScene, String> {
    let (scene, path) = results::scene_of(summary, folder)?;
    let cameras = scene.cameras.iter().map(|camera| PageCamera {
        size_px: size_px(summary, &camera.name),
        path: poses.remove(&camera.name).unwrap_or_default(),
    });
    let cameras: Vec<_> = cameras.collect();
    Ok(PageScene::new(report::title(&path), &scene, &cameras))
}

/// Returns the size of a camera's images.
fn size_px(summary: &Value, camera: &str) -> Option<(usize, usize)> {
    let size_px = &summary["cameras"][camera]["source"]["size_px"];
    let side = |number: usize| usize::try_from(size_px[number].as_u64()?).ok();
    Some((side(0)?, side(1)?))
}

fn title_of(summary: &Value) -> String {
    report::title(Path::new(summary["scene"].as_str().unwrap_or_default()))
}
