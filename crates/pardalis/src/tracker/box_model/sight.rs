//! One box in one camera's image, and how likely it is given where a body is.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::detect::Blob;
use crate::tracker::image_box::ImageBox;
use crate::tracker::settings::DetectorSettings;
use crate::view::View;

/// A side closer to the border of the image than this may be that of a body that is cut off there, pixels. Hand-set.
const BORDER_PX: f64 = 2.0;
/// Sides are never more precise than this, pixels. Derivation: those of whole pixels, and a bit.
const LEAST_SIGMA_PX: f64 = 0.5;
/// The share of sides that are wrong, because a part of the body is covered or does not belong to its shape, ...
const WRONG_SHARE: f64 = 0.1;
/// ... and by how much they are less precise than the others. Hand-set.
const WRONG_WIDENING: f64 = 5.0;
/// The ratios of the largest size of clutter to the smallest, and of its widest to its tallest form. Hand-set: from a hundredth of the image to all of it, up to four times as wide as tall or
/// as tall as wide.
const CLUTTER_SIZES: f64 = 100.0;
const CLUTTER_FORMS: f64 = 16.0;
/// The greatest odds that a score gives. Hand-set: detectors are often surer than right.
const MAX_ODDS: f64 = 19.0;

/// A box in the image of a camera.
#[derive(Debug, Clone, Copy)]
pub(in crate::tracker) struct Sight {
    pub(in crate::tracker) camera: usize,
    /// Left, top, right and bottom side, pixels, within the image.
    pub(in crate::tracker) sides_px: [f64; 4],
    /// Whether the border of the image may cut off a part of its width and of its height.
    is_cut: [bool; 2],
    /// The standard deviation of each side, pixels.
    pub(in crate::tracker) sigma_px: f64,
    /// By how much it is likelier a body than its place and size say, nats.
    pub(in crate::tracker) log_odds: f64,
    /// The logarithm of the density of clutter there, 1/px⁴.
    pub(in crate::tracker) log_clutter: f64,
    /// The position that it measures.
    pub(in crate::tracker) fit: Option<Fit>,
    /// By how many nats it is less likely this body's because it may be another's.
    assigned: f64,
    /// What the density of the sides is multiplied by for the ratio to clutter, px⁴.
    likeness: f64,
}

/// A position that boxes measure.
#[derive(Debug, Clone, Copy)]
pub(in crate::tracker) struct Fit {
    /// Metres.
    pub(in crate::tracker) position_m: Vector3<f64>,
    /// Square metres; on the ground without the vertical.
    pub(in crate::tracker) covariance_m2: Matrix3<f64>,
    /// How far it moves if the boxes are larger by a factor of e, metres.
    pub(in crate::tracker) drift_m: Vector3<f64>,
    /// The sum of squares of what is left between boxes and outlines, in standard deviations.
    pub(in crate::tracker) squares: f64,
}

/// The ray through a pixel, in the world: origin (metres) and direction.
pub(in crate::tracker) fn ray_through(
    view: &View,
    pixel: [f64; 2],
) -> Option<(Point3<f64>, Vector3<f64>)> {
    let ray = view.camera().unproject(pixel)?;
    let pose = view.world_from_camera();
    Some((
        pose * Point3::from(ray.origin),
        pose * Vector3::from(ray.direction),
    ))
}

/// Sides of a box, within the image.
pub(in crate::tracker) fn clipped(sides_px: [f64; 4], (width, height): (usize, usize)) -> [f64; 4] {
    let [right, bottom] = [width, height].map(|side| side as f64 - 0.5);
    let [u0, v0, u1, v1] = sides_px;
    [
        u0.clamp(-0.5, right),
        v0.clamp(-0.5, bottom),
        u1.clamp(-0.5, right),
        v1.clamp(-0.5, bottom),
    ]
}

/// The standard deviation of each side of a box, pixels.
pub(in crate::tracker) fn sigma_px([u0, v0, u1, v1]: [f64; 4], settings: &DetectorSettings) -> f64 {
    let size_px = libm::sqrt((u1 - u0) * (v1 - v0));
    libm::hypot(LEAST_SIGMA_PX, settings.side_sigma * size_px)
}

/// The share of a box that lies within the image.
pub(in crate::tracker) fn share_within(sides_px: [f64; 4], size: (usize, usize)) -> f64 {
    let area = |[u0, v0, u1, v1]: [f64; 4]| (u1 - u0) * (v1 - v0);
    area(clipped(sides_px, size)) / area(sides_px)
}

impl Sight {
    /// A box in the image of a camera; `None` if it is outside of the image or has too low a score.
    pub(in crate::tracker) fn new(
        camera: usize,
        view: &View,
        found: &ImageBox,
        settings: &DetectorSettings,
    ) -> Option<Self> {
        let size = view.size();
        let sides_px = clipped(found.sides_px(), size);
        let [u0, v0, u1, v1] = sides_px;
        let [width, height] = [u1 - u0, v1 - v0];
        let is_sure = found
            .score()
            .is_none_or(|score| score >= settings.min_score);
        if !(is_sure && width > 0.0 && height > 0.0) {
            return None;
        }
        let is_cut = [0, 1].map(|axis| {
            let last = [size.0, size.1][axis] as f64 - 0.5;
            sides_px[axis] < BORDER_PX - 0.5 || sides_px[axis + 2] > last - BORDER_PX
        });
        let odds = found.score().map_or(1.0, |score| score / (1.0 - score));
        let log_area = libm::log(size.0 as f64 * size.1 as f64);
        let log_forms = libm::log(libm::log(CLUTTER_SIZES) * libm::log(CLUTTER_FORMS));
        let mut sight = Self {
            camera,
            sides_px,
            is_cut,
            sigma_px: sigma_px(sides_px, settings),
            log_odds: libm::log(odds.clamp(1.0 / MAX_ODDS, MAX_ODDS)),
            log_clutter: libm::log(settings.false_per_image)
                - (log_area + libm::log(width * height) + log_forms),
            fit: None,
            assigned: 0.0,
            likeness: 0.0,
        };
        sight.assign(0.0);
        Some(sight)
    }

    /// The ray through its middle, in the world: origin (metres) and direction.
    pub(in crate::tracker) fn ray(&self, view: &View) -> Option<(Point3<f64>, Vector3<f64>)> {
        let [u0, v0, u1, v1] = self.sides_px;
        let ray = view
            .camera()
            .unproject([0.5 * (u0 + u1), 0.5 * (v0 + v1)])?;
        let pose = view.world_from_camera();
        Some((
            pose * Point3::from(ray.origin),
            pose * Vector3::from(ray.direction),
        ))
    }

    /// Returns the blob that fills the box.
    pub(in crate::tracker) fn blob(&self) -> Blob {
        let [u0, v0, u1, v1] = self.sides_px;
        let [width, height] = [u1 - u0, v1 - v0];
        let pixel = |at: [f64; 2]| at.map(|v| v.round().max(0.0) as usize);
        Blob {
            centroid_px: [0.5 * (u0 + u1), 0.5 * (v0 + v1)],
            area_px: width * height,
            min_px: pixel([u0 + 0.5, v0 + 0.5]),
            max_px: pixel([u1 - 0.5, v1 - 0.5]),
            // Of a uniform density.
            covariance_px2: [width * width / 12.0, 0.0, height * height / 12.0],
            cut_off: self.is_cut.contains(&true),
        }
    }

    /// By how many nats the box is less likely this body's because it may be another's.
    pub(in crate::tracker) fn assigned(&self) -> f64 {
        self.assigned
    }

    /// The size of a box, pixels: of this one and those compared with it. A side that the image's border cuts off does not count.
    pub(in crate::tracker) fn size_px(&self, [u0, v0, u1, v1]: [f64; 4]) -> f64 {
        let [width, height] = [u1 - u0, v1 - v0];
        match self.is_cut {
            [true, false] => height,
            [false, true] => width,
            _ => libm::sqrt(width * height),
        }
    }

    /// How much likelier this box is that of a body, whose own is clipped to the image and has sides of this standard deviation (pixels), than clutter.
    pub(in crate::tracker) fn ratio(&self, body_px: [f64; 4], sigma_px: f64) -> f64 {
        let mut density = 1.0;
        for (side, body) in self.sides_px.into_iter().zip(body_px) {
            density *= side_density((side - body) / sigma_px) / sigma_px;
            if density == 0.0 {
                return 0.0;
            }
        }
        density * self.likeness
    }

    /// Notes by how many nats the box is less likely this body's because it may be another's.
    pub(in crate::tracker) fn assign(&mut self, nats: f64) {
        self.likeness = libm::exp(self.log_odds - self.log_clutter - nats);
        self.assigned = nats;
    }

    /// The logarithm of the greatest ratio at any position, given what a fit leaves (squared standard deviations), and what is assigned to others.
    pub(in crate::tracker) fn log_peak(&self, squares: f64) -> f64 {
        let log_density = -0.5 * squares - 2.0 * LOG_TAU - 4.0 * libm::log(self.sigma_px);
        self.log_odds - self.log_clutter - self.assigned + log_density
    }
}

/// ln 2π.
const LOG_TAU: f64 = 1.837_877_066_409_345_5;

/// The density of a side that is off by this many standard deviations; 0 beyond all that matters.
fn side_density(off: f64) -> f64 {
    let normal = |off: f64| libm::exp(-0.5 * off * off) * INVERSE_SQRT_TAU;
    let off = off.abs();
    if off > FARTHEST_SIGMAS {
        return 0.0;
    }
    let right = if off < NEAR_SIGMAS {
        (1.0 - WRONG_SHARE) * normal(off)
    } else {
        0.0
    };
    right + WRONG_SHARE / WRONG_WIDENING * normal(off / WRONG_WIDENING)
}

/// 1/√2π.
const INVERSE_SQRT_TAU: f64 = 0.398_942_280_401_432_7;
/// Beyond this, right sides do not count. Derivation: less than a billionth of the wrong ones.
const NEAR_SIGMAS: f64 = 9.0;
/// Beyond this, wrong ones do not either. Derivation: 1e-14 of their density in the middle.
const FARTHEST_SIGMAS: f64 = 40.0;

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::{Pinhole, Pose};

    fn sight(sides_px: [f64; 4], score: f64) -> Option<Sight> {
        let camera = Pinhole::new([300.0; 2], [160.0, 120.0], &[]).unwrap();
        let view = View::new(camera, Pose::identity(), (320, 240), None).unwrap();
        let found = ImageBox::new(sides_px).unwrap().with_score(score).unwrap();
        let settings = DetectorSettings {
            min_score: 0.2,
            ..DetectorSettings::default()
        };
        Sight::new(0, &view, &found, &settings)
    }

    #[test]
    fn boxes_outside_of_the_image_or_with_too_low_a_score_are_left_out() {
        assert!(sight([10.0, 10.0, 30.0, 30.0], 0.5).is_some());
        assert!(sight([10.0, 10.0, 30.0, 30.0], 0.1).is_none());
        assert!(sight([330.0, 10.0, 350.0, 30.0], 0.5).is_none());
        let cut = sight([-20.0, 10.0, 30.0, 30.0], 0.5).unwrap();
        assert_eq!(cut.sides_px, [-0.5, 10.0, 30.0, 30.0]);
        // What is left of its width says nothing of its size.
        assert_eq!(cut.size_px([-40.0, 10.0, 30.0, 30.0]), 20.0);
    }

    #[test]
    fn the_density_of_a_side_is_one_in_all() {
        let step = 0.01;
        let sum: f64 = (-6000..6000)
            .map(|i| step * side_density(step * f64::from(i)))
            .sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        assert!(side_density(10.0) > 1e-3, "a wrong side excludes nothing");
    }

    #[test]
    fn scores_are_odds_within_limits() {
        let odds = |score| libm::exp(sight([10.0, 10.0, 30.0, 30.0], score).unwrap().log_odds);
        assert!((odds(0.5) - 1.0).abs() < 1e-12 && (odds(0.8) - 4.0).abs() < 1e-12);
        assert!((odds(1.0) - MAX_ODDS).abs() < 1e-9);
    }
}
