//! The box around a body as a camera sees it.

use nalgebra::{Point3, Vector3};

use crate::shape::{Flat, FlatForm, OutlineCircle, Section, Shape, Sphere, Upright};
use crate::view::View;

/// Points on a round outline. Derivation: the ellipse through the outermost three has its extreme.
const AROUND: usize = 16;
/// Cosine and sine of the angle between two of them.
const COS_STEP: f64 = 0.923_879_532_511_286_7;
const SIN_STEP: f64 = 0.382_683_432_365_089_8;

/// A body, with the points that determine the box around its outline.
#[derive(Debug, Clone)]
pub(in crate::tracker) struct BodyBox {
    points: Points,
    /// The height of its middle above its position, metres.
    middle_m: f64,
    /// The directions of the points of a round outline: cosine and sine.
    around: [[f64; 2]; AROUND],
}

#[derive(Debug, Clone)]
enum Points {
    Sphere(Sphere),
    /// Rims of an upright or flat body, whose hull it is: points relative to its position, metres, as many on each rim.
    Rims {
        points_m: Vec<[f64; 3]>,
        is_round: bool,
    },
}

impl BodyBox {
    pub(in crate::tracker) fn new(shape: &Shape) -> Self {
        let around = std::array::from_fn(|i| {
            let angle = i as f64 / AROUND as f64 * std::f64::consts::TAU;
            let (sin, cos) = libm::sincos(angle);
            [cos, sin]
        });
        let points = match shape {
            Shape::Sphere(sphere) => Points::Sphere(*sphere),
            Shape::Upright(Upright {
                section, height_m, ..
            }) => {
                let (rim, is_round) = rim_of_section(section, &around);
                // One in the middle, because lenses bend the sides.
                Points::rims(&rim, &[0.0, 0.5 * height_m, *height_m], is_round)
            }
            Shape::Flat(Flat { form, height_m }) => {
                let (rim, is_round) = match form {
                    FlatForm::Disc { radius_m } => (circle(*radius_m, &around), true),
                    FlatForm::Rectangle { size_m } => (rectangle(*size_m), false),
                };
                Points::rims(&rim, &[*height_m], is_round)
            }
        };
        Self {
            points,
            middle_m: shape.middle_height_m(),
            around,
        }
    }

    /// The height of the body's middle above its position, metres.
    pub(in crate::tracker) fn middle_m(&self) -> f64 {
        self.middle_m
    }

    /// Returns the left, top, right and bottom side of the box around the body at a position (metres), larger than its description by a factor, in pixels. It may lie
    /// outside of the image. `None` if a part of the body has no pixel.
    pub(in crate::tracker) fn sides_px(
        &self,
        view: &View,
        position_m: [f64; 3],
        scale: f64,
    ) -> Option<[f64; 4]> {
        let camera = view.camera();
        let pose = view.camera_from_world();
        let mut sides = Sides::EMPTY;
        match &self.points {
            Points::Sphere(sphere) => {
                let viewpoint = Vector3::from(camera.viewpoint_m());
                let center = (pose * Point3::from(position_m)).coords - viewpoint;
                let radius_m = scale * sphere.radius_m;
                let (circle, is_outside) =
                    OutlineCircle::of_sphere(center.into(), radius_m, sphere.outline);
                if !is_outside {
                    return None;
                }
                let mut pixels = [[0.0; 2]; AROUND];
                for (pixel, [cos, sin]) in pixels.iter_mut().zip(self.around) {
                    let point = Vector3::from(circle.point(cos, sin)) + viewpoint;
                    *pixel = camera.project(point.into())?;
                }
                sides.add_round(&pixels);
            }
            Points::Rims { points_m, is_round } => {
                let position = Vector3::from(position_m);
                let pixel = |&[x, y, z]: &[f64; 3]| {
                    let height = self.middle_m + scale * (z - self.middle_m);
                    let point = position + Vector3::new(scale * x, scale * y, height);
                    camera.project((pose * Point3::from(point)).into())
                };
                if *is_round {
                    for rim in points_m.chunks_exact(AROUND) {
                        let mut pixels = [[0.0; 2]; AROUND];
                        for (to, point) in pixels.iter_mut().zip(rim) {
                            *to = pixel(point)?;
                        }
                        sides.add_round(&pixels);
                    }
                } else {
                    for point in points_m {
                        sides.add(pixel(point)?);
                    }
                }
            }
        }
        Some(sides.0)
    }
}

impl Points {
    fn rims(rim_m: &[[f64; 2]], heights_m: &[f64], is_round: bool) -> Self {
        let at = |&height_m: &f64| rim_m.iter().map(move |&[x, y]| [x, y, height_m]);
        Self::Rims {
            points_m: heights_m.iter().flat_map(at).collect(),
            is_round,
        }
    }
}

fn circle(radius_m: f64, around: &[[f64; 2]; AROUND]) -> Vec<[f64; 2]> {
    around
        .iter()
        .map(|direction| direction.map(|v| radius_m * v))
        .collect()
}

fn rectangle(size_m: [f64; 2]) -> Vec<[f64; 2]> {
    let [x, y] = size_m.map(|size_m| 0.5 * size_m);
    with_middles(&[[x, y], [-x, y], [-x, -y], [x, -y]])
}

/// Corners with the middles of the sides between them, because lenses bend the sides.
fn with_middles(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let pairs = corners.iter().zip(corners.iter().cycle().skip(1));
    let side = |(a, b): (&[f64; 2], &[f64; 2])| [*a, [0, 1].map(|axis| 0.5 * (a[axis] + b[axis]))];
    pairs.flat_map(side).collect()
}

/// The rim of a section, and whether it is round.
fn rim_of_section(section: &Section, around: &[[f64; 2]; AROUND]) -> (Vec<[f64; 2]>, bool) {
    match *section {
        Section::Circle { radius_m } => (circle(radius_m, around), true),
        Section::Rectangle { size_m } => (rectangle(size_m), false),
        Section::Polygon {
            sides,
            apothem_m,
            turn,
        } => {
            let radius_m = apothem_m / libm::cos(std::f64::consts::PI / sides as f64);
            let corner = |k: usize| {
                let turns = turn + k as f64 / sides as f64;
                let (sin, cos) = libm::sincos(turns * std::f64::consts::TAU);
                [radius_m * cos, radius_m * sin]
            };
            let corners: Vec<[f64; 2]> = (0..sides).map(corner).collect();
            (with_middles(&corners), false)
        }
    }
}

/// Left, top, right and bottom side.
struct Sides([f64; 4]);

impl Sides {
    const EMPTY: Self = Self([
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ]);

    fn add(&mut self, pixel: [f64; 2]) {
        for axis in 0..2 {
            self.0[axis] = self.0[axis].min(pixel[axis]);
            self.0[axis + 2] = self.0[axis + 2].max(pixel[axis]);
        }
    }

    /// Adds points around a smooth outline.
    fn add_round(&mut self, pixels: &[[f64; 2]; AROUND]) {
        for axis in 0..2 {
            let (mut least, mut most) = (0, 0);
            for i in 1..AROUND {
                if pixels[i][axis] < pixels[least][axis] {
                    least = i;
                }
                if pixels[i][axis] > pixels[most][axis] {
                    most = i;
                }
            }
            // Of the ellipse through the outermost point and its neighbours: m + a·cos φ + b·sin φ.
            let vertex = |i: usize| {
                let at = |i: usize| pixels[i % AROUND][axis];
                let [before, here, after] = [at(i + AROUND - 1), at(i), at(i + 1)];
                let a = (here - 0.5 * (before + after)) / (1.0 - COS_STEP);
                let b = (after - before) / (2.0 * SIN_STEP);
                here - a + libm::sqrt(a * a + b * b).copysign(a)
            };
            self.0[axis] = self.0[axis].min(vertex(least));
            self.0[axis + 2] = self.0[axis + 2].max(vertex(most));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::{SphereOutline, Stance, UprightOutline};
    use pardalis_camera::{Camera, Equidistant, Pinhole, Pose};

    fn views() -> [View; 2] {
        let pinhole = Pinhole::new([300.0, 310.0], [160.0, 120.0], &[]).unwrap();
        let fisheye = Equidistant::new(100.0, [160.0, 120.0], 1.5).unwrap();
        // Looks along the world's x axis, from 1.2 m above the ground.
        let axes = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
            0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
        ));
        let pose = Pose::from_parts(nalgebra::Translation3::new(0.0, 0.0, 1.2), axes);
        let of = |camera: Camera| View::new(camera, pose, (320, 240), None).unwrap();
        [of(pinhole.into()), of(fisheye.into())]
    }

    #[test]
    fn boxes_hold_fine_outlines() {
        let ball = Shape::Sphere(Sphere::new(0.3, SphereOutline::Tangent).unwrap());
        let upright =
            |section| Shape::Upright(Upright::new(section, 1.7, UprightOutline::Exact).unwrap());
        let shapes = [
            ball,
            upright(Section::circle(0.3).unwrap()),
            upright(Section::rectangle([0.8, 0.4]).unwrap()),
            upright(Section::polygon(5, 0.7, 0.2).unwrap()),
            Shape::Flat(Flat::disc(0.4, 0.1).unwrap()),
            Shape::Flat(Flat::rectangle([0.5, 1.1], 0.0).unwrap()),
        ];
        for shape in shapes {
            for view in views() {
                for position_m in [[3.0, 0.2, 0.0], [2.0, -1.1, 0.0], [6.0, 2.5, 0.0]] {
                    for scale in [1.0, 1.2] {
                        let found = BodyBox::new(&shape).sides_px(&view, position_m, scale);
                        let outline = shape.outline_px(
                            view.camera(),
                            view.camera_from_world(),
                            position_m,
                            Stance::scaled(scale),
                            4000,
                        );
                        let mut fine = Sides::EMPTY;
                        for pixel in outline {
                            fine.add(pixel.unwrap());
                        }
                        let [u0, v0, u1, v1] = fine.0;
                        // A quarter of a usual box's standard deviation: lenses bend the sides of upright bodies.
                        let most = 0.0125 * ((u1 - u0) * (v1 - v0)).sqrt();
                        for (found, fine) in found.unwrap().into_iter().zip(fine.0) {
                            assert!((found - fine).abs() < most, "{shape:?} {found} {fine}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn bodies_behind_the_camera_have_no_box() {
        let ball = Shape::Sphere(Sphere::new(0.3, SphereOutline::Tangent).unwrap());
        let [pinhole, fisheye] = views();
        let ball = BodyBox::new(&ball);
        assert_eq!(ball.sides_px(&pinhole, [-3.0, 0.0, 1.2], 1.0), None);
        assert_eq!(ball.sides_px(&fisheye, [-3.0, 0.0, 1.2], 1.0), None);
        assert_eq!(
            ball.sides_px(&fisheye, [0.1, 0.0, 1.2], 1.0),
            None,
            "inside"
        );
    }
}
