//! Labels that are boxes: upright rectangles drawn around a body, which do not follow its outline.
//!
//! A box says where a body ends on each side, but its corners show the surroundings. The body is then the ellipse
//! inscribed in the box. A rectangle that is the target itself, such as a sign, has the target's colours in its corners
//! and remains a rectangle.

use super::label_fit::LabelledImage;
use super::outline_distance::Part;

/// Boxes with a shorter side are taken as they are, pixels. Hand-set: their corners have too few pixels to judge.
const MIN_SIDE_PX: usize = 8;
/// The width of the surroundings that a box is compared with: a share of its shorter side, and at least this many pixels.
/// Hand-set.
const SURROUNDINGS: f64 = 0.25;
const MIN_SURROUNDINGS_PX: usize = 3;
/// Corners are judged beyond this multiple of the ellipse, up to √2 in the corner itself. Hand-set: leaves out the blurred
/// edge of a round body.
const CLEAR_OF_EDGE: f64 = 1.15;
/// The minimum share of the target's colours in the corners of a rectangle that is the target itself. Hand-set: rectangles
/// have 0.8 and more, boxes around balls in real images at most 0.55, and 0.65 if they are much too small.
const MIN_CORNER_SHARE: f64 = 2.0 / 3.0;

/// An upright rectangle of pixels.
pub(super) struct Rect {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Rect {
    /// Returns the bounding box of a connected part; `None` if the part does not fill it, or if it is small.
    pub(super) fn filled_by(part: &Part) -> Option<Self> {
        let range = |axis: fn(&(usize, usize)) -> usize| {
            let first = part.iter().map(axis).min()?;
            let last = part.iter().map(axis).max()?;
            Some((first, last + 1 - first))
        };
        let ((left, width), (top, height)) = (range(|p| p.0)?, range(|p| p.1)?);
        let is_box = part.len() == width * height && width.min(height) >= MIN_SIDE_PX;
        is_box.then_some(Self {
            left,
            top,
            width,
            height,
        })
    }

    /// Returns the square of the scale at which the inscribed ellipse passes through the centre of a pixel: 1 on its
    /// outline, 2 in the corners of the rectangle.
    pub(super) fn ellipse(&self, x: usize, y: usize) -> f64 {
        let along = |at: usize, first: usize, size: usize| {
            let half = 0.5 * size as f64;
            ((at as f64 + 0.5 - first as f64) / half - 1.0).powi(2)
        };
        along(x, self.left, self.width) + along(y, self.top, self.height)
    }

    fn holds(&self, x: usize, y: usize) -> bool {
        (self.left..self.left + self.width).contains(&x)
            && (self.top..self.top + self.height).contains(&y)
    }

    /// Judges whether a box encloses a body that leaves its corners free: by Bayes' rule from the colours within the
    /// ellipse and around the box. A box that fills the image does not.
    pub(super) fn is_around_body(&self, image: &LabelledImage) -> bool {
        let (width, height) = image.size();
        let shorter = self.width.min(self.height) as f64;
        let reach = ((SURROUNDINGS * shorter) as usize).max(MIN_SURROUNDINGS_PX);
        let (mut inside, mut around) = (vec![0_u32; image.bin_count], vec![0_u32; image.bin_count]);
        let mut corners = Vec::new();
        let bottom = (self.top + self.height + reach).min(height);
        let right = (self.left + self.width + reach).min(width);
        for y in self.top.saturating_sub(reach)..bottom {
            for x in self.left.saturating_sub(reach)..right {
                let index = y * width + x;
                let bin = usize::from(image.bins[index]);
                let scale = self.ellipse(x, y);
                if !self.holds(x, y) {
                    // Other labels are no surroundings.
                    around[bin] += u32::from(!image.drawn[index]);
                } else if scale < 1.0 {
                    inside[bin] += 1;
                } else if scale > CLEAR_OF_EDGE * CLEAR_OF_EDGE {
                    corners.push(bin);
                }
            }
        }
        let total = |counts: &[u32]| f64::from(counts.iter().sum::<u32>());
        let (inside_total, around_total) = (total(&inside), total(&around));
        if around_total == 0.0 {
            return false;
        }
        let (mut sum, mut judged) = (0.0, 0.0);
        for bin in corners {
            let of_body = f64::from(inside[bin]) / inside_total;
            let of_rest = f64::from(around[bin]) / around_total;
            if of_body + of_rest > 0.0 {
                sum += of_body / (of_body + of_rest);
                judged += 1.0;
            }
        }
        sum < MIN_CORNER_SHARE * judged
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::outline_distance::parts;

    const WIDTH: usize = 60;
    const HEIGHT: usize = 50;
    const BINS: usize = 8;

    /// The drawn box: columns 20 to 43, rows 15 to 34.
    const BOX: Rect = Rect {
        left: 20,
        top: 15,
        width: 24,
        height: 20,
    };

    fn image<T>(pixel: impl Fn(usize, usize) -> T) -> Vec<T> {
        (0..WIDTH * HEIGHT)
            .map(|i| pixel(i % WIDTH, i / WIDTH))
            .collect()
    }

    /// Colours 0 to 3 for the body and 3 to 6 for the rest, so that both share one.
    fn colors(is_body: impl Fn(usize, usize) -> bool) -> Vec<u16> {
        image(|x, y| ((x * 7 + y * 5) % 4) as u16 + if is_body(x, y) { 0 } else { 3 })
    }

    /// For each drawn part, whether it is a box around a body; `None` if it is no box.
    fn judged(bins: &[u16], drawn: &[bool]) -> Vec<Option<bool>> {
        let image = LabelledImage {
            drawn,
            bins,
            bin_count: BINS,
            width: WIDTH,
            yuv: &|_, _| [0.0; 3],
            is_exact: false,
        };
        let is_around = |part| Some(Rect::filled_by(part)?.is_around_body(&image));
        parts(drawn, WIDTH).iter().map(is_around).collect()
    }

    #[test]
    fn a_box_around_an_ellipse_is_recognised() {
        let is_body = |x: usize, y: usize| BOX.ellipse(x, y) < 1.0;
        let drawn = image(|x, y| BOX.holds(x, y));
        assert_eq!(judged(&colors(is_body), &drawn), [Some(true)]);
    }

    #[test]
    fn a_rectangular_target_is_no_box_around_a_body() {
        let drawn = image(|x, y| BOX.holds(x, y));
        for bins in [
            colors(|x, y| BOX.holds(x, y)),
            // Next to something of the same colours.
            colors(|x, y| BOX.holds(x, y) || x > 44),
        ] {
            assert_eq!(judged(&bins, &drawn), [Some(false)]);
        }
    }

    #[test]
    fn labels_that_are_no_boxes_or_small_or_the_whole_image_are_not_judged() {
        let is_body = |x: usize, y: usize| BOX.ellipse(x, y) < 1.0;
        let bins = colors(is_body);
        for drawn in [
            image(|x, y| BOX.holds(x, y) && (x, y) != (20, 15)),
            image(is_body),
            image(|x, y| (28..35).contains(&x) && BOX.holds(x, y)),
        ] {
            assert_eq!(judged(&bins, &drawn), [None]);
        }
        assert_eq!(judged(&bins, &image(|_, _| true)), [Some(false)]);
    }

    #[test]
    fn every_box_of_an_image_is_judged_by_itself() {
        let second = Rect {
            left: 2,
            top: 2,
            width: 10,
            height: 9,
        };
        let drawn = image(|x, y| BOX.holds(x, y) || second.holds(x, y));
        let is_body = |x: usize, y: usize| BOX.holds(x, y) || second.ellipse(x, y) < 1.0;
        assert_eq!(judged(&colors(is_body), &drawn), [Some(true), Some(false)]);
    }
}
