//! The labels of an image, as they are learnt from: the outline in the image at each label of a round body, and other labels as
//! they were drawn.

use super::box_labels::Rect;
use super::ellipse::Ellipse;
use super::label_fit::{self, Fit, FittedOutline, Kind, LabelledImage, sector_of};
use super::outline_distance::{Part, is_usable, parts};

/// Parts with fewer pixels are taken as round, because too few pixels show no shape. Hand-set: a radius of 5 px.
const MIN_JUDGED_PX: usize = 80;
/// The minimum share of a round part within the ellipse that has its area and second moments. Hand-set: 0.95 and more for
/// polygons of eight corners along a circle, at most 0.94 for quadrilaterals.
const MIN_ROUND_SHARE: f64 = 0.945;
/// In sectors in which the outline is not seen, pixels beyond this multiple of it may show what hides it.
const HIDDEN: f64 = 0.5;

/// A label of a round body, whole in the image, and the outline that the image shows there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelOutline {
    /// The label: the ellipse with its moments, or inscribed in a box.
    pub label: Ellipse,
    /// Whether the label is a box.
    pub is_box: bool,
    /// The outline in the image: the label itself if it follows one as well as can be told, and is learnt as it is. `None` if none is seen near the label around at least half of the turn. The label is learnt from
    /// then.
    pub outline: Option<Ellipse>,
}

/// The labels of an image.
#[derive(Debug)]
pub(super) struct PixelLabels {
    /// Whether each pixel, row by row, is the target's.
    pub(super) is_target: Vec<bool>,
    /// Pixels that are neither the target's nor the background's: in the corners of boxes, or where something may hide the target.
    is_unknown: Vec<bool>,
    /// The outlines that were fitted.
    pub(super) fits: Vec<FittedOutline>,
    /// The target's pixels of labels without a fit, except boxes.
    pub(super) unfitted: Vec<bool>,
    /// The target's pixels in boxes without a fit.
    pub(super) boxed: Vec<bool>,
    pub(super) outlines: Vec<LabelOutline>,
}

impl PixelLabels {
    /// Fits the outlines of the labels of an image.
    pub(super) fn of(image: &LabelledImage) -> Self {
        let none = vec![false; image.drawn.len()];
        let mut labels = Self {
            is_target: none.clone(),
            is_unknown: none.clone(),
            fits: Vec::new(),
            unfitted: none.clone(),
            boxed: none,
            outlines: Vec::new(),
        };
        for part in parts(image.drawn, image.width) {
            labels.add(image, &part);
        }
        labels
    }

    /// Reports whether a pixel counts as background.
    pub(super) fn is_background(&self, index: usize) -> bool {
        !self.is_target[index] && !self.is_unknown[index]
    }

    fn add(&mut self, image: &LabelledImage, part: &Part) {
        let drawn_box = Rect::filled_by(part);
        let kind = if drawn_box.is_some() {
            Kind::Box
        } else {
            Kind::Outline
        };
        let label = label_fit::ellipse_of(part, kind);
        let is_whole = is_usable(part, image.size());
        let may_be_round = is_whole && (kind == Kind::Box || is_round(part, &label));
        let fit = may_be_round.then(|| label_fit::fit(image, part, kind));
        let fit = fit.flatten();
        let is_around_body = drawn_box
            .as_ref()
            .is_some_and(|drawn| drawn.is_around_body(image));
        if fit.is_some() || may_be_round && (kind == Kind::Outline || is_around_body) {
            self.outlines.push(LabelOutline {
                label,
                is_box: kind == Kind::Box,
                outline: fit.as_ref().map(|fit| match fit {
                    Fit::Label => label,
                    Fit::Outline(fitted) => fitted.outline,
                }),
            });
        }
        match (fit, drawn_box) {
            (Some(Fit::Outline(fit)), _) => self.add_fit(image, fit),
            (None, Some(drawn)) if is_around_body => {
                for &(x, y) in part {
                    let index = y * image.width + x;
                    let is_body = drawn.ellipse(x, y) < 1.0;
                    self.is_target[index] |= is_body;
                    self.boxed[index] = is_body;
                    self.is_unknown[index] = true;
                }
            }
            (Some(Fit::Label) | None, _) => {
                for &(x, y) in part {
                    self.is_target[y * image.width + x] = true;
                    self.unfitted[y * image.width + x] = true;
                }
            }
        }
    }

    fn add_fit(&mut self, image: &LabelledImage, fit: FittedOutline) {
        let (width, height) = image.size();
        let [_, reach] = fit.outline.semi_axes_px();
        let [u, v] = fit.outline.center_px();
        let range = |center: f64, size: usize| {
            (center - reach).max(0.0) as usize..((center + reach) as usize + 2).min(size)
        };
        for y in range(v, height) {
            for x in range(u, width) {
                let scale = fit.outline.scale_at([x as f64, y as f64]);
                if scale < 1.0 {
                    let is_body = scale < HIDDEN
                        || fit.is_seen[sector_of(fit.outline.turn([x as f64, y as f64]))];
                    self.is_target[y * width + x] |= is_body;
                    self.is_unknown[y * width + x] |= !is_body;
                }
            }
        }
        self.fits.push(fit);
    }
}

/// Reports whether a part is round: nearly all of it lies within the ellipse that has its area and second moments.
fn is_round(part: &Part, ellipse: &Ellipse) -> bool {
    if part.len() < MIN_JUDGED_PX {
        return true;
    }
    let area = part.len() as f64;
    let of_area = ellipse.scaled((area / std::f64::consts::PI).sqrt() / ellipse.radius_px());
    let inside = part
        .iter()
        .filter(|&&(x, y)| of_area.scale_at([x as f64, y as f64]) <= 1.0);
    inside.count() as f64 >= MIN_ROUND_SHARE * area
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 120;
    const HEIGHT: usize = 100;
    /// Centre and radius of the ball in the image.
    const BALL: [f64; 3] = [58.3, 47.6, 15.4];

    fn drawn(is_target: impl Fn(f64, f64) -> bool) -> Vec<bool> {
        (0..WIDTH * HEIGHT)
            .map(|i| is_target((i % WIDTH) as f64, (i / WIDTH) as f64))
            .collect()
    }

    fn disc([u, v, radius]: [f64; 3]) -> Vec<bool> {
        drawn(|x, y| (x - u).hypot(y - v) < radius)
    }

    /// Labels an image of a grey ball with a soft edge.
    fn labels(drawn: &[bool]) -> PixelLabels {
        let yuv = |x: usize, y: usize| {
            let [u, v, radius] = BALL;
            let [dx, dy] = [x as f64 - u, y as f64 - v];
            let share = 0.5 * libm::erfc((dx.hypot(dy) - radius) / 1.2);
            let grain = ((x * 7 + y * 13) % 11) as f64 - 5.0;
            [(60.0 + 140.0 * share + grain) as f32, 128.0, 128.0]
        };
        let bins: Vec<u16> = (0..WIDTH * HEIGHT)
            .map(|i| (yuv(i % WIDTH, i / WIDTH)[0] / 20.0) as u16)
            .collect();
        PixelLabels::of(&LabelledImage {
            drawn,
            bins: &bins,
            bin_count: 13,
            width: WIDTH,
            yuv: &yuv,
            is_exact: false,
        })
    }

    #[test]
    fn outlines_are_fitted_at_rough_labels() {
        let [u, v, radius] = BALL;
        let box_of = |half: f64| drawn(|x, y| (x - u).abs() < half && (y - v).abs() < half);
        for (what, drawn) in [
            ("off", disc([u + 0.3 * radius, v, radius])),
            ("small", disc([u, v, 0.8 * radius])),
            ("large", disc([u, v, 1.2 * radius])),
            ("box", box_of(radius)),
            ("large box", box_of(1.2 * radius)),
            ("box inside", box_of(0.68 * radius)),
        ] {
            let found = labels(&drawn);
            let [label] = found.outlines[..] else {
                panic!("{what}: {:?}", found.outlines)
            };
            let outline = label.outline.unwrap_or_else(|| panic!("{what}: no fit"));
            let off = [0, 1].map(|axis| outline.center_px()[axis] - BALL[axis]);
            let size = outline.radius_px() / radius;
            assert!(off[0].hypot(off[1]) < 0.03 * radius, "{what}: {outline:?}");
            assert!((size - 1.0).abs() < 0.03, "{what}: {size}");
            assert_eq!(label.is_box, what.contains("box"), "{what}");
        }
    }

    #[test]
    fn careful_labels_are_learnt_as_they_are() {
        let drawn = disc(BALL);
        let found = labels(&drawn);
        assert_eq!(found.outlines[0].outline, Some(found.outlines[0].label));
        assert!(found.is_target == drawn && found.unfitted == drawn);
    }

    #[test]
    fn labels_of_nothing_are_kept_and_other_shapes_not_fitted() {
        let nothing = disc([20.0, 80.0, 9.0]);
        let found = labels(&nothing);
        assert_eq!(found.outlines[0].outline, None);
        assert!(found.is_target == nothing);
        for drawn in [
            drawn(|x, y| (x - 58.0).abs() + (y - 47.0).abs() < 20.0),
            disc([5.0, 47.0, 12.0]),
            drawn(|_, _| true),
            drawn(|_, _| false),
        ] {
            let found = labels(&drawn);
            assert!(found.outlines.is_empty(), "{:?}", found.outlines);
            assert!(found.is_target == drawn);
        }
    }
}
