//! Optical properties of a camera: field of view and angular resolution.

use pardalis_camera::Camera;

/// Distance of the points that are projected, in metres: far enough for models without a single viewpoint.
const FAR_M: f64 = 100.0;

/// Bisection steps, which find the last pixel with a ray to a thousandth of a pixel.
const BISECTIONS: usize = 10;

/// Samples of a radius from the centre of the image to its end.
const RADIUS_SAMPLES: usize = 400;

/// A camera and the size of its images.
pub(crate) struct Optics<'a> {
    camera: &'a Camera,
    size_px: (usize, usize),
    /// The pixel on the optical axis.
    pub(crate) center_px: [f64; 2],
    /// 1 if the camera looks along its z axis, -1 if a mirror makes it look backwards.
    facing: f64,
}

/// A sample on a radius from the centre of the image.
pub(super) struct RadiusSample {
    /// Distance from the centre in pixels.
    pub(super) radius_px: f64,
    /// Angle from the optical axis.
    pub(super) angle_rad: f64,
    /// Radial resolution in pixels per radian.
    pub(super) radial_px_per_rad: f64,
    /// Tangential resolution in pixels per radian.
    pub(super) tangential_px_per_rad: f64,
}

impl<'a> Optics<'a> {
    pub(crate) fn new(camera: &'a Camera, size_px: (usize, usize)) -> Self {
        let parameters = camera.parameters();
        let named = |name: &str| parameters.iter().find(|(n, _)| *n == name).map(|(_, v)| *v);
        let middle = [size_px.0 as f64, size_px.1 as f64].map(|side| 0.5 * (side - 1.0));
        let center_px = [
            named("cx_px").unwrap_or(middle[0]),
            named("cy_px").unwrap_or(middle[1]),
        ];
        let facing = if camera.looks_into_mirror() {
            -1.0
        } else {
            1.0
        };
        Self {
            camera,
            size_px,
            center_px,
            facing,
        }
    }

    /// Reports whether the camera looks along its z axis.
    pub(super) fn looks_ahead(&self) -> bool {
        self.facing > 0.0
    }

    fn direction(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        self.camera.unproject(pixel).map(|ray| ray.direction)
    }

    /// Returns the angle of a pixel's ray from the axis; `None` if it has no ray.
    pub(crate) fn angle_rad(&self, pixel: [f64; 2]) -> Option<f64> {
        let [x, y, z] = self.direction(pixel)?;
        Some(libm::atan2(libm::hypot(x, y), self.facing * z))
    }

    /// Returns the pixel of the direction at an angle from the axis and an azimuth from the image's x axis
    /// towards y.
    pub(super) fn pixel_at(&self, angle_rad: f64, azimuth_rad: f64) -> Option<[f64; 2]> {
        let ((sin, cos), (y, x)) = (libm::sincos(angle_rad), libm::sincos(azimuth_rad));
        let direction = [sin * x, sin * y, self.facing * cos];
        let pixel = self.camera.project(direction.map(|c| FAR_M * c))?;
        self.in_image(pixel).then_some(pixel)
    }

    fn in_image(&self, [u, v]: [f64; 2]) -> bool {
        let (width, height) = self.size_px;
        (-0.5..=width as f64 - 0.5).contains(&u) && (-0.5..=height as f64 - 0.5).contains(&v)
    }

    /// Returns the outermost coordinates of the image: left, top, right, bottom.
    fn edges_px(&self) -> [f64; 4] {
        let (width, height) = self.size_px;
        [-0.5, -0.5, width as f64 - 0.5, height as f64 - 0.5]
    }

    /// Computes the fields of view along the middle row, the middle column and the wider diagonal.
    pub(super) fn fields_of_view_rad(&self) -> [f64; 3] {
        let [left, top, right, bottom] = self.edges_px();
        let [u, v] = [0.5 * (left + right), 0.5 * (top + bottom)];
        let diagonals = [
            self.visible_angle_rad([left, top], [right, bottom]),
            self.visible_angle_rad([left, bottom], [right, top]),
        ];
        [
            self.visible_angle_rad([left, v], [right, v]),
            self.visible_angle_rad([u, top], [u, bottom]),
            diagonals[0].max(diagonals[1]),
        ]
    }

    /// Computes the angle that the view covers along a line of the image, where its pixels have rays.
    fn visible_angle_rad(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        let length_px = libm::hypot(to[0] - from[0], to[1] - from[1]);
        let count = length_px.ceil() as usize;
        let at = |i: usize| interpolated(from, to, i as f64 / count as f64);
        let inside: Vec<usize> = (0..=count)
            .filter(|&i| self.direction(at(i)).is_some())
            .collect();
        let (Some(&first), Some(&last)) = (inside.first(), inside.last()) else {
            return 0.0;
        };
        // If the image circle ends between two pixels, the part up to its end counts.
        let begin = self.last_with_ray(at(first), at(first.saturating_sub(1)));
        let end = self.last_with_ray(at(last), at((last + 1).min(count)));
        let places = [begin]
            .into_iter()
            .chain(inside.into_iter().map(at))
            .chain([end]);
        let directions: Vec<_> = places.filter_map(|pixel| self.direction(pixel)).collect();
        directions
            .windows(2)
            .map(|pair| angle_between_rad(pair[0], pair[1]))
            .sum()
    }

    /// Finds the last point with a ray on the way from a point with a ray to one without.
    fn last_with_ray(&self, inside: [f64; 2], outside: [f64; 2]) -> [f64; 2] {
        if self.direction(outside).is_some() {
            return outside;
        }
        let (mut inside, mut outside) = (inside, outside);
        for _ in 0..BISECTIONS {
            let middle = interpolated(inside, outside, 0.5);
            if self.direction(middle).is_some() {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        inside
    }

    /// Returns `count` outermost pixels with a ray around the centre of the image; empty if the centre lies
    /// outside the image.
    pub(super) fn rim_px(&self, count: usize) -> Vec<[f64; 2]> {
        if !self.in_image(self.center_px) {
            return Vec::new();
        }
        let azimuths = (0..count).map(|i| std::f64::consts::TAU * i as f64 / count as f64);
        azimuths
            .filter_map(|azimuth| self.end_of_radius(self.image_end(azimuth)))
            .collect()
    }

    /// Returns the point where the half line from the centre leaves the image.
    fn image_end(&self, azimuth_rad: f64) -> [f64; 2] {
        let [left, top, right, bottom] = self.edges_px();
        let [u, v] = self.center_px;
        let (dv, du) = libm::sincos(azimuth_rad);
        let along = |d: f64, from: f64, low: f64, high: f64| match d {
            d if d > 0.0 => (high - from) / d,
            d if d < 0.0 => (low - from) / d,
            _ => f64::INFINITY,
        };
        let length = along(du, u, left, right).min(along(dv, v, top, bottom));
        [u + length * du, v + length * dv]
    }

    /// Returns the last pixel with a ray from the centre of the image to a point.
    fn end_of_radius(&self, to: [f64; 2]) -> Option<[f64; 2]> {
        let from = self.center_px;
        let count = libm::hypot(to[0] - from[0], to[1] - from[1])
            .ceil()
            .max(1.0) as usize;
        let at = |i: usize| interpolated(from, to, i as f64 / count as f64);
        let last = (0..=count)
            .rev()
            .find(|&i| self.direction(at(i)).is_some())?;
        Some(self.last_with_ray(at(last), at((last + 1).min(count))))
    }

    /// Computes the largest angle from the axis that is visible in the image.
    pub(super) fn largest_angle_rad(&self) -> f64 {
        let [left, top, right, bottom] = self.edges_px();
        let corners = [[left, top], [right, top], [left, bottom], [right, bottom]];
        let rim = self.rim_px(720);
        let angles = corners
            .iter()
            .chain(&rim)
            .filter_map(|&p| self.angle_rad(p));
        angles.fold(0.0, f64::max)
    }

    /// Computes the share of the image's pixels that have no ray.
    pub(super) fn share_without_ray(&self) -> f64 {
        let (width, height) = self.size_px;
        // A grid of a few hundred points per side is accurate enough.
        let step = (width.max(height) / 400).max(1);
        let (mut all, mut without) = (0_usize, 0_usize);
        for v in (0..height).step_by(step) {
            for u in (0..width).step_by(step) {
                all += 1;
                without += usize::from(self.direction([u as f64, v as f64]).is_none());
            }
        }
        without as f64 / all as f64
    }

    /// Samples the radius from the centre of the image to its farthest corner, as far as there are rays.
    pub(super) fn radius(&self) -> Vec<RadiusSample> {
        let [left, top, right, bottom] = self.edges_px();
        let [u, v] = self.center_px;
        let farther = |from: f64, a: f64, b: f64| if from - a > b - from { a } else { b };
        let Some(end) = self.end_of_radius([farther(u, left, right), farther(v, top, bottom)])
        else {
            return Vec::new();
        };
        let length_px = libm::hypot(end[0] - u, end[1] - v);
        let at = |radius_px: f64| interpolated([u, v], end, radius_px / length_px);
        let half_px = 0.25_f64.min(0.25 * length_px);
        let sample = |i: usize| {
            // One-sided differences at the ends would be less accurate than moving a quarter of a pixel
            // inwards.
            let share = i as f64 / RADIUS_SAMPLES as f64;
            let radius_px = (share * length_px).clamp(half_px, length_px - half_px);
            let angle_rad = self.angle_rad(at(radius_px))?;
            let before = self.angle_rad(at(radius_px - half_px))?;
            let after = self.angle_rad(at(radius_px + half_px))?;
            Some(RadiusSample {
                radius_px,
                angle_rad,
                radial_px_per_rad: 2.0 * half_px / (after - before).abs(),
                tangential_px_per_rad: radius_px / libm::sin(angle_rad).abs(),
            })
        };
        let fine = |s: &RadiusSample| {
            s.radial_px_per_rad.is_finite() && s.tangential_px_per_rad.is_finite()
        };
        (0..=RADIUS_SAMPLES)
            .filter_map(sample)
            .filter(fine)
            .collect()
    }
}

/// Interpolates linearly between two points.
fn interpolated(from: [f64; 2], to: [f64; 2], share: f64) -> [f64; 2] {
    [0, 1].map(|i| from[i] + share * (to[i] - from[i]))
}

/// Computes the angle between two unit vectors, accurately for small angles too.
fn angle_between_rad(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ];
    let sin = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
    let cos: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
    libm::atan2(sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::{Equidistant, Pinhole};

    #[test]
    fn fields_of_view_of_a_pinhole_are_exact() {
        let camera = Camera::Pinhole(Pinhole::new([500.0, 500.0], [319.5, 239.5], &[]).unwrap());
        let optics = Optics::new(&camera, (640, 480));
        let expected = [320.0_f64, 240.0, 400.0].map(|half| 2.0 * (half / 500.0).atan());
        for (seen, expected) in optics.fields_of_view_rad().iter().zip(expected) {
            assert!((seen - expected).abs() < 1e-9, "{seen} {expected}");
        }
        assert!((optics.largest_angle_rad() - 0.8_f64.atan()).abs() < 1e-9);
        assert_eq!(optics.share_without_ray(), 0.0);
        // r = f tan a: f / cos² a radially, f / cos a tangentially.
        let radius = optics.radius();
        let last = radius.last().unwrap();
        let cos = last.angle_rad.cos();
        assert!((last.radial_px_per_rad - 500.0 / (cos * cos)).abs() < 1e-2);
        assert!((last.tangential_px_per_rad - 500.0 / cos).abs() < 1e-6);
    }

    #[test]
    fn the_circle_of_a_fisheye_ends_at_its_field_of_view() {
        let max_angle_rad = 92.5_f64.to_radians();
        let f = 145.562_250_654_857_8;
        let camera = Equidistant::new(f, [319.5, 239.5], max_angle_rad).unwrap();
        let camera = Camera::Equidistant(camera);
        let optics = Optics::new(&camera, (640, 480));
        for seen in optics.fields_of_view_rad() {
            assert!((seen - 2.0 * max_angle_rad).abs() < 1e-3, "{seen}");
        }
        let rim = optics.rim_px(36);
        assert_eq!(rim.len(), 36);
        for [u, v] in rim {
            let radius_px = (u - 319.5).hypot(v - 239.5);
            assert!((radius_px - f * max_angle_rad).abs() < 2e-3, "{radius_px}");
        }
        let circle = std::f64::consts::PI * (f * max_angle_rad).powi(2) / (640.0 * 480.0);
        assert!((optics.share_without_ray() - (1.0 - circle)).abs() < 1e-3);
        let [u, v] = optics.pixel_at(1.0, std::f64::consts::FRAC_PI_2).unwrap();
        assert!((u - 319.5).abs() < 1e-9 && (v - 239.5 - f).abs() < 1e-9);
    }
}
