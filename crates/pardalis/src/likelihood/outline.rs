//! Where the outlines of a block of particles lie in a camera's image: the projection kernel of the contour cue.

use crate::shape::{OutlineCircle, Place, Seen, Shape, Sides, SidesKind, SphereOutline};
use crate::view::View;
use pardalis_camera::{LANES, project_block, with_model};
use pardalis_core::simd::Level;

/// One point of each of a block's outlines, in the camera's frame; NaN where there is none.
pub(super) type Points = [[f32; LANES]; 3];
/// Its image coordinates: u, then v; NaN outside the camera's domain.
pub(super) type Coordinates = [[f32; LANES]; 2];

/// A camera's pose in single precision.
#[derive(Debug)]
pub(super) struct Projector<'a> {
    view: &'a View,
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    /// Where outlines are seen from, in the camera's frame and in the world.
    viewpoint: [f32; 3],
    viewpoint_in_world: [f32; 3],
}

impl<'a> Projector<'a> {
    pub(super) fn new(view: &'a View) -> Self {
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
        }
    }

    /// The image coordinates of a block of places in the world.
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
                    coordinates = project_block(&model, &block);
                },
            );
        });
        coordinates
    }

    /// The image coordinates of blocks of points in the camera's frame.
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
                        *coordinates = project_block(&model, points);
                    }
                },
            );
        });
    }

    /// Writes, in the camera's frame, the places that lie so from each of these positions in the world: scaled along x and y, and so high.
    #[inline(always)]
    pub(super) fn write_places(
        &self,
        positions: &[[f32; LANES]; 3],
        scale: f32,
        places_m: &[[f32; 2]],
        height_m: f32,
        points: &mut [Points],
    ) {
        for (&[dx, dy], points) in places_m.iter().zip(points) {
            let mut block = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let [x, y, z] = self.in_camera([
                    positions[0][lane] + scale * dx,
                    positions[1][lane] + scale * dy,
                    positions[2][lane] + height_m,
                ]);
                block[0][lane] = x;
                block[1][lane] = y;
                block[2][lane] = z;
            }
            *points = block;
        }
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

/// A shape, with what does not change from particle to particle.
#[derive(Debug)]
pub(super) enum OutlineKernel {
    /// A sphere: the cosine and sine of each point's angle.
    Sphere {
        radius_m: f64,
        outline: SphereOutline,
        angles: Vec<(f32, f32)>,
    },
    /// An upright body, and each point's place on it.
    Upright {
        upright: crate::shape::Upright,
        places: Vec<Place<f32>>,
    },
    /// A flat shape: where each point lies from the position, unscaled.
    Flat {
        places_m: Vec<[f32; 2]>,
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
                places: upright.places(points),
            },
            Shape::Flat(flat) => Self::Flat {
                places_m: flat
                    .places_m(points)
                    .into_iter()
                    .map(|place| place.map(|v| v as f32))
                    .collect(),
                height_m: flat.height_m as f32,
            },
        }
    }

    /// Writes the image coordinates of the outlines of the shape, scaled, at these places in the world: one element a point. `points` is as long and
    /// holds what lies between.
    pub(super) fn project(
        &self,
        level: Level,
        projector: &Projector,
        positions: &[[f32; LANES]; 3],
        scale: f64,
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
                    let radius_m = (scale * radius_m) as f32;
                    let circles = Circles::new(projector, positions, radius_m, *outline);
                    for (point, angle) in points.iter_mut().zip(angles) {
                        circles.write_points(*angle, point);
                    }
                },
            ),
            Self::Upright { upright, places } => {
                let sides = upright.sides(scale);
                level.run(
                    #[inline(always)]
                    || {
                        let bodies = Bodies::new(projector, positions, sides);
                        match sides.kind() {
                            SidesKind::Round => bodies.write(places, points, Sides::round),
                            SidesKind::Corners { .. } => {
                                bodies.write(places, points, Sides::cornered);
                            }
                            SidesKind::Flat => {
                                bodies.write(places, points, |_, seen, place| {
                                    Sides::flat(seen, place)
                                });
                            }
                        }
                    },
                );
            }
            Self::Flat { places_m, height_m } => level.run(
                #[inline(always)]
                || projector.write_places(positions, scale as f32, places_m, *height_m, points),
            ),
        }
        projector.project_all(level, points, coordinates);
    }
}

/// Outlines of spheres: centre and two radii at a right angle.
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

    /// The points at the angle of this cosine and sine.
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

/// Upright bodies as they are seen.
struct Bodies<'a> {
    sides: Sides<f32>,
    seen: [[f32; LANES]; Seen::<f32>::FIELDS],
    projector: &'a Projector<'a>,
}

impl<'a> Bodies<'a> {
    #[inline(always)]
    fn new(projector: &'a Projector<'a>, positions: &[[f32; LANES]; 3], sides: Sides<f32>) -> Self {
        let mut fields = [[0.0; LANES]; Seen::<f32>::FIELDS];
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

    /// Writes the points at these places; `point` is that of the kind of sides. Each block is filled apart from the columns it goes to: only then does
    /// the compiler make vector code of it.
    #[inline(always)]
    fn write(
        &self,
        places: &[Place<f32>],
        points: &mut [Points],
        point: impl Fn(&Sides<f32>, &Seen<f32>, &Place<f32>) -> [f32; 3],
    ) {
        for (place, points) in places.iter().zip(points) {
            let mut block = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let seen = Seen::of_fields(std::array::from_fn(|i| self.seen[i][lane]));
                let [x, y, z] = self.projector.in_camera(point(&self.sides, &seen, place));
                block[0][lane] = x;
                block[1][lane] = y;
                block[2][lane] = z;
            }
            *points = block;
        }
    }
}
