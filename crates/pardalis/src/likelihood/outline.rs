//! Where the outlines of a block of particles lie in a camera's image: the projection kernel of the contour cue.

use crate::camera::{Projection, with_model};
use crate::shape::{OutlineCircle, Place, Seen, Shape, Sides, SphereOutline};
use crate::simd::Level;
use crate::view::View;

/// Particles a block: the lanes of the kernels.
pub(super) const LANES: usize = 16;

/// Image coordinates of one point of a block's outlines: u, then v; NaN outside the camera's domain.
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
        }
    }

    /// Writes the image coordinates of the outlines of the shape, scaled, at these places in the world: one element a point.
    pub(super) fn project(
        &self,
        level: Level,
        projector: &Projector,
        positions: &[[f32; LANES]; 3],
        scale: f64,
        coordinates: &mut [Coordinates],
    ) {
        with_model!(projector.view.camera(), model => {
            let model = model.to_f32();
            match self {
                Self::Sphere { radius_m, outline, angles } => {
                    let radius_m = (scale * radius_m) as f32;
                    level.run(
                        #[inline(always)]
                        || {
                            let circles = Circles::new(projector, positions, radius_m, *outline, angles);
                            project_points(&model, &circles, coordinates);
                        },
                    );
                }
                Self::Upright { upright, places } => {
                    let sides = upright.sides(scale);
                    level.run(
                        #[inline(always)]
                        || {
                            let bodies = Bodies::new(projector, positions, sides, places);
                            project_points(&model, &bodies, coordinates);
                        },
                    );
                }
            }
        });
    }
}

/// Outlines of a block of particles, in the camera's frame.
trait BlockOutline {
    /// A point of one particle's outline; NaN where it has none.
    fn point(&self, k: usize, lane: usize) -> [f32; 3];
}

/// Plain loops that the compiler vectorises; with the choice in the first one it would branch instead.
#[inline(always)]
fn project_points<P: Projection<f32>>(
    model: &P,
    outline: &impl BlockOutline,
    coordinates: &mut [Coordinates],
) {
    for (k, [u, v]) in coordinates.iter_mut().enumerate() {
        let mut valid = [false; LANES];
        for lane in 0..LANES {
            ([u[lane], v[lane]], valid[lane]) = model.project(outline.point(k, lane));
        }
        for lane in 0..LANES {
            u[lane] = if valid[lane] { u[lane] } else { f32::NAN };
            v[lane] = if valid[lane] { v[lane] } else { f32::NAN };
        }
    }
}

/// Outlines of spheres.
struct Circles<'a> {
    center: [[f32; LANES]; 3],
    a: [[f32; LANES]; 3],
    b: [[f32; LANES]; 3],
    angles: &'a [(f32, f32)],
}

impl<'a> Circles<'a> {
    #[inline(always)]
    fn new(
        projector: &Projector,
        positions: &[[f32; LANES]; 3],
        radius_m: f32,
        outline: SphereOutline,
        angles: &'a [(f32, f32)],
    ) -> Self {
        let mut circles = Self {
            center: [[0.0; LANES]; 3],
            a: [[0.0; LANES]; 3],
            b: [[0.0; LANES]; 3],
            angles,
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
}

impl BlockOutline for Circles<'_> {
    #[inline(always)]
    fn point(&self, k: usize, lane: usize) -> [f32; 3] {
        let (cos, sin) = self.angles[k];
        let at = |i: usize| self.center[i][lane] + cos * self.a[i][lane] + sin * self.b[i][lane];
        [at(0), at(1), at(2)]
    }
}

/// Outlines of upright bodies.
struct Bodies<'a> {
    sides: Sides<f32>,
    seen: [[f32; LANES]; Seen::<f32>::FIELDS],
    places: &'a [Place<f32>],
    projector: &'a Projector<'a>,
}

impl<'a> Bodies<'a> {
    #[inline(always)]
    fn new(
        projector: &'a Projector<'a>,
        positions: &[[f32; LANES]; 3],
        sides: Sides<f32>,
        places: &'a [Place<f32>],
    ) -> Self {
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
            places,
            projector,
        }
    }
}

impl BlockOutline for Bodies<'_> {
    #[inline(always)]
    fn point(&self, k: usize, lane: usize) -> [f32; 3] {
        let seen = Seen::of_fields(self.seen.map(|field| field[lane]));
        self.projector
            .in_camera(self.sides.point(&seen, &self.places[k]))
    }
}
