//! Starts from a track of another robot or of an earlier run.

use std::path::Path;

use anyhow::Result;
use pardalis_filter::gaussian::GaussianStart;
use pardalis_scene::TrackStart;

use crate::output::Shown;
use crate::tables;
use crate::user_error::user_error;

/// Maximum age of an estimate in seconds before the first frame; after a longer time, the target could be anywhere.
const MAX_AGE_S: f64 = 10.0;

/// Returns the track's last estimate at or before the first frame, transformed into the scene's world, and its time in
/// seconds.
/// Errors: the file is not a track, lacks the target, or has no estimate of it in the last seconds before that frame.
pub(crate) fn read(
    start: &TrackStart,
    path: &Path,
    first_time_s: Option<f64>,
) -> Result<(GaussianStart, f64)> {
    let name = path.shown();
    let tracks = tables::read_tracks(path)?;
    let Some(track) = tracks.iter().find(|track| track.name == start.target) else {
        let names: Vec<&str> = tracks.iter().map(|track| &*track.name).collect();
        return Err(user_error!(
            "{name}: has no target \"{}\"; allowed: {}",
            start.target,
            names.join(", ")
        ));
    };
    // If no frame can be read, tracking reports it; this function checks only the track.
    let first_time_s = first_time_s.unwrap_or(f64::INFINITY);
    let before = track
        .rows
        .iter()
        .rev()
        .filter(|(time_s, _)| *time_s <= first_time_s)
        .find_map(|(time_s, row)| Some((time_s, row.estimate?)));
    let Some((time_s, estimate)) = before else {
        return Err(user_error!(
            "{name}: has no estimate of \"{}\" at or before the first frame, at {first_time_s} s; give a track that begins before, \
             or set time_offset_s if the clocks differ",
            start.target
        ));
    };
    let age_s = first_time_s - time_s;
    if age_s.is_finite() && age_s > MAX_AGE_S {
        return Err(user_error!(
            "{name}: the last estimate of \"{}\" before the first frame, at {first_time_s} s, is of {time_s} s; \
             allowed: at most {MAX_AGE_S} s older; set time_offset_s if the clocks differ",
            start.target
        ));
    }
    let Some(covariance_m2) = estimate.covariance_m2 else {
        return Err(user_error!(
            "{name}: the estimate of \"{}\" at {time_s} s has no covariance; needed: the columns xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2",
            start.target
        ));
    };
    let variances_m2ps2 = estimate
        .velocity_covariance_m2ps2
        .map(|[xx, _, _, yy, _, zz]| [xx, yy, zz]);
    if variances_m2ps2.is_some_and(|variances| variances.iter().any(|v| *v < 0.0)) {
        return Err(user_error!(
            "{name}: the estimate of \"{}\" at {time_s} s has a negative variance of the velocity; needed: 0 or more in vxx_m2ps2, vyy_m2ps2 and vzz_m2ps2",
            start.target
        ));
    }
    let stated_mps = variances_m2ps2.map(|variances| variances.map(f64::sqrt));
    let given_mps = start.velocity_sigma_mps.map(|sigma_mps| [sigma_mps; 3]);
    let there = GaussianStart {
        position_m: estimate.position_m,
        covariance_m2,
        velocity_mps: estimate.velocity_mps.unwrap_or_default(),
        velocity_sigma_mps: (given_mps.or(stated_mps)).unwrap_or(GaussianStart::VELOCITY_SIGMA_MPS),
    };
    let here = there.moved(&start.world_from_other);
    here.check().map_err(|error| {
        user_error!(
            "{name}: the estimate of \"{}\" at {time_s} s cannot be used as a start: {error}",
            start.target
        )
    })?;
    Ok((here, *time_s))
}
