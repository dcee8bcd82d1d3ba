//! Experiment files: scenes that `pardalis measure` runs with several seeds and evaluates.

mod figure;
mod merit;
mod run;

pub use figure::{Figure, FigureKind};
pub use merit::FIGURES_OF_MERIT;
pub use run::{Bands, Method, Run, Swept, Window};

use super::description::KeyDescription;
use super::keys::keys_of;
use super::reader::{Journal, Located, Problem, Table};
use super::replaced::read_with;
use super::{NAMES_ALLOWED, is_name};

/// A group of related runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// The name of its result files.
    pub name: String,
    /// The runs, followed by those of the sweeps. No two have the same [`Run::slug`].
    pub runs: Vec<Run>,
    /// Figures of several runs.
    pub figures: Vec<Figure>,
}

impl Experiment {
    /// Reads an experiment's text. Returns every problem on failure, in the order of lines.
    pub fn parse(text: &str) -> Result<Self, Vec<Problem>> {
        let (experiment, ..) = read_with(text, &toml::Table::new(), Self::read)?;
        Ok(experiment.unwrap_or_else(|| unreachable!("a missing setting is a problem")))
    }

    /// Returns the keys of experiment files.
    pub fn keys() -> Vec<KeyDescription> {
        keys_of(|journal, table| {
            Self::read(journal, table);
        })
    }

    fn read(journal: &Journal, table: &Table) -> Option<Self> {
        let name = read_name(
            table,
            "Name of the folder of the results and of the files of a record.",
        );
        let question = table
            .key("question", "What the experiment is to answer.")
            .required::<String>();
        let mut runs: Vec<Located<Run>> = Vec::new();
        let mut are_complete = true;
        for (key, about, is_sweep) in [
            ("runs", "Scenes, each run with several seeds.", false),
            (
                "sweeps",
                "Like runs, with one run for each value of a setting.",
                true,
            ),
        ] {
            for run in table.tables(key, about) {
                let read = Run::read(&run, is_sweep);
                are_complete &= read.is_some();
                let read = read.into_iter().flatten();
                runs.extend(read.map(|value| run.at("name", value)));
                run.finish();
            }
        }
        for (i, run) in runs.iter().enumerate() {
            let slug = run.value.slug();
            if let Some(other) = runs[..i].iter().find(|other| other.value.slug() == slug) {
                journal.report(run.problem(format!(
                    "the runs \"{}\" and \"{}\" would write into the same folder, {slug}; give names that differ in letters or digits",
                    other.value.name, run.value.name,
                )));
            }
        }
        let runs: Vec<Run> = runs.into_iter().map(|run| run.value).collect();
        let mut figures: Vec<Figure> = Vec::new();
        for figure in table.tables("figures", "Figures of several runs.") {
            // A run that could not be read may be one of those that the figure names.
            let known = are_complete.then_some(&*runs);
            if let Some(read) = Figure::read(&figure, known) {
                if figures.iter().any(|other| other.name == read.name) {
                    figure.problem(
                        "name",
                        "the name is used twice; give each figure its own name",
                    );
                }
                figures.push(read);
            }
            figure.finish();
        }
        question.and(Some(Self {
            name: name?,
            runs,
            figures,
        }))
    }
}

/// Reads the required name of files.
fn read_name(table: &Table, about: &'static str) -> Option<String> {
    let name = table.key("name", about).required::<String>()?;
    if is_name(&name) {
        return Some(name);
    }
    table.reject("name", NAMES_ALLOWED);
    None
}
