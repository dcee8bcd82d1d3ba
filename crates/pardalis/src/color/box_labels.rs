//! Labels that are boxes: upright rectangles drawn around a body, which do not follow its outline.
//!
//! A box says where a body ends on each side, but its corners show the surroundings. The body is then the ellipse
//! inscribed in the box. A rectangle that is the target itself, such as a sign, has the target's colours in its corners
//! and remains a rectangle.

use super::outline_distance::parts;

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

/// The labels of an image, row by row, as they are learnt from.
#[derive(Debug, PartialEq)]
pub(super) struct PixelLabels {
    /// The target's pixels.
    pub(super) is_target: Vec<bool>,
    /// The pixels of boxes around bodies. Those that are not the target's are not the background's either.
    pub(super) is_boxed: Vec<bool>,
}

impl PixelLabels {
    /// Takes labels as drawn, except that boxes around bodies become ellipses. `bin_at` returns the colour of the pixel of a column
    /// and row, below `bin_count`.
    pub(super) fn of(
        drawn: &[bool],
        bin_at: &impl Fn(usize, usize) -> u16,
        bin_count: usize,
        width: usize,
    ) -> Self {
        let mut labels = Self {
            is_target: drawn.to_vec(),
            is_boxed: vec![false; drawn.len()],
        };
        for part in parts(drawn, width) {
            let Some(drawn_box) = Rect::filled_by(&part) else {
                continue;
            };
            let view = View {
                drawn,
                bin_at,
                bin_count,
                width,
            };
            if !view.is_around_body(&drawn_box) {
                continue;
            }
            for (x, y) in part {
                labels.is_target[y * width + x] = drawn_box.ellipse(x, y) < 1.0;
                labels.is_boxed[y * width + x] = true;
            }
        }
        labels
    }

    /// Returns the target's pixels in boxes, or those that are labelled along its outline.
    pub(super) fn of_target(&self, boxed: bool) -> Vec<bool> {
        let both = self.is_target.iter().zip(&self.is_boxed);
        both.map(|(&target, &is_boxed)| target && is_boxed == boxed)
            .collect()
    }
}

/// An upright rectangle of pixels.
struct Rect {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Rect {
    /// Returns the bounding box of a connected part; `None` if the part does not fill it, or if it is small.
    fn filled_by(part: &[(usize, usize)]) -> Option<Self> {
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
    fn ellipse(&self, x: usize, y: usize) -> f64 {
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
}

/// An image with the labels drawn in it.
struct View<'a, B> {
    drawn: &'a [bool],
    bin_at: &'a B,
    bin_count: usize,
    width: usize,
}

impl<B: Fn(usize, usize) -> u16> View<'_, B> {
    /// Judges whether a box encloses a body that leaves its corners free: by Bayes' rule from the colours within the
    /// ellipse and around the box. A box that fills the image does not.
    fn is_around_body(&self, drawn: &Rect) -> bool {
        let height = self.drawn.len() / self.width;
        let shorter = drawn.width.min(drawn.height) as f64;
        let reach = ((SURROUNDINGS * shorter) as usize).max(MIN_SURROUNDINGS_PX);
        let (mut inside, mut around) = (vec![0_u32; self.bin_count], vec![0_u32; self.bin_count]);
        let mut corners = Vec::new();
        let bottom = (drawn.top + drawn.height + reach).min(height);
        let right = (drawn.left + drawn.width + reach).min(self.width);
        for y in drawn.top.saturating_sub(reach)..bottom {
            for x in drawn.left.saturating_sub(reach)..right {
                let index = y * self.width + x;
                let bin = usize::from((self.bin_at)(x, y));
                let scale = drawn.ellipse(x, y);
                if !drawn.holds(x, y) {
                    // Other labels are no surroundings.
                    around[bin] += u32::from(!self.drawn[index]);
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

    fn labels(bins: &[u16], drawn: &[bool]) -> PixelLabels {
        PixelLabels::of(drawn, &|x, y| bins[y * WIDTH + x], BINS, WIDTH)
    }

    #[test]
    fn a_box_around_an_ellipse_becomes_the_ellipse_and_its_corners_are_ignored() {
        let is_body = |x: usize, y: usize| BOX.ellipse(x, y) < 1.0;
        let found = labels(&colors(is_body), &image(|x, y| BOX.holds(x, y)));
        assert!(found.is_target == image(is_body));
        assert!(found.is_boxed == image(|x, y| BOX.holds(x, y)));
        let count = found.is_target.iter().filter(|&&target| target).count() as f64;
        let area = std::f64::consts::PI * 12.0 * 10.0;
        assert!((count / area - 1.0).abs() < 0.02, "{count} {area}");
    }

    #[test]
    fn a_rectangular_target_remains_a_rectangle() {
        let drawn = image(|x, y| BOX.holds(x, y));
        for bins in [
            colors(|x, y| BOX.holds(x, y)),
            // Next to something of the same colours.
            colors(|x, y| BOX.holds(x, y) || x > 44),
        ] {
            let found = labels(&bins, &drawn);
            assert!(found.is_target == drawn);
            assert!(!found.is_boxed.contains(&true));
        }
    }

    #[test]
    fn labels_that_are_no_boxes_or_small_or_the_whole_image_remain_as_drawn() {
        let is_body = |x: usize, y: usize| BOX.ellipse(x, y) < 1.0;
        let bins = colors(is_body);
        for drawn in [
            image(|x, y| BOX.holds(x, y) && (x, y) != (20, 15)),
            image(is_body),
            image(|x, y| (28..35).contains(&x) && BOX.holds(x, y)),
            image(|_, _| true),
            image(|_, _| false),
        ] {
            let found = labels(&bins, &drawn);
            assert!(found.is_target == drawn);
            assert!(!found.is_boxed.contains(&true));
        }
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
        let found = labels(&colors(is_body), &drawn);
        assert!(found.is_target == image(is_body));
        assert!(found.is_boxed == image(|x, y| second.holds(x, y)));
        assert!(found.of_target(true) == image(|x, y| second.ellipse(x, y) < 1.0));
        assert!(found.of_target(false) == image(|x, y| BOX.holds(x, y)));
    }
}
