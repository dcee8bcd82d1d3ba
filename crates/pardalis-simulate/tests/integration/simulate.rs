//! Rendered images against the exact outlines of the camera models, and ground truth against its specification.

use pardalis::shape::{Shape, Sphere, SphereOutline, Stance};
use pardalis_simulate::{Body, Course, Path, Renderer, World, truth};

use crate::world;

/// All camera models, each with a ball position in the camera's frame.
const MODELS: [(&str, [f64; 3]); 10] = [
    (
        "pinhole = { f_px = [300, 310], center_px = [159.5, 119.5], distortion = [-0.2, 0.05, 0.001, -0.002, 0] }",
        AHEAD,
    ),
    (
        "equidistant = { f_px_per_rad = 110, center_px = [160.5, 118], field_of_view_deg = 185 }",
        ASIDE,
    ),
    (
        "kannala_brandt = { f_px = [110, 111], center_px = [160.5, 118], k = [0.01, -0.003, 0.001, 0] }",
        ASIDE,
    ),
    (
        "double_sphere = { f_px = [120, 121], center_px = [160, 120], xi = 0.3, alpha = 0.6 }",
        AHEAD,
    ),
    (
        "extended_unified = { f_px = [160, 161], center_px = [160, 120], alpha = 0.6, beta = 1.1 }",
        AHEAD,
    ),
    (
        "ocam = { center_px = [160, 120], polynomial = [-110, 0, 0.002], max_radius_px = 150 }",
        AHEAD,
    ),
    (
        "mei = { f_px = [300, 301], center_px = [160, 120], xi = 1.0, distortion = [-0.1, 0.01, 0, 0] }",
        AHEAD,
    ),
    (
        "unified = { l = 0.97, m = 100, center_px = [160, 120] }",
        BELOW,
    ),
    (
        "perspective_mirror = { m_px = 100, center_px = [160, 120] }",
        BELOW,
    ),
    (
        "exact_mirror = { f_px = [280, 285], center_px = [160, 120], hyperboloid = { vertex_m = 0.0642, a_m = 0.028, b_m = 0.023, rim_m = 0.035 } }",
        BELOW,
    ),
];
const AHEAD: [f64; 3] = [0.3, -0.2, 1.0];
const ASIDE: [f64; 3] = [0.7, 0.3, 0.25];
const BELOW: [f64; 3] = [0.4, 0.3, -0.6];
const RADIUS_M: f64 = 0.11;

fn world_of(model: &str, [x, y, z]: [f64; 3], more: &str) -> World {
    world(&format!(
        "duration_s = 1
        image.samples = 6
        room.texture.plain.color_srgb = [90, 90, 90]
        [cameras.eye]
        size_px = [320, 240]
        model.{model}
        world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        [objects.ball]
        target = true
        shape.sphere.radius_m = {RADIUS_M}
        color_srgb = [220, 90, 30]
        path.line = {{ position_m = [{x}, {y}, {z}], velocity_mps = [0.5, 0.3, 0.1] }}
        {more}"
    ))
}

/// Returns area and centroid of a polygon.
fn moments(corners: &[[f64; 2]]) -> (f64, [f64; 2]) {
    let (mut area, mut moment) = (0.0, [0.0; 2]);
    for (i, a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let cross = a[0] * b[1] - b[0] * a[1];
        area += cross / 2.0;
        for axis in 0..2 {
            moment[axis] += (a[axis] + b[axis]) * cross / 6.0;
        }
    }
    (area.abs(), moment.map(|m| m / area))
}

#[test]
fn silhouettes_match_exact_outlines_for_every_camera_model() {
    for (model, position_m) in MODELS {
        let world = world_of(model, position_m, "");
        let renderer = Renderer::new(&world, 0);
        let coverage = renderer.coverage(0, 0.0);
        let (mut area, mut moment) = (0.0, [0.0; 2]);
        for (pixel, share) in coverage.iter().map(|&share| f64::from(share)).enumerate() {
            area += share;
            moment[0] += share * (pixel % 320) as f64;
            moment[1] += share * (pixel / 320) as f64;
        }
        let ball = Shape::Sphere(Sphere::new(RADIUS_M, SphereOutline::Tangent).unwrap());
        let eye = &world.cameras[0];
        let outline = ball.outline_px(
            &eye.camera,
            &eye.world_from_camera.inverse(),
            position_m,
            Stance::default(),
            2000,
        );
        let outline: Vec<_> = outline.into_iter().map(Option::unwrap).collect();
        let (true_area, center) = moments(&outline);
        assert!(
            true_area > 80.0,
            "{model}: an area of {true_area} pixels is too small for this test"
        );
        let off_px = (moment[0] / area - center[0]).hypot(moment[1] / area - center[1]);
        // The exact mirror has no single viewpoint for its outline.
        let (area_limit, off_limit) = if model.starts_with("exact") {
            (0.01, 0.15)
        } else {
            (0.001, 0.01)
        };
        let wrong = (area / true_area - 1.0).abs();
        assert!(
            wrong < area_limit && off_px < off_limit,
            "{model}: {wrong} {off_px}"
        );
    }
}

#[test]
fn incremental_rendering_equals_complete_rendering() {
    let more = "[light]
        ambient = 0.3
        [cameras.eye.image]
        samples = 1
        blur_px = 0.8
        read_noise = 2
        [ground]
         z_m = -0.8
        texture.checker = { size_m = 0.2, colors_srgb = [[90, 90, 90], [160, 150, 140]] }
        [objects.post]
        shape.cylinder = { radius_m = 0.1, height_m = 0.4 }
        color_srgb = [20, 90, 30]
        path.circle = { center_m = [0.5, 0, 0.4], radius_m = 0.4, period_s = 1.7 }
        [objects.crate]
        shape.box.size_m = [0.3, 0.2, 0.2]
        color_srgb = [20, 90, 130]
        path.still.position_m = [0.4, 0.1, 0.7]
        [objects.flag]
        shape.cloth.size_m = [0.3, 0.4]
        texture.noise = { size_m = 0.1, octaves = 2, colors_srgb = [[150, 20, 30], [220, 200, 30]] }
        path.circle = { center_m = [0.2, 0, 0.4], radius_m = 0.5, period_s = 2.3 }
        [objects.rod]
        shape.capsule = { radius_m = 0.03, to_m = [0.2, 0.1, 0.1] }
        color_srgb = [220, 170, 150]
        path.attached = { to = \"ball\", offset_m = [0, 0.1, 0] }
        [objects.wheel]
        shape.cylinder = { radius_m = 0.15, height_m = 0.05 }
        texture.checker = { size_m = 0.1, colors_srgb = [[20, 20, 30], [220, 200, 230]] }
        tilt_deg = 30
        spin_deg_per_s = 200
        path.still.position_m = [0.3, -0.3, 0.5]";
    for (model, position_m) in MODELS {
        let moving = world_of(model, position_m, more);
        let renderer = Renderer::new(&moving, 0);
        for time_s in [0.0, 0.9] {
            let mut still = moving.clone();
            for (object, placed) in still.objects.iter_mut().zip(moving.placed(time_s)) {
                object.heading_rad = Some(placed.heading_rad);
                (object.tilt_rad, object.spin_rad_per_s) = (placed.tilt_rad, 0.0);
                object.course = Course::Path(Path::Still {
                    position_m: placed.position_m,
                });
            }
            let anew = Renderer::new(&still, 0).image(7, time_s);
            assert!(renderer.image(7, time_s) == anew, "{model} at {time_s} s");
        }
    }
}

#[test]
fn occlusion_and_image_border_reduce_the_visible_fraction() {
    let scene = |ball_y: f64, box_height: f64| {
        world(&format!(
            "duration_s = 1
            [cameras.eye]
            size_px = [320, 240]
            model.pinhole = {{ f_px = [300, 300], center_px = [159.5, 119.5] }}
            look_from_m = [0, 0, 0]
            look_at_m = [1, 0, 0]
            [objects.ball]
            target = true
            shape.sphere.radius_m = 0.1
            color_srgb = [220, 90, 30]
            path.still.position_m = [2, {ball_y}, 0]
            [objects.wall]
            shape.box.size_m = [0.001, 1, {box_height}]
            color_srgb = [220, 90, 30]
            path.still.position_m = [1, 0.5, -0.5]"
        ))
    };
    let visible = |world: &World| truth(world, &world.cameras[0], 0.0)[0].visible_fraction;
    assert!((visible(&scene(0.0, 1.0)) - 0.5).abs() < 0.01);
    // A wall that ends at the ball's height occludes the lower left quarter.
    assert!((visible(&scene(0.0, 0.5)) - 0.75).abs() < 0.01);
    assert_eq!(visible(&scene(-0.3, 1.0)), 1.0);
    assert_eq!(visible(&scene(0.3, 1.0)), 0.0);
    // The image ends at column 319.5: y = -160 / 300 of the distance.
    assert!((visible(&scene(-2.0 * 160.0 / 300.0, 1.0)) - 0.5).abs() < 0.01);
    assert_eq!(visible(&scene(-3.0, 1.0)), 0.0);
    let seen = truth(&scene(0.5, 1.0), &scene(0.5, 1.0).cameras[0], 0.0)[0];
    assert!((seen.pixel.unwrap()[0] - (159.5 - 75.0)).abs() < 1e-9);
    assert!((seen.position_in_camera_m[2] - 2.0).abs() < 1e-12);
}

#[test]
fn attached_objects_turn_with_their_carrier() {
    let world = world(
        "duration_s = 1
        [ring]
        count = 1
        center_m = [0, 0, 0]
        radius_m = 3
        size_px = [32, 24]
        model.pinhole = { f_px = [30, 30], center_px = [15.5, 11.5] }
        [objects.robot]
        shape.cylinder = { radius_m = 0.2, height_m = 0.4 }
        color_srgb = [30, 30, 30]
        path.circle = { center_m = [1, 2, 0], radius_m = 2, period_s = 4 }
        [objects.front]
        target = true
        shape.cylinder = { radius_m = 0.05, height_m = 0.006 }
        color_srgb = [230, 30, 30]
        path.attached = { to = \"robot\", offset_m = [0.15, 0.05, 0.4] }",
    );
    assert!(matches!(world.objects[1].body, Body::Cylinder { .. }));
    // After a quarter turn the robot is at (1, 4) and faces -x.
    let placed = world.placed(1.0);
    let close = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-9);
    assert!(close(placed[0].position_m.into(), [1.0, 4.0, 0.0]));
    assert!((placed[0].heading_rad - std::f64::consts::PI).abs() < 1e-9);
    assert!(close(placed[1].position_m.into(), [0.85, 3.95, 0.4]));
    // The attached object turns with the robot about (1, 2).
    let rate = std::f64::consts::FRAC_PI_2;
    let velocity = placed[1].velocity_mps;
    assert!((velocity.x + 1.95 * rate).abs() < 1e-6, "{velocity}");
    assert!((velocity.y + 0.15 * rate).abs() < 1e-6, "{velocity}");
}
