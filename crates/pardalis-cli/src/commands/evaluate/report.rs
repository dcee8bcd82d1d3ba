//! The results of `pardalis evaluate`, as a table and as JSON.

use std::fmt;
use std::path::PathBuf;

use anyhow::Result;
use pardalis_evaluate::{
    Consistency, Crowd, Errors, Evaluation, Identities, MeanSd, Reliability, Sample, States,
    Summary,
};
use serde::Serialize;

use super::align::Aligned;
use super::confidence::Confidence;
pub(crate) use super::pairing::MatchedBy;
use crate::numbers::{counted, fixed, plain};
use crate::output::Shown;

/// All results, and the options they depend on.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// The tracks.csv that was read.
    pub(crate) tracks: PathBuf,
    /// The truth.csv that was read.
    pub(crate) truth: PathBuf,
    /// Where the tracks' world was moved to, if that was asked for.
    pub(crate) aligned: Option<Aligned>,
    /// Origin of distance, elevation and azimuth.
    pub(crate) around: Point,
    /// An object counts as visible if more than this share of it is visible.
    pub(crate) visible_over: f64,
    /// An estimate farther than this from the truth counts as lost.
    pub(crate) lost_beyond_m: f64,
    /// Only frames from this time on are evaluated, in seconds.
    pub(crate) from_s: Option<f64>,
    /// Only frames up to this time are evaluated, in seconds.
    pub(crate) to_s: Option<f64>,
    /// Only frames in which this number of cameras see the object are evaluated.
    pub(crate) seen_by: Option<usize>,
    /// Largest distance between a row and the time of its frame, in seconds.
    pub(crate) time_tolerance_s: f64,
    /// In the order of the tracks.
    pub(crate) targets: Vec<TargetReport>,
    /// Crowds as a whole.
    pub(crate) crowds: Vec<CrowdReport>,
    /// `None` with fewer than two targets.
    pub(crate) identities: Option<Identities>,
    /// Targets that were not evaluated.
    pub(crate) targets_without_object: Vec<String>,
    /// Objects without a target.
    pub(crate) objects_without_target: Vec<String>,
}

/// A point in the world frame, and its origin.
#[derive(Debug, Serialize)]
pub(crate) struct Point {
    /// Position in metres.
    pub(crate) position_m: [f64; 3],
    /// Origin of the position, as text.
    pub(crate) source: String,
}

/// The results for one target.
#[derive(Debug, Serialize)]
pub(crate) struct TargetReport {
    /// Its name in the tracks.
    pub(crate) target: String,
    /// The truth object with which it is compared.
    pub(crate) object: String,
    /// The reason for this pairing.
    pub(crate) matched_by: MatchedBy,
    /// Number of rows of the target.
    pub(crate) rows: usize,
    /// Number of rows without truth: the object has none at that time, or another row is nearer to it.
    pub(crate) rows_without_truth: usize,
    /// Whether it ends nearer to another object than to its own (occluders aside); `None` without another object.
    pub(crate) changed_target: Option<bool>,
    /// The errors and counts.
    #[serde(flatten)]
    pub(crate) scores: Evaluation,
    /// Evaluation of its states; `None` without states or without a diameter.
    #[serde(flatten)]
    pub(crate) states: Option<States>,
    /// The frames that were evaluated.
    #[serde(skip)]
    pub(crate) samples: Vec<Sample>,
    /// Evaluation of its confidences.
    #[serde(flatten)]
    pub(crate) confidence: Confidence,
}

/// The evaluation of a crowd.
#[derive(Debug, Serialize)]
pub(crate) struct CrowdReport {
    /// Its name.
    pub(crate) crowd: String,
    /// Number of its members that have rows.
    pub(crate) members: usize,
    /// The truth objects.
    pub(crate) objects: Vec<String>,
    #[serde(flatten)]
    pub(crate) figures: Crowd,
}

impl Report {
    /// Returns the results as JSON with unit-suffixed keys, without a final line feed.
    pub(crate) fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)?)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.around.position_m.map(plain);
        writeln!(f, "tracks   {}", self.tracks.shown())?;
        writeln!(f, "truth    {}", self.truth.shown())?;
        if let Some(aligned) = &self.aligned {
            let (angle_deg, distance_m) = aligned.extent();
            writeln!(
                f,
                "aligned  the tracks were turned by {} degrees and moved by {} m",
                fixed(angle_deg, 2),
                fixed(distance_m, 4)
            )?;
        }
        writeln!(f, "around   ({x}, {y}, {z}) m: {}", self.around.source)?;
        writeln!(
            f,
            "visible  more than {} of the object seen; lost: beyond {} m; times matched within {} s",
            self.visible_over,
            plain(self.lost_beyond_m),
            plain(self.time_tolerance_s)
        )?;
        if self.from_s.is_some() || self.to_s.is_some() {
            let shown = |time_s: Option<f64>, end: &str| {
                time_s.map_or_else(|| end.to_owned(), |time_s| format!("{time_s} s"))
            };
            let (from, to) = (
                shown(self.from_s, "the first"),
                shown(self.to_s, "the last"),
            );
            writeln!(f, "frames   from {from} to {to}")?;
        }
        let is_of_crowd = |target: &&TargetReport| target.matched_by == MatchedBy::Crowd;
        for target in self.targets.iter().filter(|target| !is_of_crowd(target)) {
            writeln!(f)?;
            target.fmt(f)?;
        }
        for crowd in &self.crowds {
            let of_crowd = self.targets.iter().filter(is_of_crowd);
            let objects = of_crowd.filter(|target| target.target == crowd.crowd);
            write_crowd(f, crowd, objects)?;
        }
        if let Some(identities) = self.identities {
            writeln!(
                f,
                "\nidentities: {} switches; {} frames in which targets follow each other's objects",
                identities.switches, identities.swapped_frames
            )?;
        }
        if !self.targets_without_object.is_empty() {
            let names = self.targets_without_object.join(", ");
            writeln!(f, "\nnot evaluated, no object left: {names}")?;
        }
        if !self.objects_without_target.is_empty() {
            let names = self.objects_without_target.join(", ");
            writeln!(f, "\nobjects without a target: {names}")?;
        }
        Ok(())
    }
}

/// Writes the figures of a crowd, and a line for each of its objects.
fn write_crowd<'a>(
    f: &mut fmt::Formatter,
    crowd: &CrowdReport,
    objects: impl Iterator<Item = &'a TargetReport>,
) -> fmt::Result {
    let figures = &crowd.figures;
    writeln!(
        f,
        "\ncrowd {}: {} members of {} objects; a member within {} m of an object follows it",
        crowd.crowd,
        crowd.members,
        crowd.objects.len(),
        plain(figures.cutoff_m)
    )?;
    let frames = |longest: usize| format!("at most {longest} frames in a row");
    let rows = [
        (
            "GOSPA, mean, mm",
            fixed(1000.0 * figures.gospa_m, 1),
            String::new(),
        ),
        (
            "identity switches",
            figures.switches.to_string(),
            String::new(),
        ),
        (
            "visible objects missed, frames",
            figures.missed.to_string(),
            frames(figures.longest_missed_frames),
        ),
        (
            "members that follow nothing, frames",
            figures.false_tracks.to_string(),
            frames(figures.longest_false_frames),
        ),
    ];
    for (name, value, note) in rows {
        writeln!(
            f,
            "  {}",
            format!("{name:<36} {value:>11}  {note}").trim_end()
        )?;
    }
    writeln!(
        f,
        "  {:<20} {:>13} {:>13} {:>15}",
        "object", "visible frames", "followed", "RMS error, mm"
    )?;
    for object in objects {
        let visible = &object.scores.visible;
        let rms_m = visible.errors.as_ref().map(|errors| errors.position_m.rmse);
        writeln!(
            f,
            "  {:<20} {:>13} {:>13} {:>15}",
            object.object,
            visible.frames,
            visible.estimates,
            rms_m.map_or_else(none, |rms_m| fixed(1000.0 * rms_m, 1))
        )?;
    }
    Ok(())
}

impl fmt::Display for TargetReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let why = match self.matched_by {
            MatchedBy::Map => "as mapped",
            MatchedBy::Name => "same name",
            MatchedBy::Alone => "the only ones left",
            MatchedBy::Position => "identity assigned by position",
            MatchedBy::Crowd => "whichever member follows it",
        };
        writeln!(
            f,
            "target {} against object {} ({why}); {}, {} of them without truth",
            self.target,
            self.object,
            counted(self.rows as u64, "row"),
            self.rows_without_truth
        )?;
        let s = &self.scores;
        line(f, "", "visible frames", "all frames")?;
        let (visible, all) = (&s.visible, &s.all);
        line(
            f,
            "frames",
            &visible.frames.to_string(),
            &all.frames.to_string(),
        )?;
        let estimates = |summary: &Summary| summary.estimates.to_string();
        line(f, "with an estimate", &estimates(visible), &estimates(all))?;
        let percent = |share| format!("{} %", fixed(100.0 * share, 1));
        line(f, "coverage", &s.coverage.map_or_else(none, percent), "")?;
        line(f, "lost frames", &s.lost_frames.to_string(), "")?;
        let yes_or_no = |yes| if yes { "yes" } else { "no" }.to_owned();
        let ends = s.ends_on_target.map_or_else(none, yes_or_no);
        line(f, "last visible frame on target", &ends, "")?;
        let to_find = s.frames_to_find.map_or_else(none, |n| n.to_string());
        line(f, "frames until found, at most", &to_find, "")?;
        if let Some(states) = self.states {
            let most = |frames: Option<usize>| frames.map_or_else(none, |n| n.to_string());
            let (occluded, tracking) = (states.frames_to_occluded, states.frames_to_tracking);
            line(f, "frames until occluded, at most", "", &most(occluded))?;
            line(f, "    until tracking again, at most", "", &most(tracking))?;
            let elsewhere = states.elsewhere_frames.to_string();
            line(f, "tracking beyond a diameter, frames", "", &elsewhere)?;
        }
        if let Some(changed) = self.changed_target {
            line(f, "ends nearer to another object", "", &yes_or_no(changed))?;
        }
        for (label, figure) in FIGURES {
            let of = |summary: &Summary| summary.errors.as_ref().map_or_else(none, figure);
            line(f, label, &of(visible), &of(all))?;
        }
        match &self.confidence.reliability {
            Some(reliability) => self.write_reliability(f, reliability),
            None => Ok(()),
        }
    }
}

impl TargetReport {
    /// Writes one line per bin.
    fn write_reliability(
        &self,
        f: &mut fmt::Formatter<'_>,
        reliability: &Reliability,
    ) -> fmt::Result {
        let diameter_m = self
            .confidence
            .diameter_m
            .map_or_else(none, |d| plain(d).to_string());
        let error = fixed(reliability.calibration_error, 3);
        line(f, "confidence, calibration error", "", &error)?;
        writeln!(
            f,
            "  {:<40} {:>15} {:>15}",
            "    rows", "mean confidence", "right"
        )?;
        for bin in &reliability.bins {
            writeln!(
                f,
                "  {:<40} {:>15} {:>15}",
                format!("    {}", bin.rows),
                fixed(bin.mean_confidence, 3),
                fixed(bin.share_right, 3)
            )?;
        }
        writeln!(
            f,
            "    right: within {diameter_m} m of the object; without an estimate: in view"
        )
    }
}

/// Writes one line of the table of a target.
fn line(f: &mut fmt::Formatter<'_>, label: &str, visible: &str, all: &str) -> fmt::Result {
    let text = format!("  {label:<40} {visible:>15} {all:>15}");
    writeln!(f, "{}", text.trim_end())
}

/// A line's label and the formatter of its figure.
type Figure = (&'static str, fn(&Errors) -> String);

/// The lines about errors, in order.
const FIGURES: [Figure; 29] = [
    ("position error, mean, mm", |e| {
        thousandths(e.position_m.mean)
    }),
    ("    s.d.", |e| thousandths(e.position_m.sd)),
    ("    root mean square", |e| thousandths(e.position_m.rmse)),
    ("    median", |e| thousandths(e.position_m.median)),
    ("    95 % below", |e| thousandths(e.position_m.p95)),
    ("    maximum", |e| thousandths(e.position_m.max)),
    ("    best particle, mean, mm", |e| {
        e.best_position_m
            .map_or_else(none, |best| thousandths(best.mean))
    }),
    ("    best particle, root mean square", |e| {
        e.best_position_m
            .map_or_else(none, |best| thousandths(best.rmse))
    }),
    ("over x and y alone, mean, mm", |e| {
        thousandths(e.planar_m.mean)
    }),
    ("    s.d.", |e| thousandths(e.planar_m.sd)),
    ("    root mean square", |e| thousandths(e.planar_m.rmse)),
    ("bias along x, mm", |e| thousandths(e.bias_m[0])),
    ("    y", |e| thousandths(e.bias_m[1])),
    ("    z", |e| thousandths(e.bias_m[2])),
    ("distance error, mean ± s.d., mm", |e| {
        mean_sd(e.distance_m)
    }),
    ("elevation error, mean ± s.d., mrad", |e| {
        mean_sd(e.elevation_rad)
    }),
    ("azimuth error, mean ± s.d., mrad", |e| {
        mean_sd(e.azimuth_rad)
    }),
    ("direction error, mean (max), mrad", |e| {
        format!(
            "{} ({})",
            thousandths(e.direction_mean_rad),
            thousandths(e.direction_max_rad)
        )
    }),
    ("velocity error, root mean square, mm/s", |e| {
        e.velocity_rmse_mps.map_or_else(none, thousandths)
    }),
    ("velocity NEES, mean (expected)", |e| {
        e.velocity_consistency.as_ref().map_or_else(none, mean_nees)
    }),
    ("    within 95 % bound", |e| {
        e.velocity_consistency.as_ref().map_or_else(none, within_95)
    }),
    ("course error while it moves, median, mrad", |e| {
        e.course
            .map_or_else(none, |c| thousandths(c.error_median_rad))
    }),
    ("heading error, median, degrees", |e| {
        e.heading.map_or_else(none, |h| degrees(h.error_median_rad))
    }),
    ("    95 % below", |e| {
        e.heading.map_or_else(none, |h| degrees(h.error_p95_rad))
    }),
    ("    bias", |e| {
        e.heading.map_or_else(none, |h| degrees(h.bias_rad))
    }),
    ("NEES, mean (expected)", |e| mean_nees(&e.consistency)),
    ("    99 % band of the mean", |e| {
        let band = e.consistency.mean_nees_band_99;
        let shown = |[low, high]: [f64; 2]| format!("{} to {}", nees(low), nees(high));
        band.map_or_else(none, shown)
    }),
    ("    within 95 % bound", |e| within_95(&e.consistency)),
    ("    left out, no covariance", |e| {
        e.consistency.left_out.to_string()
    }),
];

/// Formats metres in millimetres, or radians in milliradians.
fn thousandths(value: f64) -> String {
    fixed(1e3 * value, 1)
}

/// Formats radians in degrees.
fn degrees(angle_rad: f64) -> String {
    fixed(angle_rad.to_degrees(), 2)
}

/// Formats the mean NEES and what is expected of it.
fn mean_nees(found: &Consistency) -> String {
    let both = found.mean_nees.zip(found.expected_nees);
    both.map_or_else(none, |(mean, expected)| {
        format!("{} ({})", nees(mean), fixed(expected, 1))
    })
}

/// Formats the share of the estimates within the 95 % chi-square bound.
fn within_95(found: &Consistency) -> String {
    let share = found.share_within_95;
    share.map_or_else(none, |share| format!("{} %", fixed(100.0 * share, 1)))
}

/// Formats a NEES; with zero covariances it can be arbitrarily large.
fn nees(mean: f64) -> String {
    if mean < 1e6 {
        fixed(mean, 2)
    } else {
        format!("{mean:.1e}")
    }
}

/// Formats mean and standard deviation in thousandths.
fn mean_sd(value: MeanSd) -> String {
    format!("{} ± {}", thousandths(value.mean), thousandths(value.sd))
}

/// Returns the placeholder for a missing figure.
fn none() -> String {
    "-".to_owned()
}
