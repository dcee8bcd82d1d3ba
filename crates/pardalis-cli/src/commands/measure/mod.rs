//! `pardalis measure`: runs an experiment's scenes with several seeds and scores them against the truth.

mod definition;
mod results;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;

use super::evaluate;
use crate::fault::fault;
use crate::files::write_file;
use crate::say::say;
use crate::tables;
use crate::tracking::{self, Options, Output, SeriesCollector};
use definition::{Experiment, Run};
use results::{Figures, Results};

/// Runs an experiment with several seeds and scores it
///
/// EXPERIMENT.toml names scenes, their truth, and the bands that every seed's figures must lie in. Writes results.csv
/// (a row a run, seed and target), every track, and plots with all seeds over one another.
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
    /// Threads to track with [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let experiment = Experiment::read(&arguments.experiment)?;
    // Before anything is written: a record that is replaced would count as an uncommitted change.
    let facts = results::facts(&arguments.experiment);
    let folder = arguments.experiment.parent().unwrap_or(Path::new(""));
    let output = arguments.output.join(&experiment.name);
    let mut results = Results::default();
    let mut outside = Vec::new();
    for run in &experiment.runs {
        let seeds = if arguments.verify {
            run.verify_seeds.min(run.seeds)
        } else {
            run.seeds
        };
        if seeds == 0 {
            continue;
        }
        let figures = measure(run, folder, &output, seeds, arguments.threads)?;
        say(results::told(run, &figures));
        outside.extend(results::outside_bands(run, &figures));
        results.extend(run, figures);
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

/// Tracks one run with the seeds from 1 on, scores each and draws them over one another.
fn measure(
    run: &Run,
    folder: &Path,
    output: &Path,
    seeds: u32,
    threads: Option<u16>,
) -> Result<Vec<Figures>> {
    let truth_path = folder.join(&run.truth);
    let run_folder = output.join(run.slug());
    let mut figures = Vec::new();
    let mut all_seeds: Option<(SeriesCollector, pardalis::config::Scene)> = None;
    for seed in 1..=seeds {
        let seed_folder = run_folder.join(format!("seed-{seed:02}"));
        let options = Options {
            output: Output::Folder(seed_folder.clone()),
            seed: Some(seed),
            threads: threads.map(usize::from),
            annotate: false,
            plots: false,
        };
        let tracked = tracking::run(&folder.join(&run.scene), &options)?;
        let report =
            evaluate::score_files(&seed_folder, &truth_path, &evaluate::Options::default())?;
        figures.extend(Figures::of(seed, &report));
        match &mut all_seeds {
            None => all_seeds = Some((tracked.series, tracked.open.scene)),
            Some((series, _)) => series.append(tracked.series),
        }
    }
    if let Some((series, scene)) = all_seeds {
        let mut truth = tables::read_truth(&truth_path)?;
        truth.retain(|object| figures.iter().any(|f| f.object == object.name));
        series.draw(&run_folder, &scene, &truth)?;
    }
    Ok(figures)
}
