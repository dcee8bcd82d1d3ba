//! Outlines of upright bodies are tangent to them from any viewpoint.

use super::*;

fn bodies(outline: UprightOutline) -> Vec<Upright> {
    [
        Section::circle(0.25).unwrap(),
        Section::polygon(8, 0.5, 0.3).unwrap(),
        Section::polygon(3, 0.3, -1.0).unwrap(),
        Section::rectangle([0.6, 0.25]).unwrap(),
    ]
    .map(|section| Upright::new(section, 0.8, outline).unwrap())
    .into()
}

/// Returns how far a point lies outside a body that stands on the origin, at most; negative inside.
fn outside_m(upright: &Upright, [x, y, z]: [f64; 3]) -> f64 {
    let beside = match upright.section {
        Section::Circle { radius_m } => x.hypot(y) - radius_m,
        Section::Polygon {
            sides,
            apothem_m,
            turn,
        } => (0..sides)
            .map(|j| {
                let normal = (turn + (j as f64 + 0.5) / sides as f64) * std::f64::consts::TAU;
                x * normal.cos() + y * normal.sin() - apothem_m
            })
            .fold(f64::NEG_INFINITY, f64::max),
        Section::Rectangle {
            size_m: [width, depth],
        } => (x.abs() - 0.5 * width).max(y.abs() - 0.5 * depth),
    };
    beside.max(-z).max(z - upright.height_m)
}

#[test]
fn rays_to_exact_outlines_are_tangent_to_the_body() {
    for upright in bodies(UprightOutline::Exact) {
        for viewpoint in [
            [2.0, 0.3, 0.5],
            [-0.4, 0.5, 1.6],
            [0.6, -0.9, -1.0],
            [0.0, -0.41, 0.82],
            [0.05, 0.02, 2.0],
            [0.05, 0.02, -0.5],
        ] {
            let sides = upright.sides::<f64>(Stance::default());
            let (seen, outside) = sides.seen_from([0.0; 3], viewpoint);
            assert!(outside);
            for outline_point in upright.outline_points(40) {
                let point = sides.point(&seen, &outline_point);
                assert!(outside_m(&upright, point).abs() < 1e-12, "{point:?}");
                for share in [0.5, 0.9, 0.999, 1.001, 1.1, 1.5] {
                    let along = [0, 1, 2].map(|i| viewpoint[i] + share * (point[i] - viewpoint[i]));
                    let clear = outside_m(&upright, along);
                    assert!(
                        clear > -1e-9,
                        "{upright:?} {viewpoint:?} {point:?}: {clear}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_facing_outline_is_a_rectangle_perpendicular_to_the_line_of_sight() {
    for upright in bodies(UprightOutline::Facing) {
        let viewpoint = [1.2, -1.6, 0.8];
        let position = [0.4, 0.2, 0.1];
        let sides = upright.sides::<f64>(Stance::scaled(1.25));
        let (seen, outside) = sides.seen_from(position, viewpoint);
        assert!(outside);
        let (mut width, mut low, mut high) = (0.0_f64, f64::INFINITY, f64::NEG_INFINITY);
        for outline_point in upright.outline_points(40) {
            let [x, y, z] = sides.point(&seen, &outline_point);
            let (dx, dy) = (x - position[0], y - position[1]);
            let towards = dx * (viewpoint[0] - position[0]) + dy * (viewpoint[1] - position[1]);
            assert!(
                towards.abs() < 1e-12,
                "the point must lie in the plane through the axis"
            );
            width = width.max(dx.hypot(dy));
            (low, high) = (low.min(z), high.max(z));
        }
        assert!((width - 1.25 * upright.section.mean_half_width_m()).abs() < 1e-12);
        assert!((low - (0.1 + 0.4 - 0.5)).abs() < 1e-12 && (high - 1.0).abs() < 1e-12);
    }
    let octagon = Section::polygon(8, 0.5, 0.0).unwrap();
    assert!((octagon.mean_half_width_m() - 0.263_7).abs() < 1e-4);
    assert!((octagon.circumradius_m() - 0.270_6).abs() < 1e-4);
}

#[test]
fn points_are_evenly_spaced_along_the_outline() {
    let upright = bodies(UprightOutline::Facing)[0];
    let sides = upright.sides::<f64>(Stance::default());
    let (seen, _) = sides.seen_from([0.0; 3], [3.0, 0.0, 0.4]);
    let outline_points = upright.outline_points(52);
    let points: Vec<_> = outline_points
        .iter()
        .map(|p| sides.point(&seen, p))
        .collect();
    let perimeter = 2.0 * (0.5 + 0.8);
    for k in 0..52 {
        let (a, b) = (points[k], points[(k + 1) % 52]);
        // Around a corner the path is longer than the straight line.
        let along: f64 = (0..3).map(|i| (a[i] - b[i]).abs()).sum();
        assert!((along - perimeter / 52.0).abs() < 1e-12, "{k}: {along}");
    }
}

#[test]
fn a_viewpoint_inside_has_no_outline_and_invalid_sizes_are_rejected() {
    for upright in bodies(UprightOutline::Exact) {
        let sides = upright.sides::<f64>(Stance::default());
        assert!(!sides.seen_from([0.0; 3], [0.02, 0.0, 0.4]).1);
        assert!(sides.seen_from([0.0; 3], [0.02, 0.0, 0.9]).1);
    }
    assert!(Section::circle(0.0).is_err() && Section::circle(f64::NAN).is_err());
    assert!(Section::polygon(2, 0.5, 0.0).is_err() && Section::polygon(8, 0.5, 7.0).is_err());
    let circle = Section::circle(0.2).unwrap();
    assert!(Upright::new(circle, f64::INFINITY, UprightOutline::Exact).is_err());
}
