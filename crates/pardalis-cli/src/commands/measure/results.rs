//! The figures of an experiment, as rows of a CSV file and as words.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use pardalis_evaluate::{Course, Errors, Heading};

use super::definition::{Bands, Run};
use super::digits::{median, shown};
use crate::commands::evaluate::{Report, TargetReport};

/// What is known of one seed and target.
pub(super) struct Measured<'a> {
    report: &'a TargetReport,
    ms_a_frame: Option<f64>,
}

/// A figure's name and how it is found; without a value where there is no estimate, or where it means nothing.
type Metric = (&'static str, fn(&Measured) -> Option<f64>);

/// The figures, in the order of the columns; errors over all frames that have an estimate.
pub(super) const METRICS: [Metric; 40] = [
    ("coverage", |m| m.report.scores.coverage),
    ("lost_frames", |m| Some(m.report.scores.lost_frames as f64)),
    ("ends_on_target", |m| {
        m.report.scores.ends_on_target.map(one_or_zero)
    }),
    ("frames_to_find", |m| {
        m.report.scores.frames_to_find.map(|n| n as f64)
    }),
    ("frames_to_occluded", |m| {
        m.report.states?.frames_to_occluded.map(|n| n as f64)
    }),
    ("frames_to_tracking", |m| {
        m.report.states?.frames_to_tracking.map(|n| n as f64)
    }),
    ("elsewhere_frames", |m| {
        Some(m.report.states?.elsewhere_frames as f64)
    }),
    ("mean_m", |m| errors(m).map(|e| e.position_m.mean)),
    ("sd_m", |m| errors(m).map(|e| e.position_m.sd)),
    ("rmse_m", |m| errors(m).map(|e| e.position_m.rmse)),
    ("max_m", |m| errors(m).map(|e| e.position_m.max)),
    // Of the best particle, beside the mean's.
    ("best_rmse_m", |m| {
        errors(m)?.best_position_m.map(|best| best.rmse)
    }),
    ("distance_mean_m", |m| errors(m).map(|e| e.distance_m.mean)),
    ("distance_sd_m", |m| errors(m).map(|e| e.distance_m.sd)),
    ("elevation_mean_rad", |m| {
        errors(m).map(|e| e.elevation_rad.mean)
    }),
    ("elevation_sd_rad", |m| {
        errors(m).map(|e| e.elevation_rad.sd)
    }),
    ("azimuth_mean_rad", |m| {
        errors(m).map(|e| e.azimuth_rad.mean)
    }),
    ("azimuth_sd_rad", |m| errors(m).map(|e| e.azimuth_rad.sd)),
    ("direction_max_rad", |m| {
        errors(m).map(|e| e.direction_max_rad)
    }),
    ("mean_nees", |m| errors(m)?.consistency.mean_nees),
    ("nees_99_low", |m| {
        errors(m)?.consistency.mean_nees_band_99.map(|band| band[0])
    }),
    ("nees_99_high", |m| {
        errors(m)?.consistency.mean_nees_band_99.map(|band| band[1])
    }),
    ("planar_mean_m", |m| errors(m).map(|e| e.planar_m.mean)),
    ("planar_sd_m", |m| errors(m).map(|e| e.planar_m.sd)),
    ("planar_rmse_m", |m| errors(m).map(|e| e.planar_m.rmse)),
    ("bias_x_m", |m| errors(m).map(|e| e.bias_m[0])),
    ("bias_y_m", |m| errors(m).map(|e| e.bias_m[1])),
    ("bias_z_m", |m| errors(m).map(|e| e.bias_m[2])),
    ("velocity_rmse_mps", |m| errors(m)?.velocity_rmse_mps),
    ("course_error_median_rad", |m| {
        course(m).map(|c| c.error_median_rad)
    }),
    ("course_rad", |m| course(m).map(|c| c.estimated_rad)),
    ("true_course_rad", |m| course(m).map(|c| c.true_rad)),
    ("heading_error_median_rad", |m| {
        heading(m).map(|h| h.error_median_rad)
    }),
    ("heading_error_p95_rad", |m| {
        heading(m).map(|h| h.error_p95_rad)
    }),
    ("heading_bias_rad", |m| heading(m).map(|h| h.bias_rad)),
    ("changed_target", |m| {
        m.report.changed_target.map(one_or_zero)
    }),
    ("calibration_error", |m| {
        let reliability = m.report.confidence.reliability.as_ref();
        reliability.map(|r| r.calibration_error)
    }),
    ("confidence_max", |m| m.report.confidence.confidence_max),
    // With it, a mean and its standard deviation give the mean's standard error.
    ("estimates", |m| Some(m.report.scores.all.estimates as f64)),
    ("ms_a_frame", |m| m.ms_a_frame),
];

fn errors<'a>(measured: &Measured<'a>) -> Option<&'a Errors> {
    measured.report.scores.all.errors.as_ref()
}

fn course(measured: &Measured) -> Option<Course> {
    errors(measured)?.course
}

fn heading(measured: &Measured) -> Option<Heading> {
    errors(measured)?.heading
}

fn one_or_zero(yes: bool) -> f64 {
    f64::from(u8::from(yes))
}

/// The figures of one seed and target over one stretch of time.
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
    /// One for each scored target of a report over a window.
    pub(super) fn of(
        seed: u32,
        window: &str,
        report: &Report,
        ms_a_frame: Option<f64>,
    ) -> Vec<Self> {
        let of_target = |report: &TargetReport| Self {
            seed,
            target: report.target.clone(),
            object: report.object.clone(),
            window: window.to_owned(),
            values: METRICS
                .iter()
                .map(|(_, metric)| metric(&Measured { report, ms_a_frame }))
                .collect(),
        };
        report.targets.iter().map(of_target).collect()
    }

    /// The figure of that name.
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
    /// Adds a run's figures.
    pub(super) fn extend(&mut self, run: &Run, figures: &[Figures]) {
        let rows = figures.iter().map(|f| (run.name.clone(), f.clone()));
        self.rows.extend(rows);
    }

    /// Columns `run, seed, target, object, window` and the figures.
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

/// A field of a CSV file.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// A run's main figures, over all frames, in a line.
pub(super) fn told(run: &Run, figures: &[Figures]) -> String {
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
        "{}: {} tracks, RMSE {middle} mm (median; {lowest} to {highest}); {lost} of them with lost frames, {off} end off the target",
        run.name,
        whole.len(),
    )
}

/// What lies outside the run's bands and those of its windows, a line each.
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
