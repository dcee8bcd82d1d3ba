//! `pardalis measure`: runs an experiment's scenes with several seeds and scores them against the truth.

mod definition;
mod finished;
mod jobs;
mod results;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use pardalis::config::Scene;

use super::evaluate;
use crate::draw::plots::{Sample, TrackSeries};
use crate::fault::fault;
use crate::files::write_file;
use crate::say::say;
use crate::{scene, tables, tracking};
use definition::{Experiment, Run};
use finished::Finished;
use jobs::Job;
use results::{Figures, Results};

/// Runs an experiment with several seeds and scores it
///
/// EXPERIMENT.toml names scenes, their truth, and the bands that every seed's figures must lie in. Writes results.csv
/// (a row a run, seed, target and window), every track, and plots with all seeds over one another. An experiment that was
/// interrupted goes on where it stopped: seeds that are finished, with the same program, scene and frames, are taken as they are.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis measure experiments/fisheye/experiment.toml
  pardalis measure experiments/fisheye/experiment.toml --verify      the few seeds that the gate runs
  pardalis measure experiments/fisheye/experiment.toml --record experiments/record/2026-11-21")]
pub(crate) struct Arguments {
    /// The experiment
    #[arg(value_name = "EXPERIMENT.toml")]
    experiment: PathBuf,
    /// The folder for tracks, plots and results.csv
    #[arg(short, long, value_name = "FOLDER", default_value = "out")]
    output: PathBuf,
    /// Runs only the first few seeds of each run, as many as its `verify_seeds` says
    #[arg(long)]
    verify: bool,
    /// Also keeps results.csv, under the experiment's name, with the commit and facts about the machine
    #[arg(long, value_name = "FOLDER", conflicts_with = "verify")]
    record: Option<PathBuf>,
    /// Tracks all seeds anew
    #[arg(long)]
    fresh: bool,
    /// How many seeds are tracked at a time, a thread each; results do not depend on it [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let experiment = Experiment::read(&arguments.experiment)?;
    // Before anything is written: a record that is replaced would count as an uncommitted change.
    let facts = results::facts(&arguments.experiment);
    let output = arguments.output.join(&experiment.name);
    let plans = plans(&experiment, arguments, &output)
        .with_context(|| arguments.experiment.display().to_string())?;
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
        say(format!(
            "{} of {seeds} seeds were tracked before and are taken (--fresh tracks them anew)",
            seeds - jobs.len()
        ));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    jobs::track_all(&jobs, arguments.threads.map_or(cores, usize::from))
        .with_context(|| arguments.experiment.display().to_string())?;

    let mut results = Results::default();
    let mut outside = Vec::new();
    for plan in &plans {
        let figures = plan.score().with_context(|| {
            format!(
                "{}: run \"{}\"",
                arguments.experiment.display(),
                plan.run.name
            )
        })?;
        plan.draw(&figures)?;
        say(results::told(plan.run, &figures));
        outside.extend(results::outside_bands(plan.run, &figures));
        results.extend(plan.run, figures);
    }
    let csv = output.join("results.csv");
    write_file(&csv, results.to_csv().as_bytes())?;
    say(csv.display());
    if let Some(record) = &arguments.record {
        fs::create_dir_all(record)
            .map_err(|error| fault!("--record {}: {error}", record.display()))?;
        write_file(
            &record.join(format!("{}.csv", experiment.name)),
            results.to_csv().as_bytes(),
        )?;
        write_file(
            &record.join(format!("{}.facts.txt", experiment.name)),
            facts.as_bytes(),
        )?;
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

/// A run whose scene and truth were found to be fine.
struct Plan<'a> {
    run: &'a Run,
    /// How many are tracked.
    seeds: u32,
    scene_path: PathBuf,
    scene: Scene,
    truth_path: PathBuf,
    /// Takes the results.
    folder: PathBuf,
    /// See [`finished::of_run`].
    fingerprint: u64,
}

/// Everything that will be run, so that what is wrong shows before anything is tracked.
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
        if seeds > 0 {
            let plan = Plan::new(run, seeds, folder, output);
            plans.push(plan.with_context(|| format!("run \"{}\"", run.name))?);
        }
    }
    Ok(plans)
}

impl<'a> Plan<'a> {
    /// `folder` is the experiment's.
    fn new(run: &'a Run, seeds: u32, folder: &Path, output: &Path) -> Result<Self> {
        let scene_path = folder.join(&run.scene);
        let scene = scene::read_with(&scene_path, &run.set)?;
        let truth_path = folder.join(&run.truth);
        tables::read_truth(&truth_path)?;
        let scene_folder = scene_path.parent().unwrap_or(Path::new(""));
        Ok(Self {
            run,
            seeds,
            fingerprint: finished::of_run(&scene, scene_folder),
            scene_path,
            scene,
            truth_path,
            folder: output.join(run.slug()),
        })
    }

    fn seed_folder(&self, seed: u32) -> PathBuf {
        self.folder.join(format!("seed-{seed:02}"))
    }

    /// One a seed.
    fn jobs(&self) -> impl Iterator<Item = Job<'_>> {
        (1..=self.seeds).map(|seed| Job {
            run: self.run,
            scene_path: &self.scene_path,
            scene: &self.scene,
            seed,
            folder: self.seed_folder(seed),
            fingerprint: finished::of_seed(self.fingerprint, seed, self.run.timed),
        })
    }

    /// The figures of all seeds over all frames, then over each window.
    fn score(&self) -> Result<Vec<Figures>> {
        let whole = ("", None, None);
        let windows = self.run.windows.iter();
        let windows = windows.map(|w| (&*w.name, Some(w.from_s), Some(w.to_s)));
        let mut figures = Vec::new();
        for (window, from_s, to_s) in std::iter::once(whole).chain(windows) {
            let options = evaluate::Options {
                around: self.run.origin_m,
                from_s,
                to_s,
                ..evaluate::Options::default()
            };
            for seed in 1..=self.seeds {
                let folder = self.seed_folder(seed);
                let report = evaluate::score_files(&folder, &self.truth_path, &options)?;
                let finished = Finished::read(&folder).filter(|_| window.is_empty());
                let ms_a_frame = finished.and_then(|f| f.ms_a_frame);
                figures.extend(Figures::of(seed, window, &report, ms_a_frame));
            }
        }
        Ok(figures)
    }

    /// The tracks of all seeds, in their order.
    fn tracks(&self) -> Result<Vec<TrackSeries>> {
        let mut tracks = Vec::new();
        for seed in 1..=self.seeds {
            let read = tables::read_tracks(&self.seed_folder(seed).join("tracks.csv"))?;
            tracks.extend(read.into_iter().map(|track| {
                TrackSeries {
                    name: track.name,
                    rows: track
                        .rows
                        .into_iter()
                        .map(|(time_s, estimate)| Sample {
                            time_s,
                            position_m: estimate.map(|e| e.position_m),
                            covariance_m2: estimate.and_then(|e| e.covariance_m2),
                        })
                        .collect(),
                }
            }));
        }
        Ok(tracks)
    }

    /// Draws all seeds over one another, with the truth of the objects that they were scored against.
    fn draw(&self, figures: &[Figures]) -> Result<()> {
        let mut truth = tables::read_truth(&self.truth_path)?;
        truth.retain(|object| figures.iter().any(|f| f.object == object.name));
        tracking::draw_tracks(&self.folder, &self.scene, &self.tracks()?, &truth)?;
        Ok(())
    }
}
