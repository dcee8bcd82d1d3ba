//! Resizing with a triangle filter.

use super::{Image, RgbImage};

/// Source pixels of a column or row of the result, with their weights.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl RgbImage {
    /// Returns the image, reduced in proportion if it is wider than this many pixels.
    pub fn at_most(&self, width: u32) -> Self {
        if self.width() <= width {
            return self.clone();
        }
        let height = u64::from(self.height()) * u64::from(width) / u64::from(self.width());
        self.resized(width, height.max(1) as u32)
    }
}

impl<const CHANNELS: usize> Image<u8, CHANNELS> {
    /// Resizes the image by linear interpolation. For smaller images the filter is widened, so that every pixel
    /// contributes.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == self.dimensions() || self.as_raw().is_empty() {
            let unchanged = (width, height) == self.dimensions();
            return if unchanged {
                self.clone()
            } else {
                Self::new(width, height)
            };
        }
        let (pixels, _) = self.as_raw().as_chunks::<CHANNELS>();
        let own_width = self.width() as usize;
        let columns = taps(self.width(), width);
        let mut samples: Vec<[u8; CHANNELS]> = Vec::with_capacity(width as usize * height as usize);
        let mut row = vec![[0.0_f32; CHANNELS]; own_width];
        for vertical in taps(self.height(), height) {
            for (x, sum) in row.iter_mut().enumerate() {
                *sum = [0.0; CHANNELS];
                for (i, weight) in vertical.weights.iter().enumerate() {
                    let pixel = pixels[(vertical.first + i) * own_width + x];
                    for (sum, sample) in sum.iter_mut().zip(pixel) {
                        *sum += f32::from(sample) * weight;
                    }
                }
            }
            samples.extend(columns.iter().map(|horizontal| {
                let mut sum = [0.0_f32; CHANNELS];
                let sources = &row[horizontal.first..];
                for (weight, pixel) in horizontal.weights.iter().zip(sources) {
                    for (sum, sample) in sum.iter_mut().zip(pixel) {
                        *sum += sample * weight;
                    }
                }
                sum.map(|sum| sum.clamp(0.0, 255.0).round() as u8)
            }));
        }
        Self::from_raw(width, height, samples.into_flattened()).expect("as many pixels")
    }
}

/// Returns, for each of `to` pixels in a row, the pixels in a row of `from` of which it is the weighted mean.
fn taps(from: u32, to: u32) -> Vec<Taps> {
    let ratio = from as f32 / to as f32;
    let reach = ratio.max(1.0);
    let one = |place: u32| {
        let centre = (place as f32 + 0.5) * ratio;
        let first = ((centre - reach).floor() as i64).clamp(0, i64::from(from) - 1);
        let end = ((centre + reach).ceil() as i64).clamp(first + 1, i64::from(from));
        // From here on, pixel centres rather than borders have integer coordinates.
        let centre = centre - 0.5;
        let weight = |i: i64| (1.0 - ((i as f32 - centre) / reach).abs()).max(0.0);
        let mut weights: Vec<f32> = (first..end).map(weight).collect();
        let sum: f32 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= sum;
        }
        Taps {
            first: first as usize,
            weights,
        }
    };
    (0..to).map(one).collect()
}

#[cfg(test)]
mod tests {
    use crate::{GrayImage, RgbImage};

    #[test]
    fn resizing_preserves_ramps() {
        let ramp = GrayImage::from_fn(64, 8, |x, _| [4 * x as u8]);
        for scale in [0.25, 0.5, 2.0, 3.0] {
            let resized = ramp.resized((64.0 * scale) as u32, (8.0 * scale) as u32);
            let last = resized.width() - 1;
            for (x, _, [level]) in resized.enumerate_pixels() {
                // Near the ends, pixels are missing on one side.
                let place = (f64::from(x) + 0.5) / scale - 0.5;
                let is_inside = x > 0 && x < last && (0.0..=63.0).contains(&place);
                let error = f64::from(level) - 4.0 * place;
                assert!(!is_inside || error.abs() <= 0.51, "{scale} {x}: {error}");
            }
        }
    }

    #[test]
    fn halving_averages_the_four_nearest_pixels() {
        let point = |at: u32| RgbImage::from_fn(8, 1, |x, _| [if x == at { 80 } else { 0 }; 3]);
        let halved = |at| point(at).resized(4, 1).map(|[r, _, _]| [r]).into_raw();
        // Weights of 1, 3, 3 and 1 eighths; at the ends, the existing pixels share them.
        assert_eq!(halved(3), [0, 30, 10, 0]);
        assert_eq!(halved(4), [0, 10, 30, 0]);
        assert_eq!(halved(0), [34, 0, 0, 0]);
    }

    #[test]
    fn empty_images_stay_empty_and_equal_sizes_do_not_change_the_image() {
        let image = GrayImage::from_fn(5, 4, |x, y| [(50 * x + y) as u8]);
        assert_eq!(image.resized(5, 4), image);
        assert_eq!(image.resized(0, 3).as_raw(), []);
        assert_eq!(GrayImage::new(0, 0).resized(2, 1), GrayImage::new(2, 1));
    }
}
