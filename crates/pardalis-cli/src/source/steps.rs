//! Time stamps of live sources on their way through ffmpeg, which delivers frames at once only if they increase.

/// A time base in seconds of which those of cameras and streams are multiples: 1/90000, 1/1000000 and 1001/30000.
pub(super) const TIME_BASE: (i64, i64) = (1, 9_000_000);

/// What the time stamps of live sources grow by at a frame whose own is missing or does not increase, in ticks of
/// [`TIME_BASE`]; see [`Steps`]. `MISSING` is 0.1 ms, `SMALL` 36 hours and `LARGE` 136 years.
mod step {
    pub(super) const MISSING: i64 = 1 << 10;
    pub(super) const SMALL: i64 = 131_072 * 9_000_000;
    pub(super) const LARGE: i64 = 4_294_967_296 * 9_000_000;
}

/// Where the time stamps begin if the first is missing, in seconds: before those of all clocks, and within what a NUT stream can have.
const START_S: i64 = -(1 << 19);

/// Makes time stamps increase before ffmpeg writes them, since it changes those that do not, and restores them afterwards. Recordings get increasing stamps
/// of decoding instead, but the filter for these holds each frame until the next one arrives.
///
/// - A missing stamp becomes the previous one plus [`step::MISSING`].
/// - If a stamp is not at least twice that later than the previous one, it and all later ones grow by [`step::SMALL`]; by [`step::LARGE`] if it is earlier by
///   half a small step or more.
/// - So a stamp that is half a step or more later than the previous one contains a step: clocks are rarely set forward by 18 hours.
#[derive(Debug, Default)]
pub(super) struct Steps {
    /// The last time stamp as ffmpeg writes it, in ticks.
    last: Option<i64>,
    /// The sum of small and large steps.
    sum: i64,
}

impl Steps {
    /// Returns ffmpeg's filters that make the time stamps increase. Variable 0 is the sum of steps.
    pub(super) fn filter() -> String {
        let (numerator, denominator) = TIME_BASE;
        let (missing, small, large) = (step::MISSING, step::SMALL, step::LARGE);
        let start = START_S * denominator;
        let last = format!("if(isnan(PREV_OUTPTS),{start},PREV_OUTPTS)");
        let back = format!("(PREV_OUTPTS+{}-PTS-ld(0))", 2 * missing);
        let step = format!(
            "if(gt({back},0),if(lt({back},{}),{small},{large}),0)",
            small / 2
        );
        let increasing = format!("PTS+st(0,ld(0)+if(isnan(PREV_OUTPTS),0,{step}))");
        format!(
            "settb={numerator}/{denominator},setpts='if(isnan(PTS),{last}+{missing},{increasing})'"
        )
    }

    /// Returns the time stamp of a frame before this filter, in ticks; `None` if it has none.
    pub(super) fn undone(&mut self, ticks: i64) -> Option<i64> {
        let start = START_S * TIME_BASE.1;
        let last = self.last.replace(ticks).unwrap_or(start);
        let later = ticks.saturating_sub(last);
        // ffmpeg computes with floating point numbers, so that long sums are rounded.
        if (0..step::MISSING * 3 / 2).contains(&later) {
            return None;
        }
        // Otherwise all stamps before have been missing.
        let has_last = last > start / 2;
        let made = |step: &i64| has_last && later >= step / 2;
        let step = [step::LARGE, step::SMALL].into_iter().find(made);
        self.sum = self.sum.saturating_add(step.unwrap_or(0));
        Some(ticks.saturating_sub(self.sum))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_time_stamps_are_undone() {
        let (hour, ms) = (3600 * 9_000_000, 9_000);
        let since_1970 = 1_800_000_000 * 9_000_000;
        for (name, stamps) in [
            ("regular", vec![Some(0), Some(40 * ms), Some(80 * ms)]),
            ("negative", vec![Some(-40 * ms), Some(0)]),
            ("equal", vec![Some(0), Some(0), Some(0), Some(40 * ms)]),
            ("reordered", vec![Some(0), Some(-40 * ms), Some(40 * ms)]),
            ("too close", vec![Some(0), Some(step::MISSING), Some(ms)]),
            (
                "set back",
                vec![Some(since_1970), Some(since_1970 - 17 * hour)],
            ),
            (
                "set back far",
                vec![Some(since_1970), Some(0), Some(40 * ms)],
            ),
            (
                "set forward",
                vec![Some(0), Some(17 * hour), Some(17 * hour + ms)],
            ),
            (
                "missing",
                vec![Some(0), None, None, Some(40 * ms), Some(80 * ms)],
            ),
            ("missing first", vec![None, None, Some(0), Some(40 * ms)]),
            (
                "missing and equal",
                vec![Some(ms), None, Some(ms), None, Some(2 * ms)],
            ),
        ] {
            let (mut sum, mut last) = (0, None);
            // As ffmpeg computes the filter.
            let written = stamps.iter().map(|stamp| {
                let back =
                    |stamp: i64| last.map_or(0, |last| last + 2 * step::MISSING - stamp - sum);
                let ticks = match *stamp {
                    None => last.unwrap_or(START_S * TIME_BASE.1) + step::MISSING,
                    Some(stamp) => {
                        sum += match back(stamp) {
                            ..=0 => 0,
                            back if back < step::SMALL / 2 => step::SMALL,
                            _ => step::LARGE,
                        };
                        stamp + sum
                    }
                };
                assert!(last.is_none_or(|last| last < ticks), "{name}");
                last = Some(ticks);
                ticks
            });
            let mut steps = Steps::default();
            let found: Vec<_> = written.map(|ticks| steps.undone(ticks)).collect();
            assert_eq!(found, stamps, "{name}");
        }
    }
}
