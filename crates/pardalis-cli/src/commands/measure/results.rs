//! The figures of an experiment, as rows of a CSV file and as words.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use pardalis::score::{Errors, Scores};

use super::definition::Run;
use crate::commands::evaluate::Report;
use crate::commands::report::median;

/// A figure's name and how it is read from scores; without a value where there is no estimate.
type Metric = (&'static str, fn(&Scores) -> Option<f64>);

/// The figures, in the order of the columns; errors over all frames that have an estimate.
pub(super) const METRICS: [Metric; 15] = [
    ("coverage", |s| s.coverage),
    ("lost_frames", |s| Some(s.lost_frames as f64)),
    ("ends_on_target", |s| {
        s.ends_on_target.map(|yes| f64::from(u8::from(yes)))
    }),
    ("mean_m", |s| errors(s).map(|e| e.position_m.mean)),
    ("sd_m", |s| errors(s).map(|e| e.position_m.sd)),
    ("rmse_m", |s| errors(s).map(|e| e.position_m.rmse)),
    ("max_m", |s| errors(s).map(|e| e.position_m.max)),
    ("distance_mean_m", |s| errors(s).map(|e| e.distance_m.mean)),
    ("distance_sd_m", |s| errors(s).map(|e| e.distance_m.sd)),
    ("elevation_mean_rad", |s| {
        errors(s).map(|e| e.elevation_rad.mean)
    }),
    ("elevation_sd_rad", |s| {
        errors(s).map(|e| e.elevation_rad.sd)
    }),
    ("azimuth_mean_rad", |s| {
        errors(s).map(|e| e.azimuth_rad.mean)
    }),
    ("azimuth_sd_rad", |s| errors(s).map(|e| e.azimuth_rad.sd)),
    ("direction_max_rad", |s| {
        errors(s).map(|e| e.direction_max_rad)
    }),
    ("mean_nees", |s| {
        errors(s).and_then(|e| e.consistency.mean_nees)
    }),
];

fn errors(scores: &Scores) -> Option<&Errors> {
    scores.all.errors.as_ref()
}

/// The figures of one seed and target.
pub(super) struct Figures {
    seed: u32,
    target: String,
    pub(super) object: String,
    /// In the order of [`METRICS`].
    values: Vec<Option<f64>>,
}

impl Figures {
    /// One for each scored target of a report.
    pub(super) fn of(seed: u32, report: &Report) -> Vec<Self> {
        let targets = report.targets.iter();
        targets
            .map(|target| Self {
                seed,
                target: target.target.clone(),
                object: target.object.clone(),
                values: METRICS
                    .iter()
                    .map(|(_, metric)| metric(&target.scores))
                    .collect(),
            })
            .collect()
    }

    fn value(&self, metric: &str) -> Option<f64> {
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
    /// Adds a run's figures.
    pub(super) fn extend(&mut self, run: &Run, figures: Vec<Figures>) {
        self.rows
            .extend(figures.into_iter().map(|f| (run.name.clone(), f)));
    }

    /// Columns `run, seed, target, object` and the figures.
    pub(super) fn to_csv(&self) -> String {
        let mut text = "run,seed,target,object".to_owned();
        for (name, _) in METRICS {
            let _ = write!(text, ",{name}");
        }
        text.push('\n');
        for (run, figures) in &self.rows {
            // Names of runs are the experiment's own and hold no quotes.
            let _ = write!(
                text,
                "\"{run}\",{},{},{}",
                figures.seed, figures.target, figures.object
            );
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

/// A run's main figures in a line.
pub(super) fn told(run: &Run, figures: &[Figures]) -> String {
    let of = |metric: &str| {
        let mut values: Vec<f64> = figures.iter().filter_map(|f| f.value(metric)).collect();
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
    format!(
        "{}: {} tracks, RMSE {:.0} mm (median; {:.0} to {:.0}); {lost} with frames beyond the bound, {off} end off the target",
        run.name,
        figures.len(),
        1e3 * median(&rmse_m),
        1e3 * lowest,
        1e3 * highest,
    )
}

/// What lies outside the run's bands, a line each.
pub(super) fn outside_bands(run: &Run, figures: &[Figures]) -> Vec<String> {
    let mut outside = Vec::new();
    for (metric, [lowest, highest]) in &run.expect {
        for f in figures {
            let value = f.value(metric);
            if !value.is_some_and(|v| (*lowest..=*highest).contains(&v)) {
                let shown = value.map_or_else(|| "missing".to_owned(), |v| format!("{v:.4}"));
                outside.push(format!(
                    "{}, seed {}, {}: {metric} is {shown}, expected {lowest} to {highest}",
                    run.name, f.seed, f.target
                ));
            }
        }
    }
    outside
}

/// Where a record comes from: command, commit, version and machine.
pub(super) fn facts(experiment: &Path) -> String {
    let said = |program: &str, arguments: &[&str]| {
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
    let changes = said("git", &["status", "--porcelain", "--untracked-files=no"]);
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let cpu = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .unwrap_or(": unknown");
    format!(
        "command   pardalis measure {}\nversion   {}\ncommit    {}{}\ncompiler  {}\ncpu       {}\ncores     {}\n",
        experiment.display(),
        env!("CARGO_PKG_VERSION"),
        said("git", &["rev-parse", "HEAD"]),
        if changes.is_empty() {
            ""
        } else {
            " with uncommitted changes"
        },
        said("rustc", &["--version"]),
        cpu.trim_start_matches([':', ' ', '\t']),
        std::thread::available_parallelism().map_or(0, usize::from),
    )
}
