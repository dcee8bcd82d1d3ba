//! Reference implementation of outlines and of the points on either side of them.

use nalgebra::{DMatrix, DVector, Point3, Rotation3, Vector2, Vector3};

use crate::likelihood::{ContourSettings, Sampling, SplineSampling};
use crate::shape::{
    Flat, FlatForm, Section, Shape, SphereOutline, Stance, Upright, UprightOutline,
};
use crate::view::View;

use super::open_pixels;

/// Image points; `None` for a point that has no pixel.
type Pixels = Vec<Option<[f64; 2]>>;

/// Computes the outline points of a body in a stance at a position in the world, in the camera frame, in metres.
/// Empty if the body has no outline.
pub fn outline_points(
    view: &View,
    shape: &Shape,
    position_m: [f64; 3],
    stance: Stance,
    count: usize,
) -> Vec<Point3<f64>> {
    let Stance { scale, yaw_rad } = stance;
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    let viewpoint = Point3::from(view.camera().viewpoint_m());
    let position = Point3::from(position_m);
    match shape {
        Shape::Sphere(sphere) => {
            let center = view.camera_from_world() * position - viewpoint;
            sphere_outline(center, scale * sphere.radius_m, sphere.outline, count)
                .into_iter()
                .map(|point| viewpoint + point)
                .collect()
        }
        Shape::Flat(flat) => flat_outline(flat, scale, count)
            .into_iter()
            .map(|point| view.camera_from_world() * (position + turn * point))
            .collect(),
        Shape::Upright(upright) => {
            let viewpoint = view.world_from_camera() * viewpoint;
            upright_outline(
                upright,
                scale,
                turn.inverse() * (viewpoint - position),
                count,
            )
            .into_iter()
            .map(|point| view.camera_from_world() * (position + turn * point))
            .collect()
        }
    }
}

/// Returns `count` points on the outline of a flat shape over the origin, in metres: on its circle starting
/// at x, or along its four sides.
fn flat_outline(flat: &Flat, scale: f64, count: usize) -> Vec<Vector3<f64>> {
    let share = |k: usize| k as f64 / count as f64;
    match flat.form {
        FlatForm::Disc { radius_m } => (0..count)
            .map(|k| std::f64::consts::TAU * share(k))
            .map(|angle| Vector2::new(libm::cos(angle), libm::sin(angle)) * scale * radius_m)
            .map(|position| position.push(flat.height_m))
            .collect(),
        FlatForm::Rectangle { size_m: [w, d] } => {
            let corners = [
                (-1.0, -1.0),
                (1.0, -1.0),
                (1.0, 1.0),
                (-1.0, 1.0),
                (-1.0, -1.0),
            ]
            .map(|(x, y)| Vector2::new(x * w, y * d) * scale / 2.0);
            let lengths = [w, d, w, d];
            (0..count)
                .map(|k| {
                    let mut rest = (share(k) + 0.5 / count as f64) * 2.0 * (w + d);
                    let mut side = 0;
                    while side < 3 && rest >= lengths[side] {
                        rest -= lengths[side];
                        side += 1;
                    }
                    corners[side].lerp(&corners[side + 1], rest / lengths[side])
                })
                .map(|position| position.push(flat.height_m))
                .collect()
        }
    }
}

/// Returns `count` points on the outline of a sphere around `center` as seen from the origin, in metres;
/// empty from inside the sphere.
///
/// For a centre C at distance d and radius R, the tangent circle has radius R·√(1 − R²/d²) and lies at
/// distance d − R²/d; the great circle has radius R and lies at distance d.
fn sphere_outline(
    center: Vector3<f64>,
    radius_m: f64,
    outline: SphereOutline,
    count: usize,
) -> Vec<Vector3<f64>> {
    let distance = center.norm();
    if !(distance > radius_m) {
        return Vec::new();
    }
    let ray = center / distance;
    let (circle_distance, circle_radius) = match outline {
        SphereOutline::Tangent => (
            distance - radius_m * radius_m / distance,
            radius_m * (1.0 - (radius_m / distance).powi(2)).sqrt(),
        ),
        SphereOutline::Greatcircle => (distance, radius_m),
    };
    let [a, b] = directions_across(ray);
    (0..count)
        .map(|k| {
            let angle = k as f64 / count as f64 * std::f64::consts::TAU;
            let across = a * libm::cos(angle) + b * libm::sin(angle);
            ray * circle_distance + across * circle_radius
        })
        .collect()
}

/// Returns the two directions perpendicular to a ray from which contours count their angle. The shortest
/// rotation that turns z into the ray turns x and y into them. For rays that point backwards, −z is rotated
/// instead and y is mirrored.
fn directions_across(ray: Vector3<f64>) -> [Vector3<f64>; 2] {
    let sign = 1_f64.copysign(ray.z);
    let pole = Vector3::z() * sign;
    // The shortest rotation of `pole` into `ray`, for vectors perpendicular to `pole`.
    let turned = |v: Vector3<f64>| v - (pole + ray) * v.dot(&ray) / (1.0 + pole.dot(&ray));
    [turned(Vector3::x()), turned(Vector3::y() * sign)]
}

/// Returns `count` points on the outline of an upright body that stands on the origin, as seen from
/// `viewpoint`, in metres; empty from inside the body.
///
/// The outline runs over the top, down one side, back along the base and up the other side. The top is
/// visible along its near rim from below and along its far rim from above; the base the other way round.
fn upright_outline(
    upright: &Upright,
    scale: f64,
    viewpoint: Vector3<f64>,
    count: usize,
) -> Vec<Vector3<f64>> {
    let middle = upright.height_m / 2.0;
    let (base, top) = (
        middle - scale * upright.height_m / 2.0,
        middle + scale * upright.height_m / 2.0,
    );
    let to_viewpoint = viewpoint.xy();
    if upright.outline == UprightOutline::Facing && !(to_viewpoint.norm() > 0.0) {
        return Vec::new();
    }
    let width = 2.0 * mean_half_width_m(upright.section);
    // Towards the first side met when going around counterclockwise, as seen from above.
    let towards = to_viewpoint.normalize();
    let across = Vector2::new(-towards.y, towards.x) * scale * width / 2.0;
    let rim = Rim::new(upright.section, scale);
    let tangents = rim.tangents(to_viewpoint);
    let (above, below) = (viewpoint.z > top, viewpoint.z < base);
    if upright.outline == UprightOutline::Exact && tangents.is_none() && !above && !below {
        return Vec::new();
    }
    (0..count)
        .map(|k| {
            let around = (k as f64 + 0.5) / count as f64;
            if upright.outline == UprightOutline::Exact && tangents.is_none() {
                let at = rim.point(around * rim.length());
                return at.push(if above { top } else { base });
            }
            let (first, last) = tangents.unwrap_or((0.0, 0.0));
            let lengths = [width, upright.height_m, width, upright.height_m];
            let mut rest = around * lengths.iter().sum::<f64>();
            let mut side = 0;
            while side < 3 && rest >= lengths[side] {
                rest -= lengths[side];
                side += 1;
            }
            let share = rest / lengths[side];
            if upright.outline == UprightOutline::Facing {
                return match side {
                    0 => (across * (1.0 - 2.0 * share)).push(top),
                    1 => (-across).push(top + share * (base - top)),
                    2 => (across * (2.0 * share - 1.0)).push(base),
                    _ => across.push(base + share * (top - base)),
                };
            }
            let along = |from: f64, to: f64| rim.point(from + share * (to - from));
            match side {
                0 if above => along(last, first + rim.length()).push(top),
                0 => along(last, first).push(top),
                1 => rim.point(first).push(top + share * (base - top)),
                2 if below => along(first, last - rim.length()).push(base),
                2 => along(first, last).push(base),
                _ => rim.point(last).push(base + share * (top - base)),
            }
        })
        .collect()
}

/// Computes half the mean width of a section over all directions: its perimeter over 2π (Cauchy).
fn mean_half_width_m(section: Section) -> f64 {
    let rim = Rim::new(section, 1.0);
    match section {
        Section::Circle { radius_m } => radius_m,
        Section::Polygon { sides, .. } => {
            let side = (rim.point(1.0) - rim.point(0.0)).norm();
            side * sides as f64 / std::f64::consts::TAU
        }
        Section::Rectangle { .. } => rim.length() / std::f64::consts::TAU,
    }
}

/// The rim of a horizontal section. Positions on it are angles in radians, corner indices of a polygon, or metres along the sides of a rectangle.
enum Rim {
    Circle(f64),
    /// Corners, with the position of each and, at the end, of the first again.
    Corners(Vec<Vector2<f64>>, Vec<f64>),
}

impl Rim {
    fn new(section: Section, scale: f64) -> Self {
        match section {
            Section::Circle { radius_m } => Self::Circle(scale * radius_m),
            Section::Polygon {
                sides,
                apothem_m,
                turn,
            } => {
                let step = std::f64::consts::TAU / sides as f64;
                let radius = scale * apothem_m / libm::cos(step / 2.0);
                let corner = |j: usize| {
                    let angle = turn * std::f64::consts::TAU + step * j as f64;
                    Vector2::new(libm::cos(angle), libm::sin(angle)) * radius
                };
                let positions = (0..=sides).map(|j| j as f64).collect();
                Self::Corners((0..sides).map(corner).collect(), positions)
            }
            Section::Rectangle { size_m: [x, y] } => {
                let corners = [(0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)];
                let corners = corners.map(|(i, j)| Vector2::new(i * x, j * y) * scale);
                let positions = [0.0, y, x + y, x + 2.0 * y, 2.0 * (x + y)];
                Self::Corners(corners.into(), positions.map(|v| v * scale).into())
            }
        }
    }

    fn length(&self) -> f64 {
        match self {
            Self::Circle(_) => std::f64::consts::TAU,
            Self::Corners(corners, positions) => positions[corners.len()],
        }
    }

    fn point(&self, position: f64) -> Vector2<f64> {
        match self {
            Self::Circle(radius) => {
                Vector2::new(libm::cos(position), libm::sin(position)) * *radius
            }
            Self::Corners(corners, positions) => {
                let position = position.rem_euclid(self.length());
                let is_after = |corner: &usize| positions[*corner] <= position;
                let corner = (0..corners.len()).rev().find(is_after).unwrap_or(0);
                let [from, to] = [positions[corner], positions[corner + 1]];
                let share = (position - from) / (to - from);
                let next = corners[(corner + 1) % corners.len()];
                corners[corner] * (1.0 - share) + next * share
            }
        }
    }

    /// Returns the start and end of the visible side; `None` from inside.
    fn tangents(&self, viewpoint: Vector2<f64>) -> Option<(f64, f64)> {
        match self {
            Self::Circle(radius) => {
                let distance = viewpoint.norm();
                if !(distance > *radius) {
                    return None;
                }
                let bearing = libm::atan2(viewpoint.y, viewpoint.x);
                let half = libm::acos(radius / distance);
                Some((bearing - half, bearing + half))
            }
            Self::Corners(corners, positions) => {
                let count = corners.len();
                let is_visible = |j: usize| {
                    let (from, to) = (corners[j % count], corners[(j + 1) % count]);
                    let outwards = Vector2::new(to.y - from.y, from.x - to.x);
                    outwards.dot(&(viewpoint - from)) > 0.0
                };
                let first = (0..count).find(|&j| is_visible(j) && !is_visible(j + count - 1))?;
                let last = (first..first + count).find(|&j| !is_visible(j))?;
                let at = |corner: usize| {
                    let around = (corner / count) as f64 * self.length();
                    around + positions[corner % count]
                };
                Some((at(first), at(last)))
            }
        }
    }
}

/// Computes the compared points inside and outside the outline, in pixels.
pub fn boundary(
    view: &View,
    shape: &Shape,
    settings: &ContourSettings,
    position_m: [f64; 3],
) -> [Pixels; 2] {
    let points = settings.points;
    match &settings.sampling {
        Sampling::Scaled(scaled) => {
            let scales = [scaled.inner_scale, scaled.outer_scale];
            let sides = boundary_of_scales(view, shape, points, position_m, scales);
            let Some(shared_pixels) = scaled.shared_pixels else {
                return sides;
            };
            let [inner, outer] = sides.each_ref().map(|side| on_image(view, side));
            let shared = inner.iter().filter(|pixel| outer.contains(pixel)).count();
            if shared as f64 > shared_pixels.max_share * inner.len() as f64 {
                return boundary_along_normals(
                    view,
                    shape,
                    points,
                    position_m,
                    shared_pixels.distance_px,
                );
            }
            sides
        }
        Sampling::Spline(spline) => spline_boundary(view, shape, points, position_m, spline),
    }
}

/// Returns the pixels inside the image, whether masked or not.
fn on_image(view: &View, pixels: &Pixels) -> Vec<[usize; 2]> {
    let whole = View::new(
        view.camera().clone(),
        *view.world_from_camera(),
        view.size(),
        None,
    );
    open_pixels(&whole.expect("a view without its mask"), pixels)
}

fn projected(view: &View, points: &[Point3<f64>]) -> Pixels {
    let points = points.iter();
    points
        .map(|&point| view.camera().project(point.into()))
        .collect()
}

/// Computes the outlines of a smaller and of a larger body.
pub fn boundary_of_scales(
    view: &View,
    shape: &Shape,
    points: usize,
    position_m: [f64; 3],
    scales: [f64; 2],
) -> [Pixels; 2] {
    scales.map(|scale| {
        projected(
            view,
            &outline_points(view, shape, position_m, Stance::scaled(scale), points),
        )
    })
}

/// Computes points at a given distance from the outline, along the normals to the lines between neighbours.
pub fn boundary_along_normals(
    view: &View,
    shape: &Shape,
    points: usize,
    position_m: [f64; 3],
    distance_px: f64,
) -> [Pixels; 2] {
    let outline = projected(
        view,
        &outline_points(view, shape, position_m, Stance::default(), points),
    );
    let Some(outline) = complete(&outline) else {
        return [Pixels::new(), Pixels::new()];
    };
    let count = outline.len();
    let tangent = |k: usize| outline[(k + 1) % count] - outline[(k + count - 1) % count];
    let tangents: Vec<_> = (0..count).map(tangent).collect();
    [-distance_px, distance_px]
        .map(|distance| along_normals(&outline, &tangents, &outline, distance))
}

/// Returns all points if every one has a pixel.
fn complete(pixels: &Pixels) -> Option<Vec<Vector2<f64>>> {
    let points: Option<Vec<_>> = pixels.iter().map(|p| p.map(Vector2::from)).collect();
    points.filter(|points| !points.is_empty())
}

/// Returns points beside a closed curve, outside of it if the distance is positive. `around` is a closed line
/// of the same orientation.
fn along_normals(
    curve: &[Vector2<f64>],
    tangents: &[Vector2<f64>],
    around: &[Vector2<f64>],
    distance_px: f64,
) -> Pixels {
    let twice_area: f64 = (0..around.len())
        .map(|k| around[k].perp(&around[(k + 1) % around.len()]))
        .sum();
    let outwards = 1_f64.copysign(twice_area);
    curve
        .iter()
        .zip(tangents)
        .map(|(point, tangent)| {
            let normal = Vector2::new(tangent.y, -tangent.x) / tangent.norm() * outwards;
            let beside = point + normal * distance_px;
            (tangent.norm() > 0.0).then_some([beside.x, beside.y])
        })
        .collect()
}

/// Computes v = B·B⁺·d and points along the normals of the curve.
fn spline_boundary(
    view: &View,
    shape: &Shape,
    points: usize,
    position_m: [f64; 3],
    spline: &SplineSampling,
) -> [Pixels; 2] {
    let outline = projected(
        view,
        &outline_points(view, shape, position_m, Stance::default(), points),
    );
    let Some(outline) = complete(&outline) else {
        return [Pixels::new(), Pixels::new()];
    };
    let count = spline.control_points;
    let parameter = |i: usize| i as f64 * count as f64 / points as f64;
    // Rounding at a knot does no harm: both sides give the same value.
    let basis = DMatrix::from_fn(points, count, |i, j| {
        periodic(parameter(i), j, count, quadratic)
    });
    let slopes = DMatrix::from_fn(points, count, |i, j| {
        periodic(parameter(i), j, count, slope)
    });
    let inverse = basis
        .clone()
        .pseudo_inverse(1e-12)
        .expect("the tolerance is positive");
    let column = |axis: usize| DVector::from_iterator(points, outline.iter().map(|p| p[axis]));
    let control = [0, 1].map(|axis| &inverse * column(axis));
    let traced = |matrix: &DMatrix<f64>| -> Vec<Vector2<f64>> {
        let [u, v] = control.each_ref().map(|control| matrix * control);
        u.iter()
            .zip(v.iter())
            .map(|(&u, &v)| Vector2::new(u, v))
            .collect()
    };
    let (curve, tangents) = (traced(&basis), traced(&slopes));
    let around: Vec<_> = (0..count)
        .map(|j| Vector2::new(control[0][j], control[1][j]))
        .collect();
    [-1.0, 1.0].map(|side| {
        (usize::from(!spline.middle)..=spline.steps)
            .flat_map(|step| {
                let distance = side * spline.reach_px * step as f64 / spline.steps as f64;
                along_normals(&curve, &tangents, &around, distance)
            })
            .collect()
    })
}

/// Evaluates a basis function with support 0..3, shifted to start at knot `j − 2` and repeated every `count`.
fn periodic(s: f64, j: usize, count: usize, function: fn(f64) -> f64) -> f64 {
    // Control point j acts from knot j − 2 to knot j + 1.
    let start = j as f64 - 2.0;
    (-1..=1)
        .map(|turn| function(s - start + f64::from(turn) * count as f64))
        .sum()
}

/// Evaluates the quadratic B-spline on the knots 0, 1, 2, 3.
fn quadratic(x: f64) -> f64 {
    match x {
        x if (0.0..1.0).contains(&x) => 0.5 * x * x,
        x if (1.0..2.0).contains(&x) => 0.5 * (-2.0 * x * x + 6.0 * x - 3.0),
        x if (2.0..3.0).contains(&x) => 0.5 * (3.0 - x) * (3.0 - x),
        _ => 0.0,
    }
}

/// Evaluates the derivative of [`quadratic`].
fn slope(x: f64) -> f64 {
    match x {
        x if (0.0..1.0).contains(&x) => x,
        x if (1.0..2.0).contains(&x) => 3.0 - 2.0 * x,
        x if (2.0..3.0).contains(&x) => x - 3.0,
        _ => 0.0,
    }
}
