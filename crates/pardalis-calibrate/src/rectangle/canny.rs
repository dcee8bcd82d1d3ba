//! The Canny edge detector: Gaussian blur, Sobel gradients, non-maximum suppression and hysteresis.

use pardalis_images::{GrayImage, Image};

/// Sobel gradients of a blurred image along x and y: eight times the grey levels per pixel.
pub(super) type Gradients = Image<i16, 2>;

/// Computes the gradients of an image after a Gaussian blur. The border is replicated outwards.
pub(super) fn blurred_gradients(image: &GrayImage, sigma_px: f32) -> Gradients {
    let blurred = blurred(image, sigma_px);
    let (right, bottom) = (blurred.width() - 1, blurred.height() - 1);
    Gradients::from_fn(blurred.width(), blurred.height(), |x, y| {
        let columns = [x.saturating_sub(1), x, (x + 1).min(right)];
        let rows = [y.saturating_sub(1), y, (y + 1).min(bottom)];
        let [above, beside, below] =
            rows.map(|y| columns.map(|x| i16::from(blurred.get_pixel(x, y)[0])));
        let sum = |[a, b, c]: [i16; 3]| a + 2 * b + c;
        let column = |i: usize| sum([above[i], beside[i], below[i]]);
        [column(2) - column(0), sum(below) - sum(above)]
    })
}

/// Blurs an image with a Gaussian that is truncated at two standard deviations. Both passes round down to grey levels.
pub(super) fn blurred(image: &GrayImage, sigma_px: f32) -> GrayImage {
    let kernel = gaussian(sigma_px);
    let reach = kernel.len() as i64 / 2;
    let (right, bottom) = (i64::from(image.width()) - 1, i64::from(image.height()) - 1);
    let weighted = |level: &dyn Fn(i64) -> u8| {
        let offsets = -reach..=reach;
        let terms = kernel.iter().zip(offsets);
        let sum = terms.fold(0.0_f32, |sum, (weight, offset)| {
            sum + f32::from(level(offset)) * weight
        });
        [sum.clamp(0.0, 255.0) as u8]
    };
    let along_rows = GrayImage::from_fn(image.width(), image.height(), |x, y| {
        weighted(&|offset| {
            let column = (i64::from(x) + offset).clamp(0, right);
            image.get_pixel(column as u32, y)[0]
        })
    });
    GrayImage::from_fn(image.width(), image.height(), |x, y| {
        weighted(&|offset| {
            let row = (i64::from(y) + offset).clamp(0, bottom);
            along_rows.get_pixel(x, row as u32)[0]
        })
    })
}

/// Returns the weights of a Gaussian at integer pixels; they sum to 1.
fn gaussian(sigma_px: f32) -> Vec<f32> {
    let reach = (2.0 * sigma_px).ceil() as i32;
    let density = |x: i32| {
        (sigma_px * (2.0 * std::f32::consts::PI).sqrt()).recip()
            * libm::expf(-(x as f32).powi(2) / (2.0 * sigma_px.powi(2)))
    };
    let mut kernel: Vec<f32> = (-reach..=reach).map(|x| density(x.abs())).collect();
    let sum: f32 = kernel.iter().sum();
    for weight in &mut kernel {
        *weight /= sum;
    }
    kernel
}

/// Finds edge pixels (255, others 0): local maxima of the gradient's magnitude across the edge that are at least `high`,
/// or at least `low` and connected to such pixels.
pub(super) fn edges(gradients: &Gradients, [low, high]: [f32; 2]) -> GrayImage {
    let strength = gradients.map(|[x, y]| [libm::hypotf(f32::from(x), f32::from(y))]);
    let thin = thinned(gradients, &strength);
    let mut edges = GrayImage::new(thin.width(), thin.height());
    let mut followed = Vec::new();
    for y in 1..thin.height().saturating_sub(1) {
        for x in 1..thin.width().saturating_sub(1) {
            if thin.get_pixel(x, y)[0] < high || edges.get_pixel(x, y)[0] > 0 {
                continue;
            }
            edges.put_pixel(x, y, [255]);
            followed.push((x, y));
            while let Some((x, y)) = followed.pop() {
                // Edges are thin and are followed from their strongest pixels, so that six neighbours suffice.
                let neighbours = [
                    (x + 1, y),
                    (x + 1, y + 1),
                    (x, y + 1),
                    (x - 1, y - 1),
                    (x - 1, y),
                    (x - 1, y + 1),
                ];
                for (x, y) in neighbours {
                    if thin.get_pixel(x, y)[0] >= low && edges.get_pixel(x, y)[0] == 0 {
                        edges.put_pixel(x, y, [255]);
                        followed.push((x, y));
                    }
                }
            }
        }
    }
    edges
}

/// Returns the gradient's magnitude where neither neighbour across the edge has a greater one, and 0 elsewhere and on
/// the border.
fn thinned(gradients: &Gradients, strength: &Image<f32, 1>) -> Image<f32, 1> {
    let (right, bottom) = (strength.width() - 1, strength.height() - 1);
    Image::from_fn(strength.width(), strength.height(), |x, y| {
        if x == 0 || y == 0 || x == right || y == bottom {
            return [0.0];
        }
        let [gx, gy] = gradients.get_pixel(x, y).map(f32::from);
        let angle = libm::atan2f(gy, gx).to_degrees();
        let angle = if angle < 0.0 { angle + 180.0 } else { angle };
        let across = match angle {
            22.5..67.5 => [(x + 1, y + 1), (x - 1, y - 1)],
            67.5..112.5 => [(x, y - 1), (x, y + 1)],
            112.5..157.5 => [(x - 1, y + 1), (x + 1, y - 1)],
            _ => [(x - 1, y), (x + 1, y)],
        };
        let own = strength.get_pixel(x, y);
        let is_longest = across
            .iter()
            .all(|&(x, y)| own[0] >= strength.get_pixel(x, y)[0]);
        if is_longest { own } else { [0.0] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step_edge(dark: u8, light: u8) -> GrayImage {
        GrayImage::from_fn(40, 30, |x, _| [if x < 20 { dark } else { light }])
    }

    #[test]
    fn blurs_symmetrically_and_keeps_constant_levels() {
        let plain = GrayImage::from_pixel(9, 7, [200]);
        let levels = blurred(&plain, 1.4);
        // The weights sum to 1 except for rounding, and levels are rounded down.
        assert!(levels.as_raw().iter().all(|l| (199..=200).contains(l)));
        let mut point = GrayImage::new(15, 15);
        point.put_pixel(7, 7, [255]);
        let spread = blurred(&point, 1.4);
        assert!(spread.get_pixel(7, 7)[0] > spread.get_pixel(6, 7)[0]);
        for (x, y) in [(5, 7), (9, 7), (7, 5), (7, 9)] {
            assert_eq!(spread.get_pixel(x, y), spread.get_pixel(5, 7));
            assert!(spread.get_pixel(x, y)[0] > 0);
        }
    }

    #[test]
    fn gradient_of_a_ramp_is_eight_times_its_slope() {
        let ramp = GrayImage::from_fn(40, 30, |x, y| [(3 * x + 2 * y) as u8]);
        let gradients = blurred_gradients(&ramp, 0.1);
        assert_eq!(gradients.get_pixel(20, 15), [24, 16]);
        // The border is replicated outwards.
        assert_eq!(gradients.get_pixel(0, 15), [12, 16]);
    }

    #[test]
    fn finds_steps_above_the_threshold() {
        let count = |dark, light| {
            let gradients = blurred_gradients(&step_edge(dark, light), 1.4);
            let edges = edges(&gradients, [16.0, 32.0]);
            edges.as_raw().iter().filter(|value| **value > 0).count()
        };
        assert_eq!(count(100, 102), 0);
        // One pixel per row except at the border.
        assert_eq!(count(100, 180), 28);
    }
}
