//! `pardalis demo`: tracks the bundled sequence and prints the error against ground truth.

use std::path::{Path, PathBuf};

use anyhow::Result;

use super::{evaluate, run_report};
use crate::arguments::Threads;
use crate::interrupt::Stop;
use crate::output::{Shown, print};
use crate::program_file;
use crate::report::REPORT;
use crate::tables;
use crate::tracking::{self, Annotate, Limit, Options, Output, Previous};
use crate::user_error::user_error;

/// Tracks a bundled sequence
///
/// An orange ball is lowered, thrown, and bounces in front of a fisheye camera. The program detects it without a start
/// position. Writes tracks, plots with the truth, and annotated frames, and prints the mean error.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The folder for the results
    #[arg(short, long, value_name = "FOLDER", default_value = "pardalis-demo")]
    output: PathBuf,
    /// The folder with the bundled sequences [default: data, here or in a folder above the program]
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let sequence = find_data(arguments.data.as_deref())?.join(SEQUENCE);
    let options = Options {
        output: Output::Folder(arguments.output.clone()),
        seed: None,
        threads: Threads::default(),
        annotate: Annotate::Trails,
        explain: false,
        particles: None,
        mcap: None,
        send: Vec::new(),
        smooth: false,
        plots: false,
        report: true,
        progress: true,
        previous: Previous::Replace,
        limit: Limit::default(),
        stop: Stop::default(),
        watch: None,
    };
    print(format!(
        "tracking an orange ball through {}",
        sequence.shown()
    ));
    let mut run = tracking::run(&sequence.join("scene.toml"), &options)?;
    let truth_path = sequence.join("truth.csv");
    let truth = tables::read_truth(&truth_path)?;
    run.files.extend(
        run.series
            .draw(&arguments.output, &run.open.scene, &truth)?,
    );
    print(run_report::summary(&run));
    let report = evaluate::score_files(
        &arguments.output,
        &truth_path,
        &evaluate::Options::default(),
    )?;
    print(report.to_string().trim_end());
    if let Some(errors) = report
        .targets
        .first()
        .and_then(|t| t.scores.all.errors.as_ref())
    {
        print(format!(
            "\nThe mean position error was {:.0} mm at 1.8 to 3.9 m from the camera, almost all of it in distance;\n\
             the mean direction error was {:.1} degrees. Open {} in a browser.",
            1e3 * errors.position_m.mean,
            errors.direction_mean_rad.to_degrees(),
            arguments.output.join(REPORT).shown()
        ));
    }
    Ok(())
}

/// The sequence of the demo.
const SEQUENCE: &str = "dioptric-jump";

/// Returns the folder with the bundled sequences: the given one, or `data` in this folder, above it, or above the
/// program, where packages of systems have it in `share/pardalis`.
fn find_data(given: Option<&Path>) -> Result<PathBuf> {
    let holds_it = |folder: &Path| folder.join(SEQUENCE).join("scene.toml").is_file();
    if let Some(folder) = given {
        if holds_it(folder) {
            return Ok(folder.to_owned());
        }
        return Err(user_error!(
            "--data {}: holds no {SEQUENCE}/scene.toml; give the folder `data` of the source code",
            folder.shown()
        ));
    }
    let here = PathBuf::from("data");
    if holds_it(&here) {
        return Ok(here);
    }
    let starts = [
        std::env::current_dir().ok(),
        program_file::get().map(Path::to_owned),
    ];
    let above = starts
        .iter()
        .flatten()
        .flat_map(|path| path.ancestors())
        .flat_map(|folder| ["data", "share/pardalis/data"].map(|data| folder.join(data)));
    above.into_iter().find(|folder| holds_it(folder)).ok_or_else(|| {
        user_error!("the bundled sequences were not found; run this inside the source folder, or use --data PATH/data")
    })
}
