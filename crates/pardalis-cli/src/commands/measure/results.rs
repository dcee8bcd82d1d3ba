//! The figures of an experiment, as rows of a CSV file and as text.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use pardalis_scene::experiment::{Bands, Run};

use super::digits::{median, shown};
use super::metrics::{METRICS, Measured};
use crate::commands::evaluate::{Report, TargetReport};
use crate::output::Shown;

/// The figures of one seed and target over one window.
#[derive(Clone)]
pub(super) struct Figures {
    pub(super) seed: u32,
    pub(super) target: String,
    pub(super) object: String,
    /// The name of the run's window; empty for all frames.
    pub(super) window: String,
    /// In the order of [`METRICS`].
    values: Vec<Option<f64>>,
}

impl Figures {
    /// Returns the figures of each evaluated target of a report over a window.
    pub(super) fn of(
        seed: u32,
        window: &str,
        report: &Report,
        ms_a_frame: Option<f64>,
    ) -> Vec<Self> {
        let crowds = &report.crowds;
        let figures = |of_target: &TargetReport| Self {
            seed,
            target: of_target.target.clone(),
            object: of_target.object.clone(),
            window: window.to_owned(),
            values: METRICS
                .iter()
                .map(|(_, metric)| {
                    metric(&Measured {
                        report: of_target,
                        crowd: crowds.iter().find(|crowd| crowd.crowd == of_target.target),
                        ms_a_frame,
                    })
                })
                .collect(),
        };
        report.targets.iter().map(figures).collect()
    }

    /// Returns the figure of that name.
    pub(super) fn value(&self, metric: &str) -> Option<f64> {
        METRICS
            .iter()
            .position(|(name, _)| *name == metric)
            .and_then(|i| self.values[i])
    }
}

/// All figures of an experiment.
#[derive(Default)]
pub(super) struct Results {
    rows: Vec<(String, Figures)>,
}

impl Results {
    /// Adds the figures of a run.
    pub(super) fn extend(&mut self, run: &Run, figures: &[Figures]) {
        let rows = figures.iter().map(|f| (run.name.clone(), f.clone()));
        self.rows.extend(rows);
    }

    /// Returns the CSV text with the columns `run, seed, target, object, window` and the figures.
    pub(super) fn to_csv(&self) -> String {
        let mut text = "run,seed,target,object,window".to_owned();
        for (name, _) in METRICS {
            let _ = write!(text, ",{name}");
        }
        text.push('\n');
        for (run, figures) in &self.rows {
            let _ = write!(
                text,
                "{},{},{},{},",
                quoted(run),
                figures.seed,
                figures.target,
                figures.object
            );
            if !figures.window.is_empty() {
                text.push_str(&quoted(&figures.window));
            }
            for value in &figures.values {
                let _ = match value {
                    Some(value) => write!(text, ",{value}"),
                    None => write!(text, ","),
                };
            }
            text.push('\n');
        }
        text
    }
}

/// Returns a quoted field of a CSV file.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// Returns a run's main figures over all frames, as one line of text.
pub(super) fn summary_line(run: &Run, figures: &[Figures]) -> String {
    let whole: Vec<&Figures> = figures.iter().filter(|f| f.window.is_empty()).collect();
    let of = |metric: &str| {
        let mut values: Vec<f64> = whole.iter().filter_map(|f| f.value(metric)).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let rmse_m = of("rmse_m");
    let (Some(lowest), Some(highest)) = (rmse_m.first(), rmse_m.last()) else {
        return format!("{}: no estimate", run.name);
    };
    let lost = of("lost_frames").iter().filter(|&&n| n > 0.0).count();
    let off = of("ends_on_target")
        .iter()
        .filter(|&&yes| yes == 0.0)
        .count();
    let [middle, lowest, highest] = [median(&rmse_m), *lowest, *highest].map(|m| shown(1e3 * m));
    format!(
        "{}: {} tracks, RMSE {middle} mm (median; {lowest} to {highest}); {lost} of them with lost frames, {off} do not end on the target",
        run.name,
        whole.len(),
    )
}

/// Returns the figures outside the bands of the run and its windows, one line each.
pub(super) fn outside_bands(run: &Run, figures: &[Figures]) -> Vec<String> {
    let whole: (&str, &Bands) = ("", &run.expect);
    let windows = run.windows.iter().map(|w| (&*w.name, &w.expect));
    let mut outside = Vec::new();
    for (window, expect) in std::iter::once(whole).chain(windows) {
        let place = if window.is_empty() {
            run.name.clone()
        } else {
            format!("{}, {window}", run.name)
        };
        for (metric, [lowest, highest]) in expect {
            for f in figures.iter().filter(|f| f.window == window) {
                let value = f.value(metric);
                if !value.is_some_and(|v| (*lowest..=*highest).contains(&v)) {
                    let shown = value.map_or_else(|| "missing".to_owned(), |v| format!("{v:.4}"));
                    outside.push(format!(
                        "{place}, seed {}, {}: {metric} is {shown}, expected {lowest} to {highest}",
                        f.seed, f.target
                    ));
                }
            }
        }
    }
    outside
}

/// Returns the origin of a record: command, commit, version and machine.
pub(super) fn facts(experiment: &Path) -> String {
    let output_of = |program: &str, arguments: &[&str]| {
        let output = Command::new(program)
            .args(arguments)
            .output()
            .ok()
            .filter(|o| o.status.success());
        output.map_or_else(
            || "unknown".to_owned(),
            |o| String::from_utf8_lossy(&o.stdout).trim().to_owned(),
        )
    };
    let changes = output_of("git", &["status", "--porcelain", "--untracked-files=no"]);
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let cpu = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .unwrap_or(": unknown");
    format!(
        "command   pardalis measure {}\nversion   {}\ncommit    {}{}\ncompiler  {}\ncpu       {}\ncores     {}\n",
        experiment.shown(),
        env!("CARGO_PKG_VERSION"),
        output_of("git", &["rev-parse", "HEAD"]),
        if changes.is_empty() {
            ""
        } else {
            " with uncommitted changes"
        },
        output_of("rustc", &["--version"]),
        cpu.trim_start_matches([':', ' ', '\t']),
        std::thread::available_parallelism().map_or(0, usize::from),
    )
}
