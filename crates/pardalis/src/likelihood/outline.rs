//! The projection kernel of the contour cue: the outlines of a block of particles in a camera's image.

use crate::rolling_shutter::RowMotion;
use crate::shape::{
    OutlineCircle, OutlinePoint, Shape, Sides, SidesKind, SphereOutline, Stance, VisibleBody,
};
use crate::view::View;
use pardalis_camera::{LANES, project_block, with_model};
use pardalis_core::simd::Level;

/// One point of each outline of a block, in the camera frame; NaN if it does not exist.
pub(super) type Points = [[f32; LANES]; 3];
/// Image coordinates of such points, u and then v; NaN outside the camera's domain.
pub(super) type Coordinates = [[f32; LANES]; 2];

/// A camera's pose in single precision.
#[derive(Debug)]
pub(super) struct Projector<'a> {
    view: &'a View,
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    /// The point that outlines are seen from, in the camera frame and in the world.
    viewpoint: [f32; 3],
    viewpoint_in_world: [f32; 3],
    /// The matrix and the offset that map places in the camera frame to where they are shown, for a body in motion and a rolling shutter.
    motion: Option<([[f32; 3]; 3], [f32; 3])>,
}

impl<'a> Projector<'a> {
    pub(super) fn new(view: &'a View) -> Self {
        Self::moving(view, None)
    }

    /// The projector of a body that moves while the rows of a rolling shutter are exposed.
    pub(super) fn moving(view: &'a View, motion: Option<&RowMotion>) -> Self {
        let motion = motion.map(|motion| {
            let (matrix, offset_m) = motion.shown_from_true();
            let single = |row: usize| [0, 1, 2].map(|column| matrix[(row, column)] as f32);
            ([0, 1, 2].map(single), [0, 1, 2].map(|i| offset_m[i] as f32))
        });
        let pose = view.camera_from_world();
        let viewpoint = nalgebra::Point3::from(view.camera().viewpoint_m());
        let in_world = view.world_from_camera() * viewpoint;
        let single = |point: nalgebra::Point3<f64>| [0, 1, 2].map(|i| point[i] as f32);
        Self {
            view,
            rotation: [0, 1, 2].map(|i| [0, 1, 2].map(|j| pose.rotation[(i, j)] as f32)),
            translation: [0, 1, 2].map(|i| pose.translation.vector[i] as f32),
            viewpoint: single(viewpoint),
            viewpoint_in_world: single(in_world),
            motion,
        }
    }

    /// Projects a block of world positions to image coordinates.
    pub(super) fn project(&self, level: Level, positions: &[[f32; LANES]; 3]) -> Coordinates {
        let mut coordinates = [[f32::NAN; LANES]; 2];
        with_model!(self.view.camera(), model => {
            let model = model.to_f32();
            level.run(
                #[inline(always)]
                || {
                    let mut block = [[0.0; LANES]; 3];
                    for lane in 0..LANES {
                        let [x, y, z] =
                            self.in_camera([positions[0][lane], positions[1][lane], positions[2][lane]]);
                        block[0][lane] = x;
                        block[1][lane] = y;
                        block[2][lane] = z;
                    }
                    coordinates = project_block(&model, &self.shown(&block));
                },
            );
        });
        coordinates
    }

    /// Projects blocks of points in the camera frame to image coordinates.
    pub(super) fn project_all(
        &self,
        level: Level,
        points: &[Points],
        coordinates: &mut [Coordinates],
    ) {
        with_model!(self.view.camera(), model => {
            let model = model.to_f32();
            level.run(
                #[inline(always)]
                || {
                    for (points, coordinates) in points.iter().zip(coordinates) {
                        *coordinates = project_block(&model, &self.shown(points));
                    }
                },
            );
        });
    }

    /// Writes, in the camera frame, the points at the given offsets from each world position. The offsets are
    /// scaled and turned along x and y; the height is not.
    #[inline(always)]
    pub(super) fn write_offset_points(
        &self,
        positions: &[[f32; LANES]; 3],
        stance: Stance,
        offsets_m: &[[f32; 2]],
        height_m: f32,
        points: &mut [Points],
    ) {
        let [cos, sin] = stance.scaled_direction().map(|v| v as f32);
        for (&[dx, dy], points) in offsets_m.iter().zip(points) {
            let (dx, dy) = (cos * dx - sin * dy, sin * dx + cos * dy);
            let mut block = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let [x, y, z] = self.in_camera([
                    positions[0][lane] + dx,
                    positions[1][lane] + dy,
                    positions[2][lane] + height_m,
                ]);
                block[0][lane] = x;
                block[1][lane] = y;
                block[2][lane] = z;
            }
            *points = block;
        }
    }

    /// Turns the first of each block of points in the camera frame about the vertical through a place in the world, by this angle in radians; the second becomes the same
    /// turned the other way.
    pub(super) fn turn_points(&self, center: [f32; 3], angle_rad: f64, points: &mut [Points]) {
        let (sin, cos) = libm::sincos(angle_rad);
        let (sin, cos) = (sin as f32, cos as f32);
        let center = self.in_camera(center);
        let [x_axis, y_axis] = [0, 1].map(|axis| self.rotation.map(|row| row[axis]));
        let along =
            |axis: &[f32; 3], v: &[f32; 3]| -> f32 { axis.iter().zip(v).map(|(a, b)| a * b).sum() };
        for point in points {
            let off = [0, 1, 2].map(|i| point[i][0] - center[i]);
            let (x, y) = (along(&x_axis, &off), along(&y_axis, &off));
            for (lane, sin) in [sin, -sin].into_iter().enumerate() {
                let (dx, dy) = ((cos - 1.0) * x - sin * y, sin * x + (cos - 1.0) * y);
                for i in 0..3 {
                    point[i][lane] = center[i] + off[i] + dx * x_axis[i] + dy * y_axis[i];
                }
            }
        }
    }

    /// Where places in the camera frame are shown.
    #[inline(always)]
    fn shown(&self, places: &Points) -> Points {
        let Some((matrix, offset)) = &self.motion else {
            return *places;
        };
        let mut shown = *places;
        for lane in 0..LANES {
            for axis in 0..3 {
                let [m0, m1, m2] = matrix[axis];
                let [x, y, z] = [0, 1, 2].map(|i| places[i][lane]);
                shown[axis][lane] = m0 * x + m1 * y + m2 * z + offset[axis];
            }
        }
        shown
    }

    #[inline(always)]
    fn in_camera(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let along = |i: usize| {
            let [r0, r1, r2] = self.rotation[i];
            r0 * x + r1 * y + r2 * z + self.translation[i]
        };
        [along(0), along(1), along(2)]
    }
}

/// A shape, with the quantities that do not depend on the particle.
#[derive(Debug)]
pub(super) enum OutlineKernel {
    /// A sphere, with the cosine and sine of each point's angle.
    Sphere {
        radius_m: f64,
        outline: SphereOutline,
        angles: Vec<(f32, f32)>,
    },
    /// An upright body, with the position of each point on it.
    Upright {
        upright: crate::shape::Upright,
        outline_points: Vec<OutlinePoint<f32>>,
    },
    /// A flat shape, with the unscaled offset of each point from the position.
    Flat {
        offsets_m: Vec<[f32; 2]>,
        height_m: f32,
    },
}

impl OutlineKernel {
    pub(super) fn new(shape: Shape, points: usize) -> Self {
        match shape {
            Shape::Sphere(sphere) => Self::Sphere {
                radius_m: sphere.radius_m,
                outline: sphere.outline,
                angles: (0..points)
                    .map(|k| {
                        let angle = k as f64 / points as f64 * std::f64::consts::TAU;
                        let (sin, cos) = libm::sincos(angle);
                        (cos as f32, sin as f32)
                    })
                    .collect(),
            },
            Shape::Upright(upright) => Self::Upright {
                upright,
                outline_points: upright.outline_points(points),
            },
            Shape::Flat(flat) => Self::Flat {
                offsets_m: flat
                    .outline_points_m(points)
                    .into_iter()
                    .map(|outline_point| outline_point.map(|v| v as f32))
                    .collect(),
                height_m: flat.height_m as f32,
            },
        }
    }

    /// Writes the image coordinates of the outlines of the shape in a stance at the given world positions, one
    /// element per point. `points` has the same length and holds intermediate results.
    pub(super) fn project(
        &self,
        level: Level,
        projector: &Projector,
        positions: &[[f32; LANES]; 3],
        stance: Stance,
        points: &mut [Points],
        coordinates: &mut [Coordinates],
    ) {
        match self {
            Self::Sphere {
                radius_m,
                outline,
                angles,
            } => level.run(
                #[inline(always)]
                || {
                    let radius_m = (stance.scale * radius_m) as f32;
                    let circles = Circles::new(projector, positions, radius_m, *outline);
                    for (point, angle) in points.iter_mut().zip(angles) {
                        circles.write_points(*angle, point);
                    }
                },
            ),
            Self::Upright {
                upright,
                outline_points,
            } => {
                let sides = upright.sides(stance);
                level.run(
                    #[inline(always)]
                    || {
                        let bodies = Bodies::new(projector, positions, sides);
                        match sides.kind() {
                            SidesKind::Round => bodies.write(outline_points, points, Sides::round),
                            SidesKind::Corners { .. } => {
                                bodies.write(outline_points, points, Sides::cornered);
                            }
                            SidesKind::Rectangle { .. } => {
                                bodies.write(outline_points, points, Sides::rectangular);
                            }
                            SidesKind::Flat => {
                                bodies.write(outline_points, points, |_, seen, outline_point| {
                                    Sides::flat(seen, outline_point)
                                });
                            }
                        }
                    },
                );
            }
            Self::Flat {
                offsets_m,
                height_m,
            } => level.run(
                #[inline(always)]
                || {
                    projector.write_offset_points(positions, stance, offsets_m, *height_m, points);
                },
            ),
        }
        projector.project_all(level, points, coordinates);
    }
}

/// Outlines of spheres: centres and two perpendicular radii.
struct Circles {
    center: [[f32; LANES]; 3],
    a: [[f32; LANES]; 3],
    b: [[f32; LANES]; 3],
}

impl Circles {
    #[inline(always)]
    fn new(
        projector: &Projector,
        positions: &[[f32; LANES]; 3],
        radius_m: f32,
        outline: SphereOutline,
    ) -> Self {
        let mut circles = Self {
            center: [[0.0; LANES]; 3],
            a: [[0.0; LANES]; 3],
            b: [[0.0; LANES]; 3],
        };
        let viewpoint = projector.viewpoint;
        for lane in 0..LANES {
            let [x, y, z] =
                projector.in_camera([positions[0][lane], positions[1][lane], positions[2][lane]]);
            let from_viewpoint = [x - viewpoint[0], y - viewpoint[1], z - viewpoint[2]];
            let (circle, outside) = OutlineCircle::of_sphere(from_viewpoint, radius_m, outline);
            for axis in 0..3 {
                let center = circle.center[axis] + viewpoint[axis];
                circles.center[axis][lane] = if outside { center } else { f32::NAN };
                circles.a[axis][lane] = circle.a[axis];
                circles.b[axis][lane] = circle.b[axis];
            }
        }
        circles
    }

    /// Writes the points at the angle with the given cosine and sine.
    #[inline(always)]
    fn write_points(&self, (cos, sin): (f32, f32), points: &mut Points) {
        for (axis, point) in points.iter_mut().enumerate() {
            for lane in 0..LANES {
                point[lane] =
                    self.center[axis][lane] + cos * self.a[axis][lane] + sin * self.b[axis][lane];
            }
        }
    }
}

/// Upright bodies as seen from the camera.
struct Bodies<'a> {
    sides: Sides<f32>,
    seen: [[f32; LANES]; VisibleBody::<f32>::FIELDS],
    projector: &'a Projector<'a>,
}

impl<'a> Bodies<'a> {
    #[inline(always)]
    fn new(projector: &'a Projector<'a>, positions: &[[f32; LANES]; 3], sides: Sides<f32>) -> Self {
        let mut fields = [[0.0; LANES]; VisibleBody::<f32>::FIELDS];
        for lane in 0..LANES {
            let position = [positions[0][lane], positions[1][lane], positions[2][lane]];
            let (seen, outside) = sides.seen_from(position, projector.viewpoint_in_world);
            for (field, value) in fields.iter_mut().zip(seen.to_fields()) {
                field[lane] = if outside { value } else { f32::NAN };
            }
        }
        Self {
            sides,
            seen: fields,
            projector,
        }
    }

    /// Writes outline points; `point` is the function for the kind of sides. Each block is filled separately
    /// from the columns it is copied to, because only then does the compiler vectorise the code.
    #[inline(always)]
    fn write(
        &self,
        outline_points: &[OutlinePoint<f32>],
        points: &mut [Points],
        point: impl Fn(&Sides<f32>, &VisibleBody<f32>, &OutlinePoint<f32>) -> [f32; 3],
    ) {
        for (outline_point, points) in outline_points.iter().zip(points) {
            let mut block = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let seen = VisibleBody::of_fields(std::array::from_fn(|i| self.seen[i][lane]));
                let [x, y, z] = self
                    .projector
                    .in_camera(point(&self.sides, &seen, outline_point));
                block[0][lane] = x;
                block[1][lane] = y;
                block[2][lane] = z;
            }
            *points = block;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::outline_points;
    use crate::shape::{Flat, Section, Sphere, Upright, UprightOutline};
    use nalgebra::Vector3;
    use pardalis_camera::{Equidistant, Pose, looking_at};

    fn look_at_origin(from_m: [f64; 3]) -> Pose {
        looking_at(from_m.into(), Vector3::zeros(), 0.0).unwrap()
    }

    /// Round, flat and upright shapes.
    fn shapes() -> Vec<Shape> {
        let upright = |section: Section, outline| {
            let upright = Upright::new(section, 0.8, outline);
            Shape::Upright(upright.unwrap())
        };
        let mut shapes = vec![
            Shape::Sphere(Sphere::new(0.11, SphereOutline::Tangent).unwrap()),
            Shape::Flat(Flat::disc(0.3, 0.1).unwrap()),
            Shape::Flat(Flat::rectangle([0.6, 0.2], 0.1).unwrap()),
        ];
        for section in [
            Section::circle(0.25),
            Section::polygon(8, 0.5, 0.3),
            Section::polygon(3, 0.4, -1.0),
            Section::rectangle([0.6, 0.25]),
            Section::rectangle([0.1, 0.7]),
        ] {
            for outline in [UprightOutline::Exact, UprightOutline::Facing] {
                shapes.push(upright(section.clone().unwrap(), outline));
            }
        }
        shapes
    }

    #[test]
    fn outlines_in_any_stance_are_those_of_the_oracle() {
        let lens = Equidistant::new(300.0, [319.5, 239.5], 3.0).unwrap();
        let mut compared = 0;
        for (number, eye) in [[0.0, -2.5, 1.7], [2.0, 0.3, 0.4], [0.2, -0.3, 2.5]]
            .into_iter()
            .enumerate()
        {
            let pose = look_at_origin(eye);
            let view = View::new(lens, pose, (640, 480), None).unwrap();
            let projector = Projector::new(&view);
            for shape in shapes() {
                for step in 0..24 {
                    let stance = Stance {
                        scale: 0.8 + 0.02 * f64::from(step),
                        yaw_rad: 0.7 * f64::from(step - 11) + 0.1 * number as f64,
                    };
                    // Where the first point of a round outline is does not matter.
                    let turns = shape.turn_period_rad().is_some();
                    let stance = if turns {
                        stance
                    } else {
                        Stance::scaled(stance.scale)
                    };
                    let position_m = [0.1, -0.05 * f64::from(step), 0.02];
                    let expected = outline_points(&view, &shape, position_m, stance, 40);
                    let kernel = OutlineKernel::new(shape, 40);
                    let mut points = [[[0.0; LANES]; 3]; 40];
                    let mut coordinates = [[[0.0; LANES]; 2]; 40];
                    let positions = position_m.map(|v| [v as f32; LANES]);
                    for level in Level::available() {
                        kernel.project(
                            level,
                            &projector,
                            &positions,
                            stance,
                            &mut points,
                            &mut coordinates,
                        );
                        for ([u, v], point) in coordinates.iter().zip(&expected) {
                            let [x, y] = view.camera().project(point.coords.into()).unwrap();
                            let off_px = libm::hypot(f64::from(u[3]) - x, f64::from(v[3]) - y);
                            assert!(off_px < 2e-3, "{shape:?} {stance:?}: {off_px} px");
                            compared += 1;
                        }
                    }
                }
            }
        }
        assert!(compared >= 3 * 13 * 24 * 40, "{compared}");
    }

    #[test]
    fn points_turned_about_a_place_are_those_of_a_turned_body() {
        let lens = Equidistant::new(300.0, [319.5, 239.5], 3.0).unwrap();
        let view = View::new(lens, look_at_origin([0.4, -2.5, 1.7]), (640, 480), None).unwrap();
        let projector = Projector::new(&view);
        let shape = Shape::Flat(Flat::rectangle([0.6, 0.2], 0.1).unwrap());
        let kernel = OutlineKernel::new(shape, 40);
        let center = [0.1_f32, -0.2, 0.0];
        let stance = |yaw_rad| Stance {
            scale: 1.1,
            yaw_rad,
        };
        let mut points = [[[0.0; LANES]; 3]; 40];
        let mut coordinates = [[[0.0; LANES]; 2]; 40];
        let positions = center.map(|v| [v; LANES]);
        let level = Level::available()[0];
        let mut project = |yaw_rad, points: &mut [Points; 40]| {
            let stance = stance(yaw_rad);
            kernel.project(
                level,
                &projector,
                &positions,
                stance,
                points,
                &mut coordinates,
            );
        };
        let mut turned = [[[0.0; LANES]; 3]; 40];
        project(0.5, &mut turned);
        projector.turn_points(center, 0.3, &mut turned);
        for (lane, yaw_rad) in [0.8, 0.2].into_iter().enumerate() {
            project(yaw_rad, &mut points);
            for (turned, point) in turned.iter().zip(&points) {
                for axis in 0..3 {
                    let off_m = (turned[axis][lane] - point[axis][lane]).abs();
                    assert!(off_m < 1e-5, "{off_m} m");
                }
            }
        }
    }

    #[test]
    fn outlines_in_rolling_shutters_are_those_of_places_that_have_moved() {
        let (position_m, velocity_mps, line_delay_s) = ([0.4, -0.5, 1.6], [3.0, -2.0, 0.5], 40e-6);
        let lens = Equidistant::new(300.0, [319.5, 239.5], 3.0).unwrap();
        let pose = Pose::translation(-0.1, 0.2, 0.3);
        let view = View::new(lens, pose, (640, 480), None).unwrap();
        let view = view.with_line_delay_s(line_delay_s).unwrap();
        let shape = Shape::Sphere(Sphere::new(0.11, SphereOutline::Tangent).unwrap());
        let kernel = OutlineKernel::new(shape, 24);
        let motion = view.row_motion(position_m, velocity_mps).unwrap();
        let velocity = view.camera_from_world().rotation * nalgebra::Vector3::from(velocity_mps);
        let expected = outline_points(&view, &shape, position_m, Stance::default(), 24);
        for level in Level::available() {
            let mut points = [[[0.0; LANES]; 3]; 24];
            let mut coordinates = [[[0.0; LANES]; 2]; 24];
            let positions = position_m.map(|v| [v as f32; LANES]);
            let projector = Projector::moving(&view, Some(&motion));
            kernel.project(
                level,
                &projector,
                &positions,
                Stance::default(),
                &mut points,
                &mut coordinates,
            );
            for ([u, v], point) in coordinates.iter().zip(&expected) {
                let mut shown = point.coords;
                for _ in 0..20 {
                    let [_, row] = view.camera().project(shown.into()).unwrap();
                    shown = point.coords + velocity * (line_delay_s * (row - 239.5));
                }
                let [x, y] = view.camera().project(shown.into()).unwrap();
                let [x0, y0] = view.camera().project(point.coords.into()).unwrap();
                let way_px = libm::hypot(x - x0, y - y0);
                let off_px = libm::hypot(f64::from(u[0]) - x, f64::from(v[0]) - y);
                // Rows are taken as a linear function of the place.
                assert!(
                    way_px > 2.0 && off_px < 0.02 * way_px,
                    "{off_px} of {way_px}"
                );
            }
        }
    }
}
