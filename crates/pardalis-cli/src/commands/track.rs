//! `pardalis track`: tracks the targets of a scene.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Result, anyhow};

use crate::arguments::{Threads, parse_duration_s};
use crate::commands::run_report::{never_found, summary, warnings};
use crate::commands::studio::{WatchOptions, Watching};
use crate::interrupt::Stop;
use crate::output::{note, print};
use crate::tracking::{self, Annotate, Destination, Limit, Options, Output, Previous};
use crate::user_error::user_error;

/// Tracks the targets of a scene
///
/// Reads a scene file (`pardalis init` writes one to start from), tracks every target through all frames and writes a
/// folder with tracks.csv (position, velocity, covariance and best particle, one row per frame and target),
/// summary.json, and plots (from above, from the side, in an oblique view, and over time).
///
/// Rows and summary of an earlier run in that folder are kept as tracks.previous.csv and summary.previous.json.
///
/// If a target is missing in some frames, the summary says in how many, and why the candidates were ruled out;
/// --explain reports this for each frame.
///
/// With several cameras, frames that arrive early wait up to timing.max_delay_s (a key of the scene; default 0.1 s,
/// with one camera 0) for earlier frames of other cameras. A camera that fails, ends or freezes does not stop the
/// others; a table at the end and summary.json list the frames of each camera that were used and dropped.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis track ball.toml                       results into the folder ball-tracks
  pardalis track ball.toml -o run7 --annotate    also the frames with contours and particles
  pardalis track ball.toml --smooth              the best track of a recording
  pardalis track ball.toml --annotate --report   also a page with all of it, for the browser
  pardalis track ball.toml --annotate --explain  why candidates were ruled out
  pardalis track live.toml --send udp://10.0.0.2:7000   estimates for a robot
  pardalis track live.toml --watch               shows the run in a browser
  pardalis track live.toml --duration 60         a minute of a live camera
  pardalis track ball.toml -o - | head           rows to standard output while tracking")]
#[allow(clippy::struct_excessive_bools)] // flags of the command line
pub(crate) struct Arguments {
    /// The scene file
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The folder for the results, or - to print only the rows on standard output [default: the scene's name with
    /// -tracks]
    #[arg(short, long, value_name = "FOLDER|-")]
    output: Option<PathBuf>,
    /// Overrides the scene's seed
    #[arg(long)]
    seed: Option<u32>,
    #[command(flatten)]
    threads: Threads,
    /// Also writes every frame with contours and particles drawn on it
    #[arg(long)]
    annotate: bool,
    /// Also writes candidates.csv: the candidates in each frame, and why each was ruled out
    ///
    /// Needs an output folder. With --annotate, the candidates are drawn into the frames. The guide explains
    /// each verdict (docs/not-found.md).
    #[arg(long)]
    explain: bool,
    /// Stops after this many frames; with several cameras, after this many frame sets (the images of one time)
    #[arg(long, value_name = "N", value_parser = parse_frames, allow_negative_numbers = true)]
    frames: Option<NonZeroUsize>,
    /// Stops after this much time by the cameras' time stamps, counted from the first frame
    #[arg(long = "duration", value_name = "SECONDS", value_parser = parse_duration_s, allow_negative_numbers = true)]
    duration_s: Option<f64>,
    /// Smooths the tracks at the end: every row takes into account what came after it
    ///
    /// For recordings: tracks.csv then has the smoothed rows, filtered.csv those that were written while tracking, and
    /// events.csv the contacts: throws, bounces and the like. Needs an output folder.
    #[arg(long)]
    smooth: bool,
    /// Exits with code 1 if a target is tracked in no frame; results are written nevertheless
    #[arg(long)]
    require_found: bool,
    /// Also writes the particles of each estimate to a file with the columns
    /// frame,time_s,target,landmark,particle,x_m,…,vx_mps,…,weight
    ///
    /// One row per frame, target and particle, written while tracking. Particles are those of the last update before
    /// resampling; their weights sum to one. Targets without an estimate have no rows. Files are large: 500 particles
    /// take about 60 kB per frame.
    #[arg(long, value_name = "FILE.csv")]
    particles: Option<PathBuf>,
    /// Also writes images, outlines, cameras and estimates into an MCAP recording, which Foxglove and others show
    ///
    /// An earlier recording of that name is replaced. Needs a program that was built with the feature mcap.
    #[arg(long, value_name = "FILE.mcap")]
    mcap: Option<PathBuf>,
    /// Also writes report.html: a page that shows the tracks in 3D and over time, in any browser and without a network
    ///
    /// With --annotate, it contains reduced copies of the frames. `pardalis view` writes such a page of finished tracks. Needs an output folder.
    #[arg(long)]
    report: bool,
    /// Sends the estimates to another program while tracking, as lines of JSON: udp://HOST:PORT or tcp://HOST:PORT; may be repeated
    ///
    /// The latest wins: a receiver that is too slow, or not there yet, gets fewer, and does not hold up tracking. Over TCP the program connects to the
    /// receiver, again and again until it answers.
    #[arg(long, value_name = "ADDRESS", value_parser = Destination::parse)]
    send: Vec<Destination>,
    #[command(flatten)]
    watch: WatchOptions,
    /// Draws no plots
    #[arg(long)]
    no_plots: bool,
}

/// Parses a number of frames.
fn parse_frames(text: &str) -> Result<NonZeroUsize, String> {
    text.parse()
        .map_err(|_| "allowed: a whole number above 0".to_owned())
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let output = match &arguments.output {
        Some(path) if path.as_os_str() == "-" => Output::Stdout,
        Some(folder) => Output::Folder(folder.clone()),
        None => {
            let stem = arguments
                .scene
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy();
            Output::Folder(PathBuf::from(format!("{stem}-tracks")))
        }
    };
    let to_stdout = output == Output::Stdout;
    if arguments.explain && to_stdout {
        return Err(user_error!(
            "--explain: writes candidates.csv into the output folder; give -o a folder instead of -"
        ));
    }
    if arguments.smooth && to_stdout {
        return Err(user_error!(
            "--smooth: replaces rows once the recording is over; give -o a folder instead of -"
        ));
    }
    if arguments.report && to_stdout {
        return Err(user_error!(
            "--report: writes report.html into the output folder; give -o a folder instead of -"
        ));
    }
    let watching = Watching::start(&arguments.watch, &arguments.scene)?;
    let options = Options {
        output,
        seed: arguments.seed,
        threads: arguments.threads,
        annotate: if arguments.annotate {
            Annotate::Trails
        } else {
            Annotate::No
        },
        explain: arguments.explain,
        particles: arguments.particles.clone(),
        mcap: arguments.mcap.clone(),
        send: arguments.send.clone(),
        smooth: arguments.smooth,
        plots: !arguments.no_plots,
        report: arguments.report,
        progress: true,
        previous: Previous::Keep,
        limit: Limit {
            frame_sets: arguments.frames.map(NonZeroUsize::get),
            duration_s: arguments.duration_s,
        },
        stop: Stop::default(),
        watch: watching.as_ref().map(|watching| watching.watch.clone()),
    };
    let run = tracking::run(&arguments.scene, &options);
    if let Some(watching) = watching {
        watching.finish();
    }
    let run = run?;
    let warnings = warnings(&run);
    if !warnings.is_empty() {
        note(warnings.trim_end());
    }
    if !to_stdout {
        print(summary(&run).trim_end());
    }
    let never_found: Vec<&str> = never_found(&run).map(|(_, name)| name).collect();
    if arguments.require_found && !never_found.is_empty() {
        return Err(anyhow!(
            "--require-found: not found in any frame: {}",
            never_found.join(", ")
        ));
    }
    Ok(())
}
