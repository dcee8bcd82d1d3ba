//! Colours as ranges of hue, saturation and intensity (Barrera 2005, section II.B), and lookup tables of the
//! pixels inside them.

use serde::{Deserialize, Serialize};

use super::palette::PixelKind;
use crate::color_space::hsi_from_rgb;
use pardalis_core::Error;

/// The colours of a target as closed ranges.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorRanges {
    /// Hue range in degrees, 0 to 360; `[340, 20]` is the range through 0.
    pub hue_deg: [f64; 2],
    /// Minimum and maximum saturation, 0 to 1.
    pub saturation: [f64; 2],
    /// Minimum and maximum intensity, 0 to 1; darker and brighter pixels never match.
    pub intensity: [f64; 2],
}

impl ColorRanges {
    /// Intensities, 0 to 1, that are neither too dark nor too bright for a meaningful hue and saturation. Hand-set.
    pub const INTENSITY: [f64; 2] = [0.1, 0.9];

    /// Checks the ranges.
    ///
    /// # Errors
    ///
    /// A number is outside its domain, or a minimum exceeds its maximum (except for the hue).
    pub fn check(&self) -> Result<(), Error> {
        let refuse = |name, value: [f64; 2], allowed| {
            Err(Error::out_of_range(name, format!("{value:?}"), allowed))
        };
        if !self.hue_deg.iter().all(|h| (0.0..=360.0).contains(h)) {
            let allowed = "two numbers from 0 to 360, where [340, 20] is the range through 0";
            return refuse("hue_deg", self.hue_deg, allowed);
        }
        for (name, range) in [
            ("saturation", self.saturation),
            ("intensity", self.intensity),
        ] {
            let [least, greatest] = range;
            if !(0.0 <= least && least <= greatest && greatest <= 1.0) {
                return refuse(name, range, "two numbers from 0 to 1, the lesser first");
            }
        }
        Ok(())
    }

    /// Returns wider ranges, which hold the same colours under other illumination and noise: 5° more hue on
    /// either side, and more saturation and intensity.
    #[must_use]
    pub fn widened(&self) -> Self {
        /// Degrees of hue on either side. Hand-set.
        const HUE_DEG: f64 = 5.0;
        /// Saturation and intensity, each from 0 to 1, on either side. Hand-set.
        const SHARE: f64 = 0.12;
        let [from, to] = self.hue_deg;
        let span_deg = (to - from).rem_euclid(360.0) + 2.0 * HUE_DEG;
        let hue_deg = if span_deg < 360.0 {
            [from - HUE_DEG, to + HUE_DEG].map(|hue: f64| hue.rem_euclid(360.0))
        } else {
            [0.0, 360.0]
        };
        let widen =
            |[least, greatest]: [f64; 2]| [(least - SHARE).max(0.0), (greatest + SHARE).min(1.0)];
        Self {
            hue_deg,
            saturation: widen(self.saturation),
            intensity: widen(self.intensity),
        }
    }

    /// Reports whether a colour, R, G, B in 0..=255, lies in all three ranges.
    pub fn contain_rgb(&self, rgb: [f64; 3]) -> bool {
        let [hue, saturation, intensity] = hsi_from_rgb(rgb);
        let hue_deg = 360.0 * hue;
        let within = |value: f64, [least, greatest]: [f64; 2]| (least..=greatest).contains(&value);
        let [from, to] = self.hue_deg;
        let hue_fits = if from <= to {
            within(hue_deg, self.hue_deg)
        } else {
            hue_deg >= from || hue_deg <= to
        };
        hue_fits && within(saturation, self.saturation) && within(intensity, self.intensity)
    }
}

/// Steps per channel in tables and colour counts. Derivation: tables then fit in the cache.
const STEPS: usize = 64;

/// Returns the cell of a pixel's three raw bytes, quantised to multiples of four.
#[inline(always)]
fn cell([a, b, c]: [u8; 3]) -> usize {
    (usize::from(a >> 2) << 12) | (usize::from(b >> 2) << 6) | usize::from(c >> 2)
}

/// Returns R, G, B of the centre of a cell, for pixels of the given kind.
fn rgb_of_cell(kind: PixelKind, cell: usize) -> [f64; 3] {
    let steps = [cell >> 12, cell >> 6 & 63, cell & 63];
    let middle = steps.map(|step| 4.0 * step as f64 + 1.5);
    match kind {
        PixelKind::Rgb => middle,
        PixelKind::Yuv(encoding) => encoding.rgb_from_yuv(middle),
    }
}

/// A lookup table of whether a pixel's three raw bytes lie in the ranges. Bytes are quantised to multiples of
/// four, at one bit per cell, so that the table stays in the L1 cache.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MatchTable {
    bits: Box<[u64; STEPS * STEPS]>,
}

impl MatchTable {
    /// Tabulates ranges for pixels of one kind.
    pub fn new(ranges: &ColorRanges, kind: PixelKind) -> Self {
        let mut bits = Box::new([0_u64; STEPS * STEPS]);
        for cell in 0..STEPS * STEPS * STEPS {
            let matches = ranges.contain_rgb(rgb_of_cell(kind, cell));
            bits[cell >> 6] |= u64::from(matches) << (cell & 63);
        }
        Self { bits }
    }

    /// Returns 1 if the pixel of these raw bytes matches, else 0.
    #[inline(always)]
    pub fn matches(&self, bytes: [u8; 3]) -> u32 {
        let cell = cell(bytes);
        (self.bits[cell >> 6] >> (cell & 63)) as u32 & 1
    }
}

/// Share of a target's pixels that each learnt range leaves out. Hand-set: highlights and wrong labels.
const LEFT_OUT: f64 = 0.02;

/// Counts the colours of labelled pixels to find the ranges that hold them.
#[derive(Debug, Clone)]
pub(super) struct RangeLearner {
    /// Pixel counts of the target in each cell of RGB.
    object: Vec<u32>,
    background: Vec<u32>,
}

impl RangeLearner {
    pub(super) fn new() -> Self {
        let none = vec![0; STEPS * STEPS * STEPS];
        Self {
            object: none.clone(),
            background: none,
        }
    }

    /// Adds a pixel (R, G, B) of the target or of the background.
    pub(super) fn add(&mut self, rgb: [u8; 3], is_object: bool) {
        let counts = if is_object {
            &mut self.object
        } else {
            &mut self.background
        };
        counts[cell(rgb)] += 1;
    }

    /// Returns the narrowest ranges that each hold 98 % of the target's pixels; `None` if all pixels are
    /// grey.
    pub(super) fn ranges(&self) -> Option<ColorRanges> {
        // Histograms in whole degrees, and in steps of 1/256.
        let (mut hues, mut saturations, mut intensities) = ([0; 360], [0; 256], [0; 256]);
        let step = |share: f64, steps: usize| ((share * steps as f64) as usize).min(steps - 1);
        for (cell, &count) in self
            .object
            .iter()
            .enumerate()
            .filter(|(_, count)| **count > 0)
        {
            let [hue, saturation, intensity] = hsi_from_rgb(rgb_of_cell(PixelKind::Rgb, cell));
            // Grey has no hue.
            hues[step(hue, 360)] += u64::from(count) * u64::from(saturation > 0.0);
            saturations[step(saturation, 256)] += u64::from(count);
            intensities[step(intensity, 256)] += u64::from(count);
        }
        let share = |counts: &[u64; 256]| {
            let (first, last) = narrowest(counts, false)?;
            Some([first as f64 / 256.0, (last + 1) as f64 / 256.0])
        };
        let (first, last) = narrowest(&hues, true)?;
        Some(ColorRanges {
            // The upper end of the last degree; 359 ends at 0.
            hue_deg: [first as f64, ((last + 1) % 360) as f64],
            saturation: share(&saturations)?,
            intensity: share(&intensities)?,
        })
    }

    /// Returns the shares of the target's pixels and of the background's that lie in the ranges.
    pub(super) fn shares(&self, ranges: &ColorRanges) -> [f64; 2] {
        let table = MatchTable::new(ranges, PixelKind::Rgb);
        [&self.object, &self.background].map(|counts| {
            let (mut matching, mut total) = (0, 0);
            for (cell, &count) in counts.iter().enumerate() {
                matching += u64::from(count) * (table.bits[cell >> 6] >> (cell & 63) & 1);
                total += u64::from(count);
            }
            matching as f64 / total.max(1) as f64
        })
    }
}

/// Returns the first and last step of the shortest run that leaves out at most [`LEFT_OUT`] of the counts, on
/// a circle or between the ends.
fn narrowest(counts: &[u64], circle: bool) -> Option<(usize, usize)> {
    let total: u64 = counts.iter().sum();
    let needed = total - (LEFT_OUT * total as f64) as u64;
    if total == 0 {
        return None;
    }
    let steps = counts.len();
    let count = |step: usize| counts[step % steps];
    // A sliding window over the steps, around twice on a circle.
    let (mut held, mut end) = (0, 0);
    let mut best: Option<(usize, usize)> = None;
    for first in 0..steps {
        let furthest = if circle { first + steps } else { steps };
        while held < needed && end < furthest {
            held += count(end);
            end += 1;
        }
        if held < needed {
            break;
        }
        if best.is_none_or(|(a, b)| end - first < b - a) {
            best = Some((first, end));
        }
        held -= count(first);
    }
    best.map(|(first, end)| (first, (end - 1) % steps))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{YuvEncoding, YuvMatrix, YuvRange};

    const PINK: ColorRanges = ColorRanges {
        hue_deg: [330.0, 15.0],
        saturation: [0.3, 1.0],
        intensity: [0.1, 0.9],
    };

    #[test]
    fn hue_wraps_and_dark_bright_or_pale_pixels_never_match() {
        for (rgb, expected) in [
            ([230.0, 60.0, 110.0], true),
            ([230.0, 80.0, 70.0], true),
            ([230.0, 120.0, 40.0], false),
            ([60.0, 60.0, 230.0], false),
            ([30.0, 8.0, 14.0], false),
            ([255.0, 246.0, 250.0], false),
            ([200.0, 170.0, 180.0], false),
            ([90.0, 90.0, 90.0], false),
        ] {
            assert_eq!(PINK.contain_rgb(rgb), expected, "{rgb:?}");
        }
        let not_through_zero = ColorRanges {
            hue_deg: [15.0, 330.0],
            ..PINK
        };
        assert!(!not_through_zero.contain_rgb([230.0, 60.0, 110.0]));
        assert!(not_through_zero.contain_rgb([60.0, 60.0, 230.0]));
    }

    #[test]
    fn tables_agree_with_the_centres_of_their_cells() {
        let video = YuvEncoding {
            matrix: YuvMatrix::Bt709,
            range: YuvRange::Limited,
        };
        for kind in [PixelKind::Rgb, PixelKind::Yuv(video)] {
            let table = MatchTable::new(&PINK, kind);
            let mut found = 0;
            for n in 0..4096_u32 {
                let bytes = [n * 37 % 251, n * 91 % 253, n * 59 % 256].map(|b| b as u8);
                let middle = bytes.map(|b| f64::from(b / 4 * 4) + 1.5);
                let rgb = match kind {
                    PixelKind::Rgb => middle,
                    PixelKind::Yuv(encoding) => encoding.rgb_from_yuv(middle),
                };
                assert_eq!(table.matches(bytes) == 1, PINK.contain_rgb(rgb));
                found += table.matches(bytes);
            }
            assert!(found > 20, "{found} colours match");
        }
    }

    #[test]
    fn learnt_ranges_are_narrow_and_ignore_outliers() {
        let mut learner = RangeLearner::new();
        assert_eq!(learner.ranges(), None);
        // Hues from 350° to 10°; one pixel in a hundred is far from them.
        for n in 0..1000 {
            let hue = f64::from(n % 21 + 350) % 360.0;
            let x = (200.0 * (1.0 - (hue / 60.0 % 2.0 - 1.0).abs())) as u8;
            let pink = if hue < 60.0 {
                [220, 20 + x, 20]
            } else {
                [220, 20, 20 + x]
            };
            let green = [20, 220, 20];
            learner.add(if n % 100 == 50 { green } else { pink }, true);
            learner.add(if n % 4 == 0 { pink } else { green }, false);
        }
        let ranges = learner.ranges().unwrap();
        let [from, to] = ranges.hue_deg;
        assert!((348.0..=351.0).contains(&from), "{ranges:?}");
        assert!((9.0..=13.0).contains(&to), "{ranges:?}");
        let [found, mistaken] = learner.shares(&ranges);
        assert!(
            found > 0.97 && (mistaken - 0.25).abs() < 0.01,
            "{found} {mistaken}"
        );
        assert!(ranges.check().is_ok());
        let table = MatchTable::new(&ranges, PixelKind::Rgb);
        let matches = [[220, 20, 30], [20, 220, 20]].map(|rgb| table.matches(rgb));
        assert_eq!(matches, [1, 0]);
    }

    #[test]
    fn widened_ranges_wrap_through_zero_and_stay_valid() {
        let wide = PINK.widened();
        assert_eq!(wide.hue_deg, [325.0, 20.0]);
        assert!(wide.check().is_ok());
        let around = ColorRanges {
            hue_deg: [3.0, 358.0],
            ..PINK
        };
        assert_eq!(around.widened().hue_deg, [0.0, 360.0]);
        let low = ColorRanges {
            hue_deg: [2.0, 30.0],
            ..PINK
        };
        assert_eq!(low.widened().hue_deg, [357.0, 35.0]);
    }

    #[test]
    fn invalid_ranges_are_rejected() {
        for (ranges, name) in [
            (
                ColorRanges {
                    hue_deg: [-1.0, 20.0],
                    ..PINK
                },
                "hue_deg",
            ),
            (
                ColorRanges {
                    saturation: [0.6, 0.3],
                    ..PINK
                },
                "saturation",
            ),
            (
                ColorRanges {
                    intensity: [0.0, f64::NAN],
                    ..PINK
                },
                "intensity",
            ),
        ] {
            let message = ranges.check().unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
        assert!(PINK.check().is_ok());
    }
}
