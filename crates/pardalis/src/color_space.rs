//! Colour spaces: YUV matrices and ranges, RGB, and hue, saturation, intensity.

use serde::{Deserialize, Serialize};

/// The weights of red, green and blue in Y.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum YuvMatrix {
    /// ITU-R BT.601: JPEG, webcams and standard-definition video.
    #[default]
    Bt601,
    /// ITU-R BT.709: high-definition video.
    Bt709,
}

/// The byte values of black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum YuvRange {
    /// Y from 0 to 255, as in JPEG.
    #[default]
    Full,
    /// Y from 16 to 235 and U, V from 16 to 240, as in most video.
    Limited,
}

impl YuvMatrix {
    /// Returns the name of the matrix in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bt601 => "bt601",
            Self::Bt709 => "bt709",
        }
    }
}

impl YuvRange {
    /// Returns the name of the range in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Limited => "limited",
        }
    }
}

/// Matrix and range of YUV pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YuvEncoding {
    /// The weights that make up Y.
    pub matrix: YuvMatrix,
    /// The values of black and white.
    pub range: YuvRange,
}

impl YuvEncoding {
    /// The encoding of most video: BT.601, limited range.
    pub const VIDEO: Self = Self {
        matrix: YuvMatrix::Bt601,
        range: YuvRange::Limited,
    };

    /// Returns the weights of red and blue in Y.
    fn weights(self) -> (f64, f64) {
        match self.matrix {
            YuvMatrix::Bt601 => (0.299, 0.114),
            YuvMatrix::Bt709 => (0.2126, 0.0722),
        }
    }

    /// Returns the offset of Y, the scale of Y, and the scale of U and V, in byte steps over the unit range.
    fn scales(self) -> (f64, f64, f64) {
        match self.range {
            YuvRange::Full => (0.0, 255.0, 255.0),
            YuvRange::Limited => (16.0, 219.0, 224.0),
        }
    }

    /// Converts Y, U, V in 0..=255 to R, G, B in 0..=255, unrounded and clamped to the gamut.
    pub fn rgb_from_yuv(self, [y, u, v]: [f64; 3]) -> [f64; 3] {
        let (kr, kb) = self.weights();
        let (y0, y_scale, c_scale) = self.scales();
        let luma = (y - y0) / y_scale;
        let blue_difference = (u - 128.0) / c_scale * 2.0;
        let red_difference = (v - 128.0) / c_scale * 2.0;
        let r = luma + red_difference * (1.0 - kr);
        let b = luma + blue_difference * (1.0 - kb);
        let g = (luma - kr * r - kb * b) / (1.0 - kr - kb);
        [r, g, b].map(|c| (c * 255.0).clamp(0.0, 255.0))
    }

    /// The same in single precision and without divisions: every pixel near an outline is converted.
    #[inline(always)]
    pub(crate) fn single_rgb_from_yuv(self, yuv: [u8; 3]) -> [f32; 3] {
        let (kr, kb) = self.weights();
        let (y0, y_scale, c_scale) = self.scales();
        let [y, u, v] = yuv.map(f32::from);
        let luma = (y - y0 as f32) * (255.0 / y_scale) as f32;
        let difference = |chroma: f32, share: f64| {
            (chroma - 128.0) * (2.0 * (1.0 - share) * 255.0 / c_scale) as f32
        };
        let (r, b) = (luma + difference(v, kr), luma + difference(u, kb));
        let [red, green, blue] = [kr, 1.0, kb].map(|share| (share / (1.0 - kr - kb)) as f32);
        let g = luma * green - r * red - b * blue;
        [r, g, b].map(|c| c.clamp(0.0, 255.0))
    }

    /// Converts R, G, B in 0..=255 to Y, U, V in 0..=255, unrounded.
    pub fn yuv_from_rgb(self, rgb: [f64; 3]) -> [f64; 3] {
        let (kr, kb) = self.weights();
        let (y0, y_scale, c_scale) = self.scales();
        let [r, g, b] = rgb.map(|c| c / 255.0);
        let luma = kr * r + (1.0 - kr - kb) * g + kb * b;
        let u = (b - luma) / (2.0 * (1.0 - kb));
        let v = (r - luma) / (2.0 * (1.0 - kr));
        [
            y0 + y_scale * luma,
            128.0 + c_scale * u,
            128.0 + c_scale * v,
        ]
        .map(|c| c.clamp(0.0, 255.0))
    }

    /// Converts Y, U, V bytes to R, G, B bytes, for display.
    pub fn rgb8_from_yuv(self, yuv: [u8; 3]) -> [u8; 3] {
        self.rgb_from_yuv(yuv.map(f64::from))
            .map(|c| c.round() as u8)
    }
}

/// Converts R, G, B in 0..=255 to hue in `[0, 1)`, saturation in `[0, 1]` and intensity in `[0, 1]`.
///
/// Hue and saturation are those of HSV; the intensity is the mean of R, G and B (Taiana 2007, section 4.3).
/// Grey has hue 0.
pub fn hsi_from_rgb([r, g, b]: [f64; 3]) -> [f64; 3] {
    let max = r.max(g).max(b);
    let min = r.min(g).min(b);
    let chroma = max - min;
    let intensity = (r + g + b) / (3.0 * 255.0);
    if chroma <= 0.0 {
        return [0.0, 0.0, intensity];
    }
    let sixth = if max == r {
        (g - b) / chroma + if g < b { 6.0 } else { 0.0 }
    } else if max == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    [sixth / 6.0, chroma / max, intensity]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yuv_and_rgb_round_trip_in_every_encoding() {
        for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
            for range in [YuvRange::Full, YuvRange::Limited] {
                let encoding = YuvEncoding { matrix, range };
                for rgb in [
                    [0.0, 0.0, 0.0],
                    [255.0; 3],
                    [200.0, 90.0, 30.0],
                    [10.0, 20.0, 250.0],
                ] {
                    let yuv = encoding.yuv_from_rgb(rgb);
                    let back = encoding.rgb_from_yuv(yuv);
                    let bytes = yuv.map(|value| value.round() as u8);
                    let single = encoding.single_rgb_from_yuv(bytes);
                    let exact = encoding.rgb_from_yuv(bytes.map(f64::from));
                    for (single, exact) in single.into_iter().zip(exact) {
                        assert!(
                            (f64::from(single) - exact).abs() < 1e-3,
                            "{encoding:?} {bytes:?}"
                        );
                    }
                    for c in 0..3 {
                        assert!(
                            (back[c] - rgb[c]).abs() < 1.0,
                            "{encoding:?} {rgb:?} -> {back:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn known_yuv_values() {
        let full601 = YuvEncoding::default();
        let yuv = full601.yuv_from_rgb([255.0, 0.0, 0.0]);
        assert!((yuv[0] - 76.245).abs() < 1e-9, "{yuv:?}");
        assert!((yuv[1] - 84.972).abs() < 1e-2, "{yuv:?}");
        let limited709 = YuvEncoding {
            matrix: YuvMatrix::Bt709,
            range: YuvRange::Limited,
        };
        assert_eq!(
            limited709.yuv_from_rgb([255.0; 3]).map(f64::round),
            [235.0, 128.0, 128.0]
        );
        assert_eq!(limited709.rgb8_from_yuv([16, 128, 128]), [0, 0, 0]);
    }

    #[test]
    fn known_hues() {
        assert_eq!(hsi_from_rgb([255.0, 0.0, 0.0]), [0.0, 1.0, 1.0 / 3.0]);
        assert_eq!(hsi_from_rgb([0.0, 255.0, 0.0])[0], 1.0 / 3.0);
        assert_eq!(hsi_from_rgb([0.0, 0.0, 255.0])[0], 2.0 / 3.0);
        assert_eq!(hsi_from_rgb([90.0, 90.0, 90.0])[..2], [0.0, 0.0]);
        let magenta_red = hsi_from_rgb([255.0, 0.0, 1.0])[0];
        assert!(magenta_red > 0.99 && magenta_red < 1.0, "{magenta_red}");
    }
}
