//! Palettes: lookup tables from the colour of a pixel to its histogram bin.

use serde::{Deserialize, Serialize};

use crate::Frame;
use crate::color_space::{YuvEncoding, hsi_from_rgb};
use crate::frame::PixelFormat;
use pardalis_core::Error;

/// A division of colour space into bins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Palette {
    /// Hue, saturation and intensity (Taiana 2007, section 4.3).
    Hsi {
        /// Bins of hue.
        hue_bins: u16,
        /// Bins of saturation.
        saturation_bins: u16,
        /// Bins of intensity.
        intensity_bins: u16,
    },
    /// Luma and chroma, directly from the pixels of a YUV camera (Taiana 2007, section 4.3).
    Yuv {
        /// Bins of Y.
        y_bins: u16,
        /// Bins of U.
        u_bins: u16,
        /// Bins of V.
        v_bins: u16,
        /// The YUV encoding that the bins divide.
        #[serde(flatten)]
        encoding: YuvEncoding,
    },
    /// Red, green and blue.
    Rgb {
        /// Bins of each channel.
        channel_bins: u16,
    },
}

/// The maximum number of bins per channel; tables distinguish 64 steps per channel.
pub const MAX_CHANNEL_BINS: u16 = 64;

/// The maximum total number of bins, so that bin numbers fit in 16 bits with one value to spare.
pub const MAX_BINS: usize = 65_535;

impl Palette {
    /// The bins of Taiana 2007 for offline use.
    pub const HSI: Self = Self::Hsi {
        hue_bins: 12,
        saturation_bins: 12,
        intensity_bins: 4,
    };
    /// The bins of Taiana 2007 for real time, in the YUV of JPEG files.
    pub const YUV: Self = Self::Yuv {
        y_bins: 4,
        u_bins: 8,
        v_bins: 8,
        encoding: YuvEncoding {
            matrix: super::YuvMatrix::Bt601,
            range: super::YuvRange::Full,
        },
    };

    /// Returns the number of bins of each channel.
    pub fn channel_bins(self) -> [u16; 3] {
        match self {
            Self::Hsi {
                hue_bins,
                saturation_bins,
                intensity_bins,
            } => [hue_bins, saturation_bins, intensity_bins],
            Self::Yuv {
                y_bins,
                u_bins,
                v_bins,
                ..
            } => [y_bins, u_bins, v_bins],
            Self::Rgb { channel_bins } => [channel_bins; 3],
        }
    }

    /// Returns the names of the channels, as in files.
    pub fn channel_names(self) -> [&'static str; 3] {
        match self {
            Self::Hsi { .. } => ["hue", "saturation", "intensity"],
            Self::Yuv { .. } => ["y", "u", "v"],
            Self::Rgb { .. } => ["red", "green", "blue"],
        }
    }

    /// Returns the total number of bins.
    pub fn bin_count(self) -> usize {
        self.channel_bins()
            .iter()
            .map(|&n| usize::from(n))
            .product()
    }

    /// Checks that the bin counts can be tabulated.
    ///
    /// # Errors
    ///
    /// A channel has no bins or more than [`MAX_CHANNEL_BINS`], or the total exceeds [`MAX_BINS`].
    pub fn check(self) -> Result<(), Error> {
        for (name, bins) in self.channel_names().iter().zip(self.channel_bins()) {
            if !(1..=MAX_CHANNEL_BINS).contains(&bins) {
                return Err(Error::out_of_range(
                    &format!("bins of {name}"),
                    bins,
                    "1 to 64",
                ));
            }
        }
        if self.bin_count() > MAX_BINS {
            return Err(Error::out_of_range(
                "bins in all",
                self.bin_count(),
                "1 to 65535",
            ));
        }
        Ok(())
    }

    /// Returns the bin of a colour given as R, G, B in 0..=255.
    pub fn bin_of_rgb(self, rgb: [f64; 3]) -> u16 {
        match self {
            Self::Hsi { .. } => self.bin_of_shares(hsi_from_rgb(rgb)),
            Self::Yuv { encoding, .. } => self.bin_of_yuv(encoding.yuv_from_rgb(rgb)),
            Self::Rgb { .. } => self.bin_of_shares(rgb.map(|c| c / 256.0)),
        }
    }

    /// Returns the bin of Y, U, V in 0..=255, in the palette's own encoding.
    fn bin_of_yuv(self, yuv: [f64; 3]) -> u16 {
        self.bin_of_shares(yuv.map(|c| c / 256.0))
    }

    /// Returns the bin of three channels in `[0, 1]`; the first channel varies slowest.
    fn bin_of_shares(self, channels: [f64; 3]) -> u16 {
        let bins = self.channel_bins();
        let mut bin = 0;
        for (share, n) in channels.into_iter().zip(bins) {
            let index = ((share * f64::from(n)) as u16).min(n - 1);
            bin = bin * n + index;
        }
        bin
    }

    /// Returns the three channel indices of a bin.
    pub fn channels_of_bin(self, bin: u16) -> [u16; 3] {
        let [_, second, third] = self.channel_bins();
        [bin / third / second, bin / third % second, bin % third]
    }

    /// Returns the bin with the given channel indices, or `None` if one is out of range.
    pub fn bin_of_channels(self, channels: [u16; 3]) -> Option<u16> {
        let bins = self.channel_bins();
        channels
            .iter()
            .zip(bins)
            .all(|(&c, n)| c < n)
            .then(|| (channels[0] * bins[1] + channels[1]) * bins[2] + channels[2])
    }

    /// Returns a colour from the middle of a bin as R, G, B bytes, for display.
    pub fn rgb_of_bin(self, bin: u16) -> [u8; 3] {
        let bins = self.channel_bins();
        let index = self.channels_of_bin(bin);
        let middle = |c: usize| (f64::from(index[c]) + 0.5) / f64::from(bins[c]);
        let rgb = match self {
            Self::Hsi { .. } => rgb_from_hsi([middle(0), middle(1), middle(2)]),
            Self::Yuv { encoding, .. } => {
                encoding.rgb_from_yuv([256.0 * middle(0), 256.0 * middle(1), 256.0 * middle(2)])
            }
            Self::Rgb { .. } => [256.0 * middle(0), 256.0 * middle(1), 256.0 * middle(2)],
        };
        rgb.map(|c| c.round().clamp(0.0, 255.0) as u8)
    }
}

/// Converts hue, saturation and intensity to R, G, B in 0..=255, clamped to the gamut.
fn rgb_from_hsi([hue, saturation, intensity]: [f64; 3]) -> [f64; 3] {
    // Converts as HSV with value 1, then scales so that the mean is the intensity.
    let channel = |offset: f64| {
        let k = (offset + hue * 6.0) % 6.0;
        1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    let rgb = [channel(5.0), channel(3.0), channel(1.0)];
    let mean = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
    rgb.map(|c| (255.0 * c * intensity / mean).clamp(0.0, 255.0))
}

/// The meaning of the three bytes of a frame's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelKind {
    /// Red, green and blue.
    Rgb,
    /// Y, U and V in this encoding.
    Yuv(YuvEncoding),
}

impl PixelKind {
    /// Y, U and V of BT.601, full range.
    pub(crate) const FULL_RANGE_YUV: Self = Self::Yuv(YuvEncoding {
        matrix: super::YuvMatrix::Bt601,
        range: super::YuvRange::Full,
    });

    /// Returns the kind of a frame's pixels.
    pub fn of(frame: &Frame) -> Self {
        match frame.format() {
            PixelFormat::Rgb8 => Self::Rgb,
            _ => Self::Yuv(frame.encoding()),
        }
    }

    /// Converts a pixel's raw bytes to Y, U and V of BT.601, full range, 0 to 255.
    #[inline]
    pub fn full_range_yuv(self, bytes: [u8; 3]) -> [f32; 3] {
        let full = YuvEncoding::default();
        match self {
            Self::Rgb => self.full_range_yuv_of_mean(bytes.map(f64::from)),
            Self::Yuv(encoding) if encoding == full => bytes.map(f32::from),
            Self::Yuv(encoding) => full_range_yuv_from_rgb(encoding.single_rgb_from_yuv(bytes)),
        }
    }

    /// Converts a block of pixels, given as their first, second and third raw bytes, to blocks of Y, U and V.
    #[inline(always)]
    pub(crate) fn full_range_yuv_of_block<const N: usize>(
        self,
        bytes: &[[u8; N]; 3],
    ) -> [[f32; N]; 3] {
        // The kind is matched once per block.
        match self {
            Self::Rgb => of_block(bytes, |bytes| {
                Self::Rgb.full_range_yuv_of_mean(bytes.map(f64::from))
            }),
            Self::Yuv(encoding) if encoding == YuvEncoding::default() => {
                of_block(bytes, |bytes| bytes.map(f32::from))
            }
            Self::Yuv(encoding) => of_block(bytes, |bytes| {
                full_range_yuv_from_rgb(encoding.single_rgb_from_yuv(bytes))
            }),
        }
    }

    /// The same for means of raw bytes.
    pub(crate) fn full_range_yuv_of_mean(self, bytes: [f64; 3]) -> [f32; 3] {
        let full = YuvEncoding::default();
        let yuv = match self {
            Self::Rgb => full.yuv_from_rgb(bytes),
            Self::Yuv(encoding) if encoding == full => bytes,
            Self::Yuv(encoding) => full.yuv_from_rgb(encoding.rgb_from_yuv(bytes)),
        };
        yuv.map(|value| value as f32)
    }

    /// By how much Y, U and V of BT.601, full range, change with each raw byte, for means of pixels.
    pub(crate) fn full_range_slopes(self) -> [[f32; 3]; 3] {
        // Far from the borders of the gamut.
        const GREY: u8 = 128;
        const STEP: u8 = 16;
        let around = |i: usize| {
            let moved = |value: u8| {
                let mut bytes = [GREY; 3];
                bytes[i] = value;
                self.full_range_yuv(bytes)
            };
            let (less, more) = (moved(GREY - STEP), moved(GREY + STEP));
            [0, 1, 2].map(|row| (more[row] - less[row]) / f32::from(2 * STEP))
        };
        let columns = [0, 1, 2].map(around);
        [0, 1, 2].map(|row| [0, 1, 2].map(|i| columns[i][row]))
    }

    /// Converts Y, U and V of BT.601, full range, to a pixel's raw bytes, the nearest if it has none for that colour.
    pub(crate) fn bytes(self, full_range_yuv: [f32; 3]) -> [u8; 3] {
        let full = YuvEncoding::default();
        let yuv = full_range_yuv.map(f64::from);
        let bytes = match self {
            Self::Rgb => full.rgb_from_yuv(yuv),
            Self::Yuv(encoding) if encoding == full => yuv,
            Self::Yuv(encoding) => encoding.yuv_from_rgb(full.rgb_from_yuv(yuv)),
        };
        // Casts of floats saturate.
        bytes.map(|value| (value + 0.5) as u8)
    }
}

/// Converts each pixel of a block.
#[inline(always)]
fn of_block<const N: usize>(
    bytes: &[[u8; N]; 3],
    convert: impl Fn([u8; 3]) -> [f32; 3],
) -> [[f32; N]; 3] {
    let mut block = [[0_f32; N]; 3];
    for i in 0..N {
        let yuv = convert([bytes[0][i], bytes[1][i], bytes[2][i]]);
        for (of_channel, value) in block.iter_mut().zip(yuv) {
            of_channel[i] = value;
        }
    }
    block
}

/// The same as [`YuvEncoding::yuv_from_rgb`] of the default encoding, in single precision and without divisions: pixels of videos are converted twice.
#[inline(always)]
fn full_range_yuv_from_rgb([red, green, blue]: [f32; 3]) -> [f32; 3] {
    let luma = 0.299 * red + 0.587 * green + 0.114 * blue;
    let difference = |channel: f32, share: f32| 128.0 + (channel - luma) * (0.5 / (1.0 - share));
    [luma, difference(blue, 0.114), difference(red, 0.299)].map(|value| value.clamp(0.0, 255.0))
}

/// Steps per channel in a [`PixelTable`]. Derivation: the table then fits in the cache.
const STEPS: usize = 64;

/// A lookup table from a pixel's three raw bytes to its bin. Bytes are quantised to multiples of four, so
/// that the table stays in the cache. Bins whose borders are multiples of four (4, 8, 16, 32 or 64 bins of Y,
/// U, V or R, G, B) are exact.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PixelTable {
    bins: Box<[u16]>,
}

impl PixelTable {
    /// Tabulates a palette for pixels of one kind.
    pub fn new(palette: Palette, kind: PixelKind) -> Self {
        let mut bins = Vec::with_capacity(STEPS * STEPS * STEPS);
        for a in 0..STEPS {
            for b in 0..STEPS {
                for c in 0..STEPS {
                    bins.push(Self::bin_of_cell(palette, kind, [a, b, c]));
                }
            }
        }
        Self { bins: bins.into() }
    }

    /// Returns the bin of the centre of a table cell.
    fn bin_of_cell(palette: Palette, kind: PixelKind, cell: [usize; 3]) -> u16 {
        let components = cell.map(|step| 4.0 * step as f64 + 1.5);
        match (kind, palette) {
            (PixelKind::Rgb, _) => palette.bin_of_rgb(components),
            (PixelKind::Yuv(of_frame), Palette::Yuv { encoding, .. }) if encoding == of_frame => {
                palette.bin_of_yuv(components)
            }
            (PixelKind::Yuv(of_frame), _) => palette.bin_of_rgb(of_frame.rgb_from_yuv(components)),
        }
    }

    /// Returns the bin of a pixel's three raw bytes.
    #[inline(always)]
    pub fn bin(&self, [a, b, c]: [u8; 3]) -> u16 {
        let index = (usize::from(a >> 2) << 12) | (usize::from(b >> 2) << 6) | usize::from(c >> 2);
        self.bins[index]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{YuvMatrix, YuvRange};

    const LIMITED_709: YuvEncoding = YuvEncoding {
        matrix: YuvMatrix::Bt709,
        range: YuvRange::Limited,
    };

    #[test]
    fn a_table_of_aligned_bins_is_exact_for_every_byte() {
        let palette = Palette::YUV;
        let table = PixelTable::new(palette, PixelKind::Yuv(YuvEncoding::default()));
        for y in 0..=255_u8 {
            for (u, v) in [(0, 255), (31, 32), (128, 127), (y, 255 - y)] {
                let expected = palette.bin_of_yuv([y, u, v].map(f64::from));
                assert_eq!(table.bin([y, u, v]), expected);
                assert_eq!(
                    palette.channels_of_bin(expected),
                    [u16::from(y / 64), u16::from(u / 32), u16::from(v / 32)]
                );
            }
        }
    }

    #[test]
    fn yuv_and_rgb_frames_of_one_colour_share_their_bin() {
        let orange = [230.0, 110.0, 20.0];
        for palette in [Palette::HSI, Palette::YUV, Palette::Rgb { channel_bins: 8 }] {
            let expected = palette.bin_of_rgb(orange);
            let rgb_table = PixelTable::new(palette, PixelKind::Rgb);
            assert_eq!(rgb_table.bin(orange.map(|c| c as u8)), expected);
            let yuv = LIMITED_709.yuv_from_rgb(orange).map(|c| c.round() as u8);
            let yuv_table = PixelTable::new(palette, PixelKind::Yuv(LIMITED_709));
            assert_eq!(yuv_table.bin(yuv), expected, "{palette:?}");
        }
    }

    #[test]
    fn bins_and_channels_round_trip_and_display_colours_lie_in_their_bin() {
        for palette in [Palette::HSI, Palette::Rgb { channel_bins: 6 }] {
            for bin in 0..palette.bin_count() as u16 {
                assert_eq!(
                    palette.bin_of_channels(palette.channels_of_bin(bin)),
                    Some(bin)
                );
            }
        }
        let bin = Palette::HSI.bin_of_rgb([230.0, 110.0, 20.0]);
        let shown = Palette::HSI.rgb_of_bin(bin);
        assert_eq!(
            Palette::HSI.bin_of_rgb(shown.map(f64::from)),
            bin,
            "{shown:?}"
        );
        assert_eq!(Palette::HSI.bin_of_channels([12, 0, 0]), None);
    }

    #[test]
    fn bin_counts_are_checked() {
        assert!(Palette::Rgb { channel_bins: 0 }.check().is_err());
        assert!(
            Palette::Rgb { channel_bins: 64 }.check().is_err(),
            "64^3 bins do not fit"
        );
        assert!(Palette::Rgb { channel_bins: 40 }.check().is_ok());
        assert!(Palette::HSI.check().is_ok());
    }
}
