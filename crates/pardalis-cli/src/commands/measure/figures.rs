//! Figures over several runs.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_evaluate::spherical_error;
use pardalis_scene::experiment::{Figure, FigureKind};

use super::digits::median;
use super::plan::Measured;
use super::pooled::reliability_of;
use crate::draw::camera_symbol::CameraSymbol;
use crate::draw::errors::{ErrorGroup, SphericalError, write_error_figures};
use crate::draw::paths::{PathGroup, write_path_figures};
use crate::draw::plots::TrackSeries;
use crate::draw::reliability::{ReliabilityGroup, write_reliability_figures};
use crate::draw::sweep::{SweepPoint, SweepSeries, write_sweep_figures};
use crate::output::Shown;
use crate::user_error::user_error;

/// Draws the figures of an experiment into a folder, except those without any run (with `--verify`). Returns the files.
pub(super) fn draw_all(
    figures: &[Figure],
    measured: &[Measured],
    folder: &Path,
) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for figure in figures {
        let shown = measured.iter().filter(|m| figure.shows(m.plan.run));
        let shown: Vec<_> = shown.collect();
        if shown.is_empty() {
            continue;
        }
        files.extend(match figure.kind {
            FigureKind::Paths => paths(figure, &shown, folder),
            FigureKind::Errors => errors(figure, &shown, folder),
            FigureKind::Sweep => sweep(figure, &shown, folder),
            FigureKind::Reliability => reliability(figure, &shown, folder),
        }?);
    }
    Ok(files)
}

/// Copies the PNG files among them.
pub(super) fn copy_pngs(files: &[PathBuf], folder: &Path) -> Result<()> {
    let refuse = |error| {
        user_error!(
            "--figures {}: {error}; choose a folder with write permission",
            folder.shown()
        )
    };
    fs::create_dir_all(folder).map_err(refuse)?;
    for file in files {
        if let (Some(name), Some("png")) = (
            file.file_name(),
            file.extension().and_then(|ending| ending.to_str()),
        ) {
            fs::copy(file, folder.join(name)).map_err(refuse)?;
        }
    }
    Ok(())
}

/// Draws the seeds of all runs, one group per run and target, with the truth and the cameras of the first run.
fn paths(figure: &Figure, shown: &[&Measured], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut groups = Vec::new();
    for Measured { plan, .. } in shown {
        let tracks = plan.tracks(figure.seeds.unwrap_or(u32::MAX))?;
        let targets = &plan.scene().targets;
        for target in targets {
            let name = match &targets[..] {
                [_] => plan.run.name.clone(),
                _ => format!("{}: {}", plan.run.name, target.name),
            };
            let is_its = |track: &&TrackSeries| {
                let rest = track.name.strip_prefix(&target.name);
                let is_member = |rest: &str| rest.starts_with('-') && target.crowd.is_some();
                rest.is_some_and(|rest| rest.is_empty() || is_member(rest))
            };
            let tracks = tracks.iter().filter(is_its);
            groups.push(PathGroup {
                name,
                tracks: tracks.cloned().collect(),
            });
        }
    }
    let first = shown[0].plan;
    let truth = first.truth(&shown[0].figures)?;
    let cameras = CameraSymbol::of_scene(first.scene());
    let far = figure.reaches_far;
    write_path_figures(folder, &figure.name, &groups, &truth, &cameras, far)
}

/// Draws one mark per frame, seed and target, relative to the runs' origins.
fn errors(figure: &Figure, shown: &[&Measured], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut groups = Vec::new();
    for Measured { plan, .. } in shown {
        let mut errors = Vec::new();
        for report in plan.reports(&plan.options())? {
            let around_m = report.around.position_m;
            let samples = report.targets.iter().flat_map(|target| &target.samples);
            errors.extend(samples.filter_map(|sample| {
                let error = spherical_error(&sample.estimate?, &sample.truth, around_m);
                Some(SphericalError {
                    distance_m: error.true_distance_m,
                    distance_error_m: error.distance_m,
                    elevation_error_rad: error.elevation_rad,
                    azimuth_error_rad: error.azimuth_rad,
                })
            }));
        }
        groups.push(ErrorGroup {
            name: plan.run.name.clone(),
            errors,
        });
    }
    write_error_figures(folder, &figure.name, &groups)
}

/// Draws one series per sweep with a point per run: median, lowest and highest value over seeds and targets.
fn sweep(figure: &Figure, shown: &[&Measured], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut series: Vec<SweepSeries> = Vec::new();
    for Measured { plan, figures, .. } in shown {
        let Some(swept) = &plan.run.swept else {
            continue;
        };
        let sorted = |metric: &str| {
            let whole = figures.iter().filter(|f| f.window.is_empty());
            let mut values: Vec<f64> = whole.filter_map(|f| f.value(metric)).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let lengths_m = sorted(&figure.figure);
        let (Some(lowest_m), Some(highest_m)) = (lengths_m.first(), lengths_m.last()) else {
            continue;
        };
        let times_ms = sorted("ms_a_frame");
        let point = SweepPoint {
            label: swept.label.clone(),
            value: swept.value,
            ms_a_frame: (!times_ms.is_empty()).then(|| median(&times_ms)),
            median_m: median(&lengths_m),
            lowest_m: *lowest_m,
            highest_m: *highest_m,
        };
        match series.iter_mut().find(|one| one.name == swept.sweep) {
            Some(one) => one.points.push(point),
            None => series.push(SweepSeries {
                name: swept.sweep.clone(),
                points: vec![point],
            }),
        }
    }
    let key = shown.iter().find_map(|m| m.plan.run.swept.as_ref());
    let x_name = figure.x_name.as_ref().or(key.map(|swept| &swept.key));
    let x_name = x_name.map_or("", |name| name);
    write_sweep_figures(folder, &figure.name, x_name, &series)
}

/// Draws one group per run or sweep over all its frames, seeds and targets; those without confidences are left out.
fn reliability(figure: &Figure, shown: &[&Measured], folder: &Path) -> Result<Vec<PathBuf>> {
    let of_one = |name: &String| {
        let is_of = |m: &&&Measured| m.name() == name || m.plan.run.name == *name;
        let runs: Vec<&Measured> = shown.iter().filter(is_of).copied().collect();
        Some(ReliabilityGroup {
            name: name.clone(),
            reliability: reliability_of(&runs)?,
        })
    };
    let groups: Vec<_> = figure.runs.iter().filter_map(of_one).collect();
    write_reliability_figures(folder, &figure.name, &groups)
}
