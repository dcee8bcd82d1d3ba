//! The labelled balls of an image, and their outlines.

use std::fmt;

use pardalis::color::{Ellipse, LabelOutline};

/// Points of an outline.
const OUTLINE_POINTS: usize = 72;
/// Labels that differ from the outline by less than this share of its radius, or this many pixels, follow it. Hand-set: labels drawn
/// with care on real clips deviate by at most 7 %.
const CLEAR: f64 = 0.08;
const CLEAR_PX: f64 = 0.8;

/// A circle in an image, pixel centres at integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Circle {
    pub(super) center_px: [f64; 2],
    pub(super) radius_px: f64,
}

impl Circle {
    /// Returns the circle with the centroid and the area of a closed polygon; `None` if it encloses nothing.
    pub(super) fn of_outline(corners: &[[f64; 2]]) -> Option<Self> {
        let (mut area, mut moment) = (0.0, [0.0; 2]);
        let next = corners.iter().cycle().skip(1);
        for ([u, v], [next_u, next_v]) in corners.iter().zip(next) {
            let cross = 0.5 * (u * next_v - next_u * v);
            area += cross;
            moment[0] += cross * (u + next_u) / 3.0;
            moment[1] += cross * (v + next_v) / 3.0;
        }
        (area != 0.0).then(|| Self {
            center_px: moment.map(|sum| sum / area),
            radius_px: (area.abs() / std::f64::consts::PI).sqrt(),
        })
    }

    /// Returns the distance of the other circle's centre from this one's, in radii of this one.
    pub(super) fn radii_to(&self, other: &Self) -> f64 {
        let [u, v] = [0, 1].map(|axis| other.center_px[axis] - self.center_px[axis]);
        u.hypot(v) / self.radius_px
    }
}

impl fmt::Display for Circle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [u, v] = self.center_px;
        write!(f, "{u:7.1} {v:7.1} {:6.1}", self.radius_px)
    }
}

/// A labelled ball of an image.
#[derive(Debug, Clone)]
pub(super) struct LabelledBall {
    /// The circle of the label's area.
    pub(super) label: Circle,
    /// The ratio of the axes of the outline, or of the label without one.
    pub(super) axes_ratio: f64,
    /// The outline that was fitted at the label; `None` if the image shows none there.
    pub(super) outline: Option<Outline>,
}

/// An outline in an image.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    /// The circle with its centroid and area.
    pub(super) circle: Circle,
    pub(super) points_px: Vec<[f64; 2]>,
}

impl LabelledBall {
    pub(super) fn of(labelled: &LabelOutline) -> Self {
        let circle = |ellipse: &Ellipse| Circle {
            center_px: ellipse.center_px(),
            radius_px: ellipse.radius_px(),
        };
        let outline = |ellipse: &Ellipse| Outline {
            circle: circle(ellipse),
            points_px: ellipse.outline_px(OUTLINE_POINTS),
        };
        Self {
            label: circle(&labelled.label),
            axes_ratio: labelled.outline.unwrap_or(labelled.label).axes_ratio(),
            outline: labelled.outline.as_ref().map(outline),
        }
    }

    /// Returns where the ball is: its fitted outline, or the label without one.
    pub(super) fn place(&self) -> &Circle {
        self.outline
            .as_ref()
            .map_or(&self.label, |outline| &outline.circle)
    }

    /// Says what was done with the label.
    pub(super) fn remark(&self) -> String {
        let Some(Outline { circle, .. }) = &self.outline else {
            return "no outline seen at the label: label kept".to_owned();
        };
        let too_large_px = self.label.radius_px - circle.radius_px;
        let off_px = circle.radii_to(&self.label) * circle.radius_px;
        let differs = |px: f64| px.abs() > CLEAR_PX && px.abs() > CLEAR * circle.radius_px;
        let size = if too_large_px > 0.0 { "large" } else { "small" };
        let size = format!("{:.1} px too {size}", too_large_px.abs());
        match (differs(too_large_px), differs(off_px)) {
            (false, false) => String::new(),
            (true, false) => format!("label {size}: fitted"),
            (false, true) => format!("label {off_px:.1} px off: fitted"),
            (true, true) => format!("label {size} and {off_px:.1} px off: fitted"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_circle_of_an_outline_has_its_centroid_and_area() {
        let point = |i: i32| {
            let (sin, cos) = (f64::from(i) * 0.1).sin_cos();
            [100.0 + 5.0 * cos, -20.0 + 5.0 * sin]
        };
        let circle = Circle::of_outline(&(0..63).map(point).collect::<Vec<_>>()).unwrap();
        assert!((circle.center_px[0] - 100.0).abs() < 0.02, "{circle:?}");
        assert!((circle.center_px[1] + 20.0).abs() < 0.02, "{circle:?}");
        assert!((circle.radius_px - 5.0).abs() < 0.02, "{circle:?}");
        assert_eq!(Circle::of_outline(&[[1.0, 1.0], [5.0, 5.0]]), None);
        assert_eq!(Circle::of_outline(&[]), None);
    }
}
