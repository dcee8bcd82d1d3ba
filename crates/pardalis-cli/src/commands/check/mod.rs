//! `pardalis check`: finds all problems of a scene, and says what its cameras deliver and what tracking costs, and writes nothing.

mod camera;
mod cost;
mod target;

use std::path::PathBuf;

use anyhow::Result;
use pardalis::Frame;

use crate::arguments::Threads;
use crate::numbers::counted;
use crate::output::{Shown, print, warn};
use crate::platforms;
use crate::scene::open_parts;
use crate::units;
use camera::Seen;

/// Finds all problems of a scene before it is tracked
///
/// Reads the scene and all files that it names, opens every camera, takes the first frames of each, and compares their size with
/// that of the calibration. Reports the problems together, each with its line, its key and the remedy. A camera whose calibration
/// cannot be read is not opened.
///
/// Says for each camera what it is, and the size, rate and number of its frames; for each target, how much of the first frame is
/// in its colours, and whether the target is found there; which values are still guesses; and how long a step of tracking takes
/// on this computer, measured by tracking up to 11 frames of each camera. Writes no files.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis check scene.toml             before the first run, or when cameras were unplugged
  pardalis check scene.toml && pardalis track scene.toml

Exit codes: 0 if the scene can be tracked, with or without warnings; 2 if it cannot.")]
pub(crate) struct Arguments {
    /// The scene file
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    #[command(flatten)]
    threads: Threads,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.scene;
    let mut parts = open_parts(path)?;
    let cameras = camera::examine(&mut parts);
    for (camera, seen) in parts.scene.cameras.iter().zip(&cameras) {
        if let Some(seen) = seen {
            print(seen.text(&camera.name));
        }
    }
    let first = |seen: &Option<Seen>| Some(seen.as_ref()?.frames[0].clone());
    let firsts: Vec<Option<Frame>> = cameras.iter().map(first).collect();
    let targets = target::examine(&mut parts, &firsts);
    let of_text = parts.scene.warnings.iter();
    let mut warnings: Vec<String> = of_text
        .map(|warning| format!("{}: {warning}", path.shown()))
        .chain(parts.source_warnings(path))
        .chain(targets.iter().flat_map(|target| target.warnings(path)))
        .chain(units::warnings(&parts.scene, path))
        .collect();
    if !parts.assembly.problems.is_empty() {
        for target in targets.iter().filter(|target| target.was_looked_for()) {
            print(target.text(None));
        }
        warnings.iter().for_each(warn);
        return parts.finish(path).map(|_| ());
    }

    let seen = || cameras.iter().flatten();
    let is_live = seen().any(|camera| camera.is_live);
    let frames = seen().filter_map(Seen::recorded_frames).max();
    let interval_s = seen().filter_map(|camera| camera.interval_s);
    let interval_s = interval_s.reduce(f64::min);
    let mut open = parts.finish(path)?;
    let firsts: Vec<&[Frame]> = seen().map(|camera| &camera.frames[..]).collect();
    let cost = cost::measure(&mut open, &firsts, interval_s, arguments.threads)?;
    for (number, target) in targets.iter().enumerate() {
        let found = &cost.found[number];
        print(target.text(Some(found)));
        print(target::outcome(&open.scene.targets[number], found));
        warnings.extend(target.missing_warning(path, found));
    }
    let (heard, wrong) = platforms::heard(&mut open.platforms);
    heard.iter().for_each(print);
    warnings.extend(
        wrong
            .iter()
            .map(|wrong| format!("{}: {wrong}", path.shown())),
    );
    print(cost.text(frames));
    if is_live {
        warnings.extend(cost.warning(path));
    }
    warnings.iter().for_each(warn);
    let verdict = match warnings.len() as u64 {
        0 => "no problems".to_owned(),
        count => format!("no errors, {}", counted(count, "warning")),
    };
    print(format!("{}: {verdict}", path.shown()));
    Ok(())
}
