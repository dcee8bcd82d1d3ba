//! `pardalis measure`: runs an experiment's scenes with several seeds and evaluates them against the truth.

mod digits;
mod figures;
mod finished;
mod jobs;
mod metrics;
mod plan;
mod pooled;
mod results;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use pardalis_scene::experiment::Experiment;
use rayon::prelude::*;

use crate::commands::simulate::Sequence;
use crate::files::{refuse_links, write_file};
use crate::output::{Shown, print};
use crate::scene::problems_in;
use crate::scene_files::read_text;
use crate::user_error::user_error;
use finished::Finished;
use jobs::Job;
use plan::Measured;
use plan::Plan;
use results::Results;

/// Runs an experiment with several seeds and evaluates it
///
/// EXPERIMENT.toml names scenes, their truth, and bands for the figures of every seed; docs/reference/experiment.md lists
/// all keys and figures. Writes results.csv (one row per run, seed, target and window), pooled.csv (per run or sweep over
/// all recordings: NEES with its 99 % band, reliability of the confidences), every track, and plots with all seeds. An
/// interrupted experiment resumes: finished seeds are reused if program, scene and frames are unchanged.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis measure experiments/jump/experiment.toml
  pardalis measure experiments/jump/experiment.toml --verify     only a few seeds, for a quick check
  pardalis measure experiments/jump/experiment.toml --record experiments/record/2026-11-21
  pardalis measure experiments/jump/experiment.toml --figures experiments/jump/figures

EXPERIMENT.toml:
  name = \"ball\"
  question = \"How many particles does it need?\"
  [[runs]]
  name = \"near\"
  scene = \"ball.toml\"           # paths start at this file's folder
  truth = \"truth.csv\"
  seeds = 10
  verify_seeds = 1              # with --verify
  expect = { rmse_m = [0, 0.3] }  # a band for every seed
  set = { \"targets.ball.contour.points\" = 30 }    # overrides keys of the scene
  windows = [{ name = \"hidden\", from_s = 1.2, to_s = 2.4, expect = { max_m = [0, 1] } }]
  # a window can also select frames by the number of cameras that see the object:
  # { name = \"two cameras\", seen_by = 2 }
  lost_beyond_m = 0.66          # an estimate farther from the truth counts as lost
  visible_over = 0.6            # an object counts as visible above this visible share
  interpolate = true            # evaluates every row, with the truth interpolated to its time
  origin_m = [0, 0, 0.9]        # of distance, elevation, azimuth; default: the first camera
  # instead of scene and truth: world = \"ring.toml\", which is simulated first;
  # set and sweeps change its keys as \"world.KEY\"; with fresh_world = true, each seed
  # has its own recording, simulated with the same seed
  method = \"locate\"             # each image independently, like `pardalis locate`,
  starts = \"truth.csv\"          # from these positions; default: from the scene's start
  [[sweeps]]                    # like a run, but with one run per value
  name = \"particles\"
  scene = \"ball.toml\"
  truth = \"truth.csv\"
  seeds = 10
  timed = true                  # one seed at a time, to measure ms_a_frame
  key = \"targets.ball.filter.particles\"           # or [\"KEY\", \"KEY\"] with lists as values
  values = [100, 1000]          # with names = [..], these label the values
  [[figures]]
  name = \"cost\"
  kind = \"sweep\"                # paths (seeds = 10: only ten; reaches_far = true: also runs
                                # far off the truth), errors, sweep or reliability
  runs = [\"particles\"]          # names of runs or sweeps
  x_name = \"particles\"          # for a sweep: the label of the axis
  figure = \"rmse_m\"             # for a sweep: the figure of merit")]
pub(crate) struct Arguments {
    /// The experiment
    #[arg(value_name = "EXPERIMENT.toml")]
    experiment: PathBuf,
    /// The folder for tracks, plots and results.csv
    #[arg(short, long, value_name = "FOLDER", default_value = "out")]
    output: PathBuf,
    /// Runs only the first `verify_seeds` seeds of each run
    #[arg(long)]
    verify: bool,
    /// Also copies results.csv into this folder, under the experiment's name, with the commit and a description of
    /// the machine
    #[arg(long, value_name = "FOLDER", conflicts_with = "verify")]
    record: Option<PathBuf>,
    /// Also copies the figures that the experiment defines, as PNG, into this folder
    #[arg(long, value_name = "FOLDER", conflicts_with = "verify")]
    figures: Option<PathBuf>,
    /// Tracks all seeds again
    #[arg(long)]
    fresh: bool,
    /// Number of seeds that are tracked in parallel, one thread each; results do not depend on it [default: one per
    /// core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.experiment;
    let experiment = Experiment::parse(&read_text(path)?)
        .map_err(|problems| problems_in("experiment", path, &problems))?;
    // Before anything is written, because a replaced record would count as an uncommitted change.
    let facts = results::facts(&arguments.experiment);
    let output = arguments.output.join(&experiment.name);
    refuse_links(&output)?;
    let place = || arguments.experiment.shown();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.map_or(cores, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .context("the threads cannot be started")?;
    let plans = pool.install(|| plans(&experiment, arguments, &output));
    let plans = plans.with_context(place)?;
    if plans.is_empty() {
        print("nothing to run: no run has any seeds (with --verify: verify_seeds)");
        return Ok(());
    }
    let all: Vec<Job> = plans.iter().flat_map(Plan::jobs).collect();
    let seeds = all.len();
    let jobs: Vec<Job> = all
        .into_iter()
        .filter(|job| {
            let found = Finished::read(&job.folder);
            arguments.fresh || found.is_none_or(|f| f.fingerprint != job.fingerprint)
        })
        .collect();
    if jobs.len() < seeds {
        print(format!(
            "{} of {seeds} seeds are already tracked and are reused (--fresh tracks them again)",
            seeds - jobs.len()
        ));
    }
    jobs::track_all(&jobs, threads).with_context(place)?;

    let measured: Result<Vec<Measured>> =
        pool.install(|| plans.par_iter().map(Plan::score_and_draw).collect());
    let measured = measured.with_context(place)?;
    let mut results = Results::default();
    let mut outside = Vec::new();
    for Measured { plan, figures, .. } in &measured {
        print(results::summary_line(plan.run, figures));
        outside.extend(results::outside_bands(plan.run, figures));
        results.extend(plan.run, figures);
    }
    let pooled = pooled::to_csv(&measured);
    let csv = output.join("results.csv");
    write_file(&csv, results.to_csv().as_bytes())?;
    write_file(&output.join("pooled.csv"), pooled.as_bytes())?;
    print(csv.shown());
    if let Some(record) = &arguments.record {
        fs::create_dir_all(record)
            .map_err(|error| user_error!("--record {}: {error}", record.shown()))?;
        let file = |ending| record.join(format!("{}.{ending}", experiment.name));
        write_file(&file("csv"), results.to_csv().as_bytes())?;
        write_file(&file("facts.txt"), facts.as_bytes())?;
        let pooled_name = format!("{}-pooled.csv", experiment.name);
        write_file(&record.join(pooled_name), pooled.as_bytes())?;
    }
    let drawn = figures::draw_all(&experiment.figures, &measured, &output)?;
    if let Some(folder) = &arguments.figures {
        figures::copy_pngs(&drawn, folder)?;
    }
    if outside.is_empty() {
        return Ok(());
    }
    Err(anyhow::anyhow!(
        "{} figures lie outside the expected bands:\n  {}",
        outside.len(),
        outside.join("\n  ")
    ))
}

/// Plans every run that has seeds. Errors in any run are reported before anything is tracked.
fn plans<'a>(
    experiment: &'a Experiment,
    arguments: &Arguments,
    output: &Path,
) -> Result<Vec<Plan<'a>>> {
    let folder = arguments.experiment.parent().unwrap_or(Path::new(""));
    let mut plans = Vec::new();
    for run in &experiment.runs {
        let seeds = if arguments.verify {
            run.verify_seeds.min(run.seeds)
        } else {
            run.seeds
        };
        let of_run = || format!("run \"{}\"", run.name);
        if seeds == 0
            && let Some(world) = &run.world
        {
            // Check the world now: simulating takes a while.
            Sequence::read(&folder.join(world), &run.replaced()[1]).with_context(of_run)?;
            continue;
        }
        let plan = Plan::new(run, seeds, folder, output).with_context(of_run)?;
        if seeds > 0 {
            plans.push(plan);
        }
    }
    Ok(plans)
}
