//! What pixels near an outline say, as correspondence lines sum it.

use super::EdgeTuning;
use super::frame::Octave;
use crate::color::{EdgeLogRatios, EdgeProfile, Side};
use pardalis_core::simd::{Level, to_index};

/// The reach of lines either way, in pixels. Hand-set: positions off by more are found by the next round of the fit.
pub(super) const REACH_PX: f32 = 5.0;
/// The shifts of a line: a quarter of a pixel apart, as the distances of edge profiles. Derivation: 2 · 5 px · 4 + 1.
pub(super) const SHIFTS: usize = 41;
pub(super) const SHIFTS_A_PX: usize = 4;
/// The band of pixels that are looked at, signed distances from the outline in pixels: reach plus the colours of either side. Hand-set.
pub(super) const BAND_PX: std::ops::RangeInclusive<f32> = -9.0..=8.0;
/// The quarters of a pixel across the band. Derivation: 4 · (8 + 9).
const BAND_STEPS: usize = (*BAND_PX.end() - *BAND_PX.start()) as usize * SHIFTS_A_PX;

// The innermost pixel of the band lies at the end of the profile if the outline is shifted inwards as far as lines reach.
const _: () = assert!(*BAND_PX.start() == -(REACH_PX + EdgeProfile::REACH_PX));

/// Log-ratios over the distance, the farthest first. Beyond the profile they stay as they are at its ends, so that those of a pixel for all shifts
/// of the outline lie side by side wherever in the band it is.
type Row = [f32; BAND_STEPS + SHIFTS + 1];

/// The place in a row of a step of the profile.
const fn place(step: usize) -> usize {
    BAND_STEPS + 1 - step
}

/// The log-ratios of pixels in one octave.
#[derive(Debug)]
pub(super) struct Table {
    /// Of pixels in other colours and in the target's, on either side of the body, in each bin of membership; the last is for pixels without.
    rows: [[Vec<Row>; 2]; 2],
    level: Level,
}

impl Table {
    pub(super) fn new(
        by_distance: &[Box<EdgeLogRatios>; 2],
        octave: Octave,
        tuning: &EdgeTuning,
        level: Level,
    ) -> Self {
        let rows = [false, true].map(|matches| {
            by_distance.each_ref().map(|by_distance| {
                let log_ratio = |bin: usize, step: usize| {
                    let distance_px = 0.25 * step as f64 - f64::from(EdgeProfile::REACH_PX);
                    let of_region = region_log_ratio(matches, distance_px, octave, tuning) as f32;
                    by_distance[step].get(bin).copied().unwrap_or(0.0) + of_region
                };
                let row = |bin: usize| {
                    std::array::from_fn(|at| {
                        let step = place(0).saturating_sub(at);
                        log_ratio(bin, step.min(EdgeProfile::DISTANCES - 1))
                    })
                };
                (0..=EdgeProfile::MEMBERSHIPS).map(row).collect()
            })
        });
        Self { rows, level }
    }

    /// The instruction set with which log-ratios are summed.
    pub(super) fn level(&self) -> Level {
        self.level
    }

    /// The row of a pixel.
    #[inline(always)]
    fn row(&self, (matches, side, membership): (bool, Side, f32)) -> &Row {
        let bin = if membership.is_nan() {
            EdgeProfile::MEMBERSHIPS
        } else {
            EdgeProfile::bin_of(membership)
        };
        &self.rows[usize::from(matches)][side as usize][bin]
    }

    /// Adds the log-ratios of a pixel of the band for all shifts of the outline. Shifts are as far apart as the profile's distances.
    #[inline(always)]
    pub(super) fn add(
        &self,
        pixel: (bool, Side, f32),
        distance_px: f32,
        log_ratios: &mut [f32; SHIFTS],
    ) {
        let row = self.row(pixel);
        let steps = SHIFTS_A_PX as f32 * (distance_px - BAND_PX.start());
        let first = to_index(steps, BAND_STEPS as u16);
        let part = steps - first as f32;
        let row = &row[place(first + 1)..][..=SHIFTS];
        for (i, log_ratio) in log_ratios.iter_mut().enumerate() {
            *log_ratio += row[i + 1] + part * (row[i] - row[i + 1]);
        }
    }

    /// Adds the log-ratios of a pixel of a streak for all shifts of the outline. `at_rest_px` returns, for a shift in pixels, the distance from a body at rest that has the
    /// same mixture; it is asked for whole pixels and interpolated.
    pub(super) fn add_streak(
        &self,
        pixel: (bool, Side, f32),
        at_rest_px: impl Fn(f32) -> f32,
        log_ratios: &mut [f32; SHIFTS],
    ) {
        const WHOLE: usize = (SHIFTS - 1) / SHIFTS_A_PX;
        let row = self.row(pixel);
        let at_whole_px: [f32; WHOLE + 1] =
            std::array::from_fn(|shift| at_rest_px(shift as f32 - REACH_PX));
        self.level.run(
            #[inline(always)]
            || {
                let mut steps = [0_f32; SHIFTS];
                for i in 0..SHIFTS - 1 {
                    let share = (i % SHIFTS_A_PX) as f32 / SHIFTS_A_PX as f32;
                    let [from_px, to_px] = [0, 1].map(|next| at_whole_px[i / SHIFTS_A_PX + next]);
                    steps[i] = from_px + share * (to_px - from_px);
                }
                steps[SHIFTS - 1] = at_whole_px[WHOLE];
                let last = (EdgeProfile::DISTANCES - 1) as f32;
                for step in &mut steps {
                    let profile_px = *step + EdgeProfile::REACH_PX;
                    *step = (SHIFTS_A_PX as f32 * profile_px).clamp(0.0, last);
                }
                for (log_ratio, step) in log_ratios.iter_mut().zip(steps) {
                    let first = to_index(step, EdgeProfile::DISTANCES as u16 - 1);
                    let [here, next] = [first, first + 1].map(|step| row[place(step)]);
                    *log_ratio += here + (step - first as f32) * (next - here);
                }
            },
        );
    }
}

/// The log-ratio of a pixel by whether it is in the target's colours, in nats: at most 0, and 0 near the outline and on the side where it belongs.
fn region_log_ratio(matches: bool, distance_px: f64, octave: Octave, tuning: &EdgeTuning) -> f64 {
    let mixed_px = if octave > Octave::default() {
        tuning.coarse_mixed_px
    } else {
        tuning.mixed_px
    };
    let beyond = |px: f64| (px - mixed_px).clamp(0.0, 1.0);
    if matches {
        -tuning.target_outside_nats * beyond(distance_px)
    } else {
        -tuning.other_inside_nats * beyond(-distance_px)
    }
}
