//! The ball at a pixel that was pointed at, before its colours are known: the outline all around which the colours inside differ most from those outside.
//! Shading, highlights and patterns within a ball do not matter, and of what touches it only little.

use pardalis::Frame;
use pardalis::shape::{Shape, Sphere, SphereOutline, Stance};
use pardalis_camera::{Camera, Pose};

use super::balls::Circle;

/// The radius of the ball, metres. Any would do: with one camera it only scales the distance.
const RADIUS_M: f64 = 0.1;
/// Points of an outline at which colours are compared.
const POINTS: usize = 32;
/// Points of the outline that is returned.
const OUTLINE_POINTS: usize = 48;
/// Where colours are compared on either side of the outline, as shares of the radius ...
const DEPTHS: [f64; 3] = [0.06, 0.12, 0.18];
/// ... but at least this many pixels further each.
const MIN_STEP_PX: f64 = 0.8;
/// A difference of colour that counts one half: of chroma plus a part of that of brightness, each from 0 to 255. Hand-set: noise has 4, a ball and its
/// surroundings differ by 30 and more.
const HALF_DIFFERENCE: f32 = 20.0;
/// The weight of differences of brightness, which light and shade change. Hand-set.
const BRIGHTNESS_WEIGHT: f32 = 0.3;
/// The least contrast of a ball, the mean over the half of the outline that has less. Hand-set: balls before what has another colour have 0.5 and more.
const MIN_CONTRAST: f32 = 0.3;
/// The smallest ball that is looked for at a click, in pixels, and the largest, as a share of the shorter side of the image.
#[cfg(any(feature = "studio", test))]
const MIN_RADIUS_PX: f64 = 2.5;
#[cfg(any(feature = "studio", test))]
const MAX_RADIUS_SHARE: f64 = 0.4;
/// How much larger the next radius is, and how far the next centre is, in radii.
const RADIUS_RATIO: f64 = 1.12;
const CENTER_STEP: f64 = 0.15;
/// The candidates that are refined, and the last step of that, in radii.
const REFINED: usize = 8;
const LAST_STEP: f64 = 0.01;

/// Where a ball is looked for.
pub(super) struct Search {
    /// A pixel on the ball.
    pub(super) at: [f64; 2],
    /// How far its centre may be from this, in radii.
    pub(super) off_radii: f64,
    pub(super) radius_px: std::ops::RangeInclusive<f64>,
}

impl Search {
    /// Returns that for a ball of any size at a click.
    #[cfg(any(feature = "studio", test))]
    pub(super) fn around(frame: &Frame, at: [f64; 2]) -> Self {
        let side = frame.width().min(frame.height()) as f64;
        Self {
            at,
            off_radii: 0.85,
            radius_px: MIN_RADIUS_PX..=MAX_RADIUS_SHARE * side,
        }
    }
}

/// Returns the outline of the ball, as a camera shows it; `None` if the colours differ nowhere all around.
pub(super) fn ball_of_contrast(
    frame: &Frame,
    camera: &Camera,
    search: &Search,
) -> Option<Vec<[f64; 2]>> {
    let image = Image::of(frame, camera);
    let mut found: Vec<(f32, Circle)> = Vec::new();
    let mut radius_px = *search.radius_px.start();
    while radius_px <= *search.radius_px.end() {
        let steps = (search.off_radii / CENTER_STEP) as i32;
        for (i, j) in (-steps..=steps).flat_map(|i| (-steps..=steps).map(move |j| (i, j))) {
            let [i, j] = [i, j].map(|step| f64::from(step) * CENTER_STEP * radius_px);
            let circle = Circle {
                center_px: [search.at[0] + i, search.at[1] + j],
                radius_px,
            };
            if libm::hypot(i, j) <= search.off_radii * radius_px
                && let Some(contrast) = image.contrast(&circle)
            {
                found.push((contrast, circle));
            }
        }
        radius_px *= RADIUS_RATIO;
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let refined = found.into_iter().take(REFINED);
    let refined = refined.map(|(contrast, circle)| image.refined(contrast, circle));
    let (contrast, circle) = refined.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if contrast < MIN_CONTRAST {
        return None;
    }
    image.outline(&circle, OUTLINE_POINTS)
}

/// An image of a camera, for comparisons of colours.
struct Image<'a> {
    size: (usize, usize),
    /// Brightness and two differences of channels.
    colors: Vec<[f32; 3]>,
    camera: &'a Camera,
    ball: Shape,
}

impl<'a> Image<'a> {
    fn of(frame: &Frame, camera: &'a Camera) -> Self {
        let rgb = frame.to_rgb8();
        let (pixels, _) = rgb.as_chunks::<3>();
        let ball = Sphere::new(RADIUS_M, SphereOutline::Tangent);
        Self {
            size: (frame.width(), frame.height()),
            colors: pixels.iter().map(|rgb| opponent(*rgb)).collect(),
            camera,
            ball: Shape::Sphere(ball.unwrap_or_else(|_| unreachable!("it has a radius"))),
        }
    }

    /// Returns the outline of the ball whose centre is seen at that of a circle, and whose outline encloses about its area.
    fn outline(&self, circle: &Circle, count: usize) -> Option<Vec<[f64; 2]>> {
        let ray = self.camera.unproject(circle.center_px)?;
        let mut distance_m = 20.0 * RADIUS_M;
        let mut outline = Vec::new();
        for _ in 0..3 {
            let position_m =
                [0, 1, 2].map(|axis| ray.origin[axis] + distance_m * ray.direction[axis]);
            let pose = Pose::identity();
            let stance = Stance::default();
            let points = self
                .ball
                .outline_px(self.camera, &pose, position_m, stance, count);
            outline = points.into_iter().collect::<Option<Vec<_>>>()?;
            let radius_px = Circle::of_outline(&outline)?.radius_px;
            distance_m = (distance_m * radius_px / circle.radius_px).max(1.1 * RADIUS_M);
        }
        Some(outline)
    }

    /// Returns how much the colours inside and outside differ along the less contrasting half of the outline, from 0 to 1.
    fn contrast(&self, circle: &Circle) -> Option<f32> {
        let outline = self.outline(circle, POINTS)?;
        let Circle {
            center_px,
            radius_px,
        } = Circle::of_outline(&outline)?;
        let mean = |[u, v]: [f64; 2], sign: f64| {
            let mut sum = [0.0; 3];
            for (number, depth) in DEPTHS.into_iter().enumerate() {
                let least = MIN_STEP_PX * (number + 1) as f64 / radius_px;
                let scale = 1.0 + sign * depth.max(least);
                let color = self.color([
                    center_px[0] + scale * (u - center_px[0]),
                    center_px[1] + scale * (v - center_px[1]),
                ]);
                sum = [0, 1, 2].map(|i| sum[i] + color[i]);
            }
            sum.map(|channel| channel / DEPTHS.len() as f32)
        };
        let mut contrasts: Vec<f32> = outline
            .iter()
            .map(|at| {
                let (inside, outside) = (mean(*at, -1.0), mean(*at, 1.0));
                let [brightness, a, b] = [0, 1, 2].map(|i| inside[i] - outside[i]);
                let difference = libm::sqrtf(a * a + b * b) + BRIGHTNESS_WEIGHT * brightness.abs();
                difference / (difference + HALF_DIFFERENCE)
            })
            .collect();
        contrasts.sort_by(f32::total_cmp);
        let half = &contrasts[..POINTS / 2];
        Some(half.iter().sum::<f32>() / half.len() as f32)
    }

    /// Returns the colour of the nearest pixel.
    fn color(&self, [u, v]: [f64; 2]) -> [f32; 3] {
        let (width, height) = self.size;
        let inside = |at: f64, side: usize| (at.round().max(0.0) as usize).min(side - 1);
        self.colors[inside(v, height) * width + inside(u, width)]
    }

    /// Moves a circle, and changes its size, for as long as that increases the contrast.
    fn refined(&self, mut contrast: f32, mut circle: Circle) -> (f32, Circle) {
        let mut step = 0.5 * CENTER_STEP;
        while step >= LAST_STEP {
            let before = contrast;
            for (du, dv, dr) in [
                (1, 0, 0),
                (-1, 0, 0),
                (0, 1, 0),
                (0, -1, 0),
                (0, 0, 1),
                (0, 0, -1),
            ] {
                let [du, dv, dr] =
                    [du, dv, dr].map(|sign| f64::from(sign) * step * circle.radius_px);
                let other = Circle {
                    center_px: [circle.center_px[0] + du, circle.center_px[1] + dv],
                    radius_px: circle.radius_px + dr,
                };
                if let Some(better) = self.contrast(&other).filter(|other| *other > contrast) {
                    (contrast, circle) = (better, other);
                }
            }
            if contrast == before {
                step *= 0.5;
            }
        }
        (contrast, circle)
    }
}

/// Returns brightness and two differences of channels, relative to the brightness so that shade changes them little.
fn opponent([r, g, b]: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = [r, g, b].map(f32::from);
    let brightness = (r + g + b) / 3.0;
    // Dark pixels have no reliable colour.
    let scale = 255.0 / (brightness + 64.0);
    [
        brightness,
        0.5 * (r - g) * scale,
        0.25 * (r + g - 2.0 * b) * scale,
    ]
}

#[cfg(test)]
mod tests {
    use pardalis_camera::Pinhole;

    use super::*;

    /// A ball, lit from above, with a highlight, before a background that varies.
    fn ball([u, v, radius]: [f64; 3], color: [f64; 3]) -> Frame {
        let pixel = |i: usize| {
            let (x, y) = ((i % 160) as f64, (i / 160) as f64);
            let (dx, dy) = (x - u, y - v);
            let noise = ((i * 7919) % 13) as f64 - 6.0;
            let rgb = if dx.hypot(dy) >= radius {
                [90.0, 100.0 + 0.2 * x, 95.0]
            } else if (dx + 0.3 * radius).hypot(dy + 0.3 * radius) < 0.2 * radius {
                [250.0, 245.0, 240.0]
            } else {
                color.map(|channel| channel * (0.75 - 0.25 * dy / radius))
            };
            rgb.map(|channel| (channel + noise).clamp(0.0, 255.0) as u8)
        };
        let pixels: Vec<u8> = (0..160 * 120).flat_map(pixel).collect();
        Frame::from_rgb(160, 120, pixels, 0.0).unwrap()
    }

    fn found(frame: &Frame, at: [f64; 2]) -> Option<Circle> {
        let lens = Pinhole::new([150.0; 2], [79.5, 59.5], &[]).unwrap().into();
        let outline = ball_of_contrast(frame, &lens, &Search::around(frame, at));
        outline.map(|outline| Circle::of_outline(&outline).unwrap())
    }

    #[test]
    fn the_outline_of_a_shaded_ball_is_found_wherever_it_is_pointed_at() {
        for color in [
            [240.0, 120.0, 20.0],
            [30.0, 60.0, 230.0],
            [240.0, 240.0, 30.0],
        ] {
            for [u, v, radius] in [[80.0, 60.0, 20.0], [40.0, 70.0, 8.0], [100.0, 50.0, 40.0]] {
                let frame = ball([u, v, radius], color);
                for at in [[u, v], [u + 0.5 * radius, v], [u, v + 0.7 * radius]] {
                    let found = found(&frame, at).unwrap();
                    let off = (found.center_px[0] - u).hypot(found.center_px[1] - v);
                    assert!(off < 0.1 * radius, "{color:?} {radius} {at:?}: {found:?}");
                    let size = found.radius_px / radius;
                    assert!(
                        (0.9..1.1).contains(&size),
                        "{color:?} {radius} {at:?}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_touches_a_ball_and_has_a_similar_colour_is_no_part_of_it() {
        let frame = ball([80.0, 60.0, 20.0], [240.0, 120.0, 20.0]);
        let mut rgb = frame.to_rgb8();
        for (x, y) in (95..150).flat_map(|x| (58..62).map(move |y| (x, y))) {
            rgb[3 * (y * 160 + x)..][..3].copy_from_slice(&[190, 95, 20]);
        }
        let frame = Frame::from_rgb(160, 120, rgb, 0.0).unwrap();
        let found = found(&frame, [80.0, 60.0]).unwrap();
        let off = (found.center_px[0] - 80.0).hypot(found.center_px[1] - 60.0);
        assert!(
            off < 1.5 && (found.radius_px - 20.0).abs() < 1.5,
            "{found:?}"
        );
    }

    #[test]
    fn where_nothing_is_round_nothing_is_found() {
        let frame = ball([80.0, 60.0, 20.0], [240.0, 120.0, 20.0]);
        // The background, and beyond the image.
        for at in [[10.0, 10.0], [-50.0, 4.0]] {
            assert_eq!(found(&frame, at), None, "{at:?}");
        }
        let bar = |i: usize| match (i % 160, i / 160) {
            (20..140, 50..58) => [240_u8, 120, 20],
            _ => [90, 100, 95],
        };
        let pixels: Vec<u8> = (0..160 * 120).flat_map(bar).collect();
        let frame = Frame::from_rgb(160, 120, pixels, 0.0).unwrap();
        assert_eq!(found(&frame, [80.0, 54.0]), None);
    }
}
