//! Sensor model: from light to the bytes of an image.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use pardalis_core::rng::{Draws, Stage};

/// Image properties of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ImageSettings {
    /// Number of rays along each side of a pixel.
    pub samples: usize,
    /// Exposure time in seconds, centred on the stated time.
    pub shutter_s: f64,
    /// Number of instants within the exposure whose images are averaged.
    pub instants: usize,
    /// Time from the exposure of one row to that of the next, in seconds, as of a rolling shutter: the middle row is
    /// exposed around the stated time. Negative if the lowest row is exposed first.
    pub line_delay_s: f64,
    /// Standard deviation of the lens blur in pixels; large out of focus.
    pub blur_px: f64,
    /// Standard deviation of the shot noise of white, as a share of white; it is proportional to the square
    /// root of the light.
    pub shot_noise: f64,
    /// Standard deviation of the read noise, in grey levels (0 to 255).
    pub read_noise: f64,
    /// Gains of red, green and blue in linear light: the camera's white balance.
    pub gains: [f64; 3],
    /// Amplitude of the exposure drift, as a share.
    pub gain_drift: f64,
    /// Amplitude of the drift of red against blue, as a share.
    pub white_balance_drift: f64,
    /// Period of both drifts in seconds.
    pub drift_period_s: f64,
    /// JPEG quality from 1 to 100 with 4:2:0 chroma subsampling; `None` for PNG.
    pub jpeg_quality: Option<u8>,
}

impl Default for ImageSettings {
    /// Returns an ideal camera without noise, blur and drift.
    fn default() -> Self {
        Self {
            samples: 3,
            shutter_s: 0.0,
            instants: 5,
            line_delay_s: 0.0,
            blur_px: 0.0,
            shot_noise: 0.0,
            read_noise: 0.0,
            gains: [1.0; 3],
            gain_drift: 0.0,
            white_balance_drift: 0.0,
            drift_period_s: 7.0,
            jpeg_quality: None,
        }
    }
}

impl ImageSettings {
    /// Returns the instants of the exposure around a time, in seconds.
    pub(super) fn instants_around(&self, time_s: f64) -> Vec<f64> {
        if self.shutter_s == 0.0 {
            return vec![time_s];
        }
        let place = |i: usize| (i as f64 + 0.5) / self.instants as f64 - 0.5;
        (0..self.instants)
            .map(|i| time_s + self.shutter_s * place(i))
            .collect()
    }

    /// Returns one half of the blur kernel, beginning with the centre. The full kernel sums to 1.
    pub(super) fn blur_kernel(&self) -> Vec<f32> {
        let reach = (3.0 * self.blur_px).ceil() as usize;
        let weight = |i: usize| libm::exp(-0.5 * (i as f64 / self.blur_px).powi(2));
        let weights: Vec<f64> = (1..=reach).map(weight).collect();
        let sum = 1.0 + 2.0 * weights.iter().sum::<f64>();
        let kernel = std::iter::once(1.0).chain(weights);
        kernel.map(|w| (w / sum) as f32).collect()
    }

    /// Converts the light on each pixel to bytes (three per pixel) for this exposure at a time in seconds.
    pub(super) fn develop(
        &self,
        light: &[[f32; 3]],
        draws: Draws,
        exposure: u32,
        time_s: f64,
    ) -> Vec<u8> {
        let drift = |number: u32| {
            let phase = draws.uniform(number, 0, Stage::Drift);
            libm::sin(TAU * (time_s / self.drift_period_s + phase))
        };
        let gain = 1.0 + self.gain_drift * drift(0);
        let tint = self.white_balance_drift * drift(1);
        let drifts = [gain * (1.0 + tint), gain, gain * (1.0 - tint)];
        let gains = [0, 1, 2].map(|channel| (self.gains[channel] * drifts[channel]) as f32);
        let (shot, read) = (self.shot_noise as f32, self.read_noise as f32);
        let is_noisy = shot > 0.0 || read > 0.0;
        let mut bytes = Vec::with_capacity(3 * light.len());
        for (pixel, color) in light.iter().enumerate() {
            let normals = if is_noisy {
                draws.normals(pixel as u32, exposure, Stage::Pixel, 0)
            } else {
                [0.0; 4]
            };
            for channel in 0..3 {
                let level = color[channel] * gains[channel];
                let (grey, slope) = grey_from_linear(level);
                // Shot noise, as it appears in grey levels, and read noise.
                let variance = (slope * shot).powi(2) * level + read * read;
                // Conversions from floats saturate.
                bytes.push((grey + variance.sqrt() * normals[channel] + 0.5) as u8);
            }
        }
        bytes
    }
}

/// Returns the sRGB value (0 to 255) of linear light and its derivative, from a table with an error below 0.1
/// grey levels.
fn grey_from_linear(level: f32) -> (f32, f32) {
    const STEPS: usize = 4096;
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let exact = |i: usize| {
            let v = i as f64 / STEPS as f64;
            if v <= 0.003_130_8 {
                12.92 * v
            } else {
                1.055 * libm::pow(v, 1.0 / 2.4) - 0.055
            }
        };
        (0..=STEPS).map(|i| (255.0 * exact(i)) as f32).collect()
    });
    let place = level.clamp(0.0, 1.0) * STEPS as f32;
    let cell = (place as usize).min(STEPS - 1);
    let step = table[cell + 1] - table[cell];
    (
        table[cell] + step * (place - cell as f32),
        step * STEPS as f32,
    )
}

#[cfg(test)]
mod tests {
    use pardalis_core::srgb::linear_from_srgb;

    use super::*;

    #[test]
    fn srgb_conversion_is_reversible() {
        let clean = ImageSettings::default();
        for grey in 0..=255_u8 {
            let light = linear_from_srgb([f64::from(grey); 3]).map(|v| v as f32);
            let bytes = clean.develop(&[light], Draws::new(1, 0), 0, 0.3);
            assert_eq!(bytes, [grey; 3]);
        }
    }

    #[test]
    fn gains_multiply_light() {
        let warm = ImageSettings {
            gains: [1.25, 1.0, 0.5],
            ..ImageSettings::default()
        };
        let bytes = warm.develop(&[[0.4; 3]], Draws::new(1, 0), 0, 0.3);
        let light = linear_from_srgb([0, 1, 2].map(|channel| f64::from(bytes[channel])));
        for (light, expected) in light.into_iter().zip([0.5, 0.4, 0.2]) {
            assert!((light - expected).abs() < 0.004, "{bytes:?}");
        }
    }

    #[test]
    fn noise_has_the_stated_strength_and_differs_between_exposures() {
        let noisy = ImageSettings {
            read_noise: 3.0,
            ..ImageSettings::default()
        };
        let light = vec![linear_from_srgb([128.0; 3]).map(|v| v as f32); 20_000];
        let draws = Draws::new(1, 0);
        let bytes = noisy.develop(&light, draws, 4, 0.0);
        let mean = bytes.iter().map(|&b| f64::from(b)).sum::<f64>() / bytes.len() as f64;
        let square = |&b: &u8| (f64::from(b) - mean).powi(2);
        let sigma = (bytes.iter().map(square).sum::<f64>() / bytes.len() as f64).sqrt();
        // Rounding adds one twelfth to the variance.
        assert!(
            (mean - 128.0).abs() < 0.1 && (sigma - 3.014).abs() < 0.05,
            "{mean} {sigma}"
        );
        assert_eq!(bytes, noisy.develop(&light, draws, 4, 0.0));
        assert_ne!(bytes, noisy.develop(&light, draws, 5, 0.0));
    }
}
