//! Figures of several runs of an experiment.

use super::super::reader::Table;
use super::super::setting::Word;
use super::{FIGURES_OF_MERIT, Run, read_name};

/// A figure of several runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// The name of its files.
    pub name: String,
    /// What it shows.
    pub kind: FigureKind,
    /// Names of runs, or of sweeps for all their runs.
    pub runs: Vec<String>,
    /// For paths: the number of seeds that are drawn; `None` draws all.
    pub seeds: Option<u32>,
    /// For paths: whether nearly all estimates are shown instead of only the surroundings of the truth.
    pub reaches_far: bool,
    /// For a sweep: the label of the axis of values; if `None`, the key that the first sweep varies.
    pub x_name: Option<String>,
    /// For a sweep: the figure of merit, a length.
    pub figure: String,
}

/// The contents of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FigureKind {
    /// The paths of all seeds, one colour per run.
    Paths,
    /// Errors of distance, elevation and azimuth against distance, one mark per run.
    Errors,
    /// A figure of merit against the values of sweeps, and against the time per frame.
    Sweep,
    /// The share of rows that are right against their confidence, one mark per run or sweep.
    Reliability,
}

impl Word for FigureKind {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("paths", Self::Paths),
        ("errors", Self::Errors),
        ("sweep", Self::Sweep),
        ("reliability", Self::Reliability),
    ];
}

impl Figure {
    /// Reports whether it shows this run.
    pub fn shows(&self, run: &Run) -> bool {
        let sweep = run.swept.as_ref().map(|swept| &swept.sweep);
        (self.runs.iter()).any(|name| *name == run.name || Some(name) == sweep)
    }

    /// Reads a figure. Its runs are checked against those of the experiment, if these are known.
    pub(super) fn read(table: &Table, known: Option<&[Run]>) -> Option<Self> {
        let name = read_name(table, "Name of the figure's files.");
        let kind = table
            .key(
                "kind",
                "What it shows: the paths of all seeds; errors of distance, elevation and azimuth against distance; a figure of merit against the values of sweeps; or the share of rows that are right against their confidence.",
            )
            .required::<FigureKind>();
        let runs = table
            .key("runs", "Names of runs, or of sweeps for all their runs.")
            .required::<Vec<String>>();
        let seeds = table
            .key("seeds", "For `paths`: number of seeds to draw.")
            .depends("all")
            .optional();
        let reaches_far = table
            .key(
                "reaches_far",
                "For `paths`: show nearly all estimates, not only the surroundings of the truth.",
            )
            .or(false);
        let x_name = table
            .key("x_name", "For `sweep`: label of the axis of values.")
            .depends("the key of the first sweep")
            .optional();
        let figure = table
            .key("figure", "For `sweep`: the figure of merit, a length.")
            .or("rmse_m".to_owned());
        let lengths = FIGURES_OF_MERIT.iter().map(|(name, _)| *name);
        let lengths: Vec<_> = lengths.filter(|name| name.ends_with("_m")).collect();
        if !lengths.contains(&&*figure) {
            table.reject("figure", &lengths.join(", "));
        }
        let (kind, runs) = (kind?, runs?);
        if let Some(known) = known {
            check_runs(table, kind, &runs, known);
        }
        Some(Self {
            name: name?,
            kind,
            runs,
            seeds,
            reaches_far,
            x_name,
            figure,
        })
    }
}

/// Reports a name that is not a run or sweep of the experiment.
fn check_runs(table: &Table, kind: FigureKind, names: &[String], known: &[Run]) {
    let what = match kind {
        FigureKind::Sweep => "sweep",
        _ => "run or sweep",
    };
    let is_named = |name: &String, run: &Run| {
        let is_sweep = run.swept.as_ref().is_some_and(|s| s.sweep == *name);
        is_sweep || (kind != FigureKind::Sweep && run.name == *name)
    };
    for name in names {
        if !known.iter().any(|run| is_named(name, run)) {
            table.problem("runs", format!("\"{name}\" is not a {what} of this file"));
        }
    }
}
