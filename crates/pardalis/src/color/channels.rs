//! Per-channel histograms of red, green and blue (Campos 2009, section 3.2), and lookup tables from pixels to
//! channel bins.

use std::fmt::Write as _;

use serde::Deserialize;

use super::palette::PixelKind;
use crate::color_space::YuvEncoding;
use pardalis_core::Error;

/// Number of steps in which a channel is counted. Derivation: the most bins that a histogram may have.
const STEPS: usize = 64;

/// Counts per step of red, green and blue.
type Counts = [[u64; STEPS]; 3];

/// The number of equal bins per channel: 2, 4, 8, 16, 32 or 64.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelBins(usize);

impl ChannelBins {
    /// The default of cues: 16. Hand-set: wide enough for the noise of cameras.
    pub const DEFAULT: Self = Self(16);

    /// Checks a number of bins.
    ///
    /// # Errors
    ///
    /// The number is not 2, 4, 8, 16, 32 or 64.
    pub fn new(bins: usize) -> Result<Self, Error> {
        if (2..=STEPS).contains(&bins) && bins.is_power_of_two() {
            Ok(Self(bins))
        } else {
            Err(Error::out_of_range("bins", bins, "2, 4, 8, 16, 32 or 64"))
        }
    }

    /// Returns the number of bins per channel.
    pub fn count(self) -> usize {
        self.0
    }
}

/// Histograms of a target's pixels, and of the other pixels of its images, in 64 equal steps of red, green
/// and blue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelHistograms {
    object: Counts,
    background: Counts,
}

impl ChannelHistograms {
    pub(super) const EMPTY: Self = Self {
        object: [[0; STEPS]; 3],
        background: [[0; STEPS]; 3],
    };

    /// Adds a pixel (R, G, B) of the target or of the background.
    pub(super) fn add(&mut self, rgb: [u8; 3], is_object: bool) {
        let counts = if is_object {
            &mut self.object
        } else {
            &mut self.background
        };
        for (counts, value) in counts.iter_mut().zip(rgb) {
            counts[usize::from(value) * STEPS / 256] += 1;
        }
    }

    /// Returns the shares of the target's pixels in the bins of red, green and blue; each channel sums to
    /// one.
    pub fn shares(&self, bins: ChannelBins) -> [Vec<f64>; 3] {
        shares(&self.object, bins)
    }

    /// Returns the shares of all other pixels; `None` if the images show only the target.
    pub fn background_shares(&self, bins: ChannelBins) -> Option<[Vec<f64>; 3]> {
        let has_any = self.background[0].iter().any(|&count| count > 0);
        has_any.then(|| shares(&self.background, bins))
    }

    /// Formats the histograms as a section of a colour model file.
    pub(super) fn to_text(&self) -> String {
        let mut text =
            "\n# pixels in each of 64 steps per channel, of the target and of the rest of its images\n[channels]\n"
                .to_owned();
        for (prefix, counts) in [("", &self.object), ("background_", &self.background)] {
            for (channel, counts) in ["red", "green", "blue"].into_iter().zip(counts) {
                let _ = writeln!(text, "{prefix}{channel} = {counts:?}");
            }
        }
        text
    }
}

fn shares(counts: &Counts, bins: ChannelBins) -> [Vec<f64>; 3] {
    counts.each_ref().map(|counts| {
        let total = counts.iter().sum::<u64>() as f64;
        let bins = counts.chunks(STEPS / bins.count());
        bins.map(|steps| steps.iter().sum::<u64>() as f64 / total)
            .collect()
    })
}

/// The section `[channels]` of a colour model file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ChannelsText {
    red: toml::Spanned<Vec<u64>>,
    green: toml::Spanned<Vec<u64>>,
    blue: toml::Spanned<Vec<u64>>,
    background_red: toml::Spanned<Vec<u64>>,
    background_green: toml::Spanned<Vec<u64>>,
    background_blue: toml::Spanned<Vec<u64>>,
}

impl ChannelsText {
    /// Validates the section against the target's pixel count; on failure returns the offset in the text and
    /// the message.
    pub(super) fn read(&self, pixel_count: u64) -> Result<ChannelHistograms, (usize, String)> {
        let object = [&self.red, &self.green, &self.blue];
        let background = [
            &self.background_red,
            &self.background_green,
            &self.background_blue,
        ];
        let background_count = background[0].get_ref().iter().copied();
        let background_count = background_count.fold(0, u64::saturating_add);
        Ok(ChannelHistograms {
            object: counts(object, pixel_count, "pixel_count")?,
            background: counts(background, background_count, "background_red")?,
        })
    }
}

/// Reads three lists that must each sum to `pixel_count`; `source` names the key that gives this number.
fn counts(
    lists: [&toml::Spanned<Vec<u64>>; 3],
    pixel_count: u64,
    source: &str,
) -> Result<Counts, (usize, String)> {
    let mut all = [[0; STEPS]; 3];
    for (counts, list) in all.iter_mut().zip(lists) {
        let refused = |message| Err((list.span().start, message));
        let list = list.get_ref();
        if list.len() != STEPS {
            return refused(format!("{} numbers; expected {STEPS}", list.len()));
        }
        counts.copy_from_slice(list);
        let total = counts.iter().copied().fold(0, u64::saturating_add);
        if total != pixel_count {
            return refused(format!(
                "the counts sum to {total} pixels, but {source} gives {pixel_count}; learn the model again"
            ));
        }
        if total > 1 << 46 {
            return refused(format!("{total} pixels; the maximum is 2^46"));
        }
    }
    Ok(all)
}

/// A lookup table from a pixel's three raw bytes to its bins of red, green and blue, as if it were converted
/// to R, G, B bytes first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelTable {
    /// Low bits of a byte that do not affect the bin.
    shift: u32,
    yuv: Option<Box<RgbOfYuv>>,
}

impl ChannelTable {
    /// Builds the table for pixels of one kind.
    pub fn new(kind: PixelKind, bins: ChannelBins) -> Self {
        Self {
            shift: 8 - bins.count().ilog2(),
            yuv: match kind {
                PixelKind::Rgb => None,
                PixelKind::Yuv(encoding) => Some(Box::new(RgbOfYuv::new(encoding))),
            },
        }
    }

    /// Returns the bins of a pixel's three raw bytes.
    #[inline(always)]
    pub fn bins(&self, components: [u8; 3]) -> [u8; 3] {
        let rgb = match &self.yuv {
            None => components,
            Some(table) => table.rgb(components),
        };
        rgb.map(|value| value >> self.shift)
    }
}

/// Fraction bits of the contribution of a byte.
const FRACTION_BITS: u32 = 16;

/// Contributions of each byte of Y, U and V to R, G and B, in fixed point. The table of Y includes half a
/// step for rounding.
#[derive(Debug, Clone, PartialEq, Eq)]
struct RgbOfYuv {
    luma: [i32; 256],
    red_of_v: [i32; 256],
    green_of_u: [i32; 256],
    green_of_v: [i32; 256],
    blue_of_u: [i32; 256],
}

impl RgbOfYuv {
    fn new(encoding: YuvEncoding) -> Self {
        let one = f64::from(1 << FRACTION_BITS);
        let table = |value: &dyn Fn(f64) -> f64| {
            std::array::from_fn(|byte| (one * value(byte as f64)).round() as i32)
        };
        // All three channels of grey equal the luma. One step of Y, U or V from there gives its weight
        // without leaving the gamut.
        let grey = encoding.rgb_from_yuv([128.0; 3]);
        let [of_y, of_u, of_v] = [
            [129.0, 128.0, 128.0],
            [128.0, 129.0, 128.0],
            [128.0, 128.0, 129.0],
        ]
        .map(|yuv| encoding.rgb_from_yuv(yuv));
        let weight = |stepped: [f64; 3], channel: usize| stepped[channel] - grey[channel];
        let chroma = |weight: f64| table(&|byte| weight * (byte - 128.0));
        Self {
            luma: table(&|y| grey[0] + weight(of_y, 0) * (y - 128.0) + 0.5),
            red_of_v: chroma(weight(of_v, 0)),
            green_of_u: chroma(weight(of_u, 1)),
            green_of_v: chroma(weight(of_v, 1)),
            blue_of_u: chroma(weight(of_u, 2)),
        }
    }

    #[inline(always)]
    fn rgb(&self, yuv: [u8; 3]) -> [u8; 3] {
        let [y, u, v] = yuv.map(usize::from);
        let luma = self.luma[y];
        [
            luma + self.red_of_v[v],
            luma + self.green_of_u[u] + self.green_of_v[v],
            luma + self.blue_of_u[u],
        ]
        .map(|value| (value >> FRACTION_BITS).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{YuvMatrix, YuvRange};

    fn bins(count: usize) -> ChannelBins {
        ChannelBins::new(count).unwrap()
    }

    #[test]
    fn only_divisors_of_the_steps_are_valid_bins() {
        for count in 0..300 {
            let allowed = [2, 4, 8, 16, 32, 64].contains(&count);
            assert_eq!(ChannelBins::new(count).is_ok(), allowed, "{count}");
        }
    }

    #[test]
    fn shares_are_computed_per_channel() {
        let mut histograms = ChannelHistograms::EMPTY;
        for (rgb, is_object) in [
            ([255, 0, 64], true),
            ([252, 63, 64], true),
            ([128, 0, 64], true),
            ([127, 0, 191], true),
            ([0, 0, 0], false),
        ] {
            histograms.add(rgb, is_object);
        }
        let [red, green, blue] = histograms.shares(bins(4));
        assert_eq!(red, [0.0, 0.25, 0.25, 0.5]);
        assert_eq!(green, [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(blue, [0.0, 0.75, 0.25, 0.0]);
        let fine = histograms.shares(bins(64));
        assert_eq!((fine[0][63], fine[1][15]), (0.5, 0.25));
        let rest = histograms.background_shares(bins(2)).unwrap();
        assert_eq!(rest, [(); 3].map(|()| vec![1.0, 0.0]));
        assert_eq!(ChannelHistograms::EMPTY.background_shares(bins(2)), None);
    }

    #[test]
    fn bins_of_rgb_pixels_are_exact() {
        for count in [2, 8, 64] {
            let table = ChannelTable::new(PixelKind::Rgb, bins(count));
            for value in 0..=255_u8 {
                let expected = (usize::from(value) * count / 256) as u8;
                assert_eq!(table.bins([value, 0, value])[..], [expected, 0, expected]);
            }
        }
    }

    #[test]
    fn bins_of_yuv_pixels_match_their_rgb_colours() {
        for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
            for range in [YuvRange::Full, YuvRange::Limited] {
                let encoding = YuvEncoding { matrix, range };
                let tables =
                    [8, 64].map(|count| ChannelTable::new(PixelKind::Yuv(encoding), bins(count)));
                for n in 0..=0xFF_FFFF_u32 / 31 {
                    let [_, y, u, v] = (31 * n).to_be_bytes();
                    let exact = encoding.rgb_from_yuv([y, u, v].map(f64::from));
                    for table in &tables {
                        let found = table.bins([y, u, v]);
                        for (exact, found) in exact.into_iter().zip(found) {
                            // A value halfway between two bytes may be rounded either way.
                            let bin = |value: f64| value.round() as u8 >> table.shift;
                            assert!(
                                found == bin(exact - 1e-4) || found == bin(exact + 1e-4),
                                "{encoding:?} {y} {u} {v}: {found} for {exact}"
                            );
                        }
                    }
                }
            }
        }
    }
}
