//! Illumination of a scene: its effect on colours as gains of red, green and blue (von Kries 1902), along the
//! two directions in which illumination mostly varies: brightness and warmth.

use super::palette::PixelKind;
use crate::color_space::YuvEncoding;
use crate::frame::Row;
use pardalis_core::simd::to_byte;

/// ln of the gains of red, green and blue per unit of warmth. Derivation: black bodies, roughly (Wien's law).
const WARMER: [f64; 3] = [0.5, 0.0, -1.0];
/// Standard deviation of the errors of mean red, green and blue, in grey levels of 255. Hand-set.
const MEAN_SIGMA: f64 = 5.0;
/// Prior standard deviations of changes of brightness and warmth. Hand-set.
const PRIOR_SIGMA: [f64; 2] = [1.0, 0.3];

/// Raw bytes around which gains are linearised, for any kind of pixels. Derivation: far from the borders of
/// the gamut, also in a brighter illumination.
const GREY: [f64; 3] = [40.0, 128.0, 128.0];

/// The difference between two illuminations, as gains of grey levels rather than of radiance. Camera gamma, a
/// power law, turns gains of radiance into gains of grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Illumination {
    /// ln of the gain of green.
    pub brightness: f64,
    /// Warmth: the loss of blue as ln of its gain; red gains half of that.
    pub warmth: f64,
}

impl Illumination {
    /// Estimates the change of illumination in which a mean colour `known` (Y, U and V of BT.601, full range)
    /// becomes `now`: a least-squares fit, in which bright channels have the most weight.
    pub fn between(known: [f32; 3], now: [f32; 3]) -> Self {
        let [known, now] = [known, now].map(|yuv| {
            let rgb = YuvEncoding::default().rgb_from_yuv(yuv.map(f64::from));
            rgb.map(|level| level.max(1.0))
        });
        // The normal equations of ln gain = brightness + warmth · WARMER.
        let [mut bb, mut bw, mut ww] = [PRIOR_SIGMA[0].powi(-2), 0.0, PRIOR_SIGMA[1].powi(-2)];
        let [mut b, mut w] = [0.0; 2];
        for channel in 0..3 {
            let weight = (known[channel] / MEAN_SIGMA).powi(2);
            let gain = libm::log(now[channel] / known[channel]);
            let warmer = WARMER[channel];
            bb += weight;
            bw += weight * warmer;
            ww += weight * warmer * warmer;
            b += weight * gain;
            w += weight * gain * warmer;
        }
        let determinant = bb * ww - bw * bw;
        Self {
            brightness: (ww * b - bw * w) / determinant,
            warmth: (bb * w - bw * b) / determinant,
        }
    }

    /// Returns the correction that undoes this change for pixels of a kind.
    pub fn correction(self, kind: PixelKind) -> IlluminationCorrection {
        if self == Self::default() {
            return IlluminationCorrection::NONE;
        }
        let gains = WARMER.map(|warmer| libm::exp(-self.brightness - self.warmth * warmer));
        let corrected = |bytes: [f64; 3]| match kind {
            PixelKind::Rgb => [0, 1, 2].map(|i| bytes[i] * gains[i]),
            PixelKind::Yuv(encoding) => {
                let rgb = encoding.rgb_from_yuv(bytes);
                encoding.yuv_from_rgb([0, 1, 2].map(|i| rgb[i] * gains[i]))
            }
        };
        let at_grey = corrected(GREY);
        let mut rows = [[0.0_f32; 4]; 3];
        for column in 0..3 {
            let mut beside = GREY;
            beside[column] += 1.0;
            let beside = corrected(beside);
            for row in 0..3 {
                rows[row][column] = (beside[row] - at_grey[row]) as f32;
            }
        }
        for row in 0..3 {
            let linear: f64 = (0..3).map(|i| f64::from(rows[row][i]) * GREY[i]).sum();
            rows[row][3] = (at_grey[row] - linear) as f32;
        }
        IlluminationCorrection { rows: Some(rows) }
    }
}

/// A correction of the bytes of pixels from one illumination to another: a linear map and a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IlluminationCorrection {
    rows: Option<[[f32; 4]; 3]>,
}

impl IlluminationCorrection {
    /// The identity.
    pub const NONE: Self = Self { rows: None };

    /// Corrects a colour: a pixel, or a mean of pixels.
    #[inline(always)]
    pub fn color(&self, color: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = color;
        match &self.rows {
            None => color,
            Some(rows) => rows.map(|row| row[0] * a + row[1] * b + row[2] * c + row[3]),
        }
    }

    /// Corrects a pixel's three raw bytes.
    #[inline(always)]
    pub fn bytes(&self, bytes: [u8; 3]) -> [u8; 3] {
        match self.rows {
            None => bytes,
            Some(_) => self.color(bytes.map(f32::from)).map(|v| to_byte(v + 0.5)),
        }
    }
}

impl IlluminationCorrection {
    /// Corrects the pixels of a row.
    #[inline(always)]
    pub(crate) fn row(&self, row: &mut Row) {
        // A copy, which the row's bytes do not alias: otherwise the loop is not vectorised.
        let Some(rows) = self.rows else {
            return;
        };
        let [first, second, third] = row.components_mut();
        let count = first.len();
        let (second, third) = (&mut second[..count], &mut third[..count]);
        for i in 0..count {
            let [a, b, c] = [first[i], second[i], third[i]].map(f32::from);
            let corrected =
                |row: [f32; 4]| to_byte(row[0] * a + row[1] * b + row[2] * c + row[3] + 0.5);
            first[i] = corrected(rows[0]);
            second[i] = corrected(rows[1]);
            third[i] = corrected(rows[2]);
        }
    }

    /// Corrects a block of pixels: their first, second and third raw bytes.
    #[inline(always)]
    pub(crate) fn block<const N: usize>(&self, bytes: [[u8; N]; 3]) -> [[u8; N]; 3] {
        if self.rows.is_none() {
            return bytes;
        }
        let mut corrected = [[0_u8; N]; 3];
        for i in 0..N {
            let pixel = self.bytes([bytes[0][i], bytes[1][i], bytes[2][i]]);
            for (of_channel, value) in corrected.iter_mut().zip(pixel) {
                of_channel[i] = value;
            }
        }
        corrected
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Frame;
    use crate::color::{YuvMatrix, YuvRange};

    const ORANGE: [f64; 3] = [185.0, 90.0, 37.0];

    fn yuv(rgb: [f64; 3]) -> [f32; 3] {
        YuvEncoding::default()
            .yuv_from_rgb(rgb)
            .map(|value| value as f32)
    }

    fn lit(rgb: [f64; 3], light: Illumination) -> [f64; 3] {
        [0, 1, 2].map(|i| rgb[i] * libm::exp(light.brightness + light.warmth * WARMER[i]))
    }

    #[test]
    fn illumination_is_estimated_from_a_colour_change() {
        let light = Illumination {
            brightness: -0.6,
            warmth: 0.25,
        };
        for rgb in [ORANGE, [120.0, 130.0, 110.0], [60.0, 70.0, 160.0]] {
            let found = Illumination::between(yuv(rgb), yuv(lit(rgb, light)));
            assert!((found.brightness + 0.6).abs() < 0.02, "{found:?}");
            assert!((found.warmth - 0.25).abs() < 0.05, "{found:?}");
        }
        assert_eq!(
            Illumination::between(yuv(ORANGE), yuv(ORANGE)).correction(PixelKind::Rgb),
            IlluminationCorrection::NONE
        );
        // A colour with a single channel does not separate warmth from brightness; black still gives finite
        // numbers.
        for rgb in [[0.0, 0.0, 200.0], [0.0; 3]] {
            let found = Illumination::between(yuv(rgb), yuv(lit(rgb, light)));
            assert!(found.brightness.is_finite() && found.warmth.abs() < 0.5);
        }
    }

    #[test]
    fn correction_restores_pixels_of_any_kind() {
        let light = Illumination {
            brightness: -0.5,
            warmth: -0.2,
        };
        let video = YuvEncoding {
            matrix: YuvMatrix::Bt709,
            range: YuvRange::Limited,
        };
        let kinds = [
            PixelKind::Rgb,
            PixelKind::Yuv(YuvEncoding::default()),
            PixelKind::Yuv(video),
        ];
        let bytes: Vec<u8> = (0..600).map(|i| (i * 89 % 256) as u8).collect();
        let pixels = Frame::from_rgb(200, 1, bytes, 0.0).unwrap();
        for kind in kinds {
            // Rows are corrected as single pixels are.
            let mut row = Row::default();
            row.read(&pixels, 0);
            light.correction(kind).row(&mut row);
            for x in 0..200 {
                let in_row = row.components().map(|of_component| of_component[x]);
                let single = light.correction(kind).bytes(pixels.components(x, 0));
                assert_eq!(in_row, single, "{kind:?}, pixel {x}");
            }
            let raw = |rgb| match kind {
                PixelKind::Rgb => rgb,
                PixelKind::Yuv(encoding) => encoding.yuv_from_rgb(rgb),
            };
            let seen = raw(lit(ORANGE, light)).map(|value| value.round() as u8);
            let back = light.correction(kind).bytes(seen);
            for (found, expected) in back.into_iter().zip(raw(ORANGE)) {
                assert!(
                    (f64::from(found) - expected).abs() < 2.0,
                    "{kind:?} {back:?}"
                );
            }
            let white = light
                .correction(kind)
                .bytes(raw([255.0; 3]).map(|v| v as u8));
            assert!(
                white[0] > 230,
                "pixels brighter than white must stay white: {white:?}"
            );
        }
        assert_eq!(IlluminationCorrection::NONE.bytes([3, 4, 5]), [3, 4, 5]);
    }
}
