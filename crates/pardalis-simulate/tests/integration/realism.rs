//! What real balls, hands, lenses and shutters do to images, measured in pixels.

use pardalis_simulate::{Renderer, World, linear_from_srgb, truth};

use crate::world;

const SIZE: (usize, usize) = (320, 240);

/// Returns a world in even light in which a camera at the origin looks along x, 300 px per radian.
fn ahead(image: &str, objects: &str) -> World {
    world(&format!(
        "duration_s = 1
        room.texture.plain.color_srgb = [90, 90, 90]
        light.ambient = 1.0
        image = {{ {image} }}
        [cameras.eye]
        size_px = [320, 240]
        model.pinhole = {{ f_px = [300, 300], center_px = [159.5, 119.5] }}
        look_from_m = [0, 0, 0]
        look_at_m = [1, 0, 0]
        {objects}
        [objects.target]
        target = true
        shape.sphere.radius_m = 0.1
        color_srgb = [0, 0, 0]
        path.still.position_m = [-9, 0, 0]"
    ))
}

/// Renders the first camera's image.
fn image(world: &World, time_s: f64) -> Vec<u8> {
    Renderer::new(world, 0).image(0, time_s)
}

fn pixel(image: &[u8], u: usize, v: usize) -> [u8; 3] {
    let at = 3 * (v * SIZE.0 + u);
    [image[at], image[at + 1], image[at + 2]]
}

/// Returns the column, to a fraction of a pixel, at which a row's share of the way from the light of one grey value to
/// that of another first reaches a level.
fn crossing(image: &[u8], row: usize, [from, to]: [f64; 2], level: f64) -> f64 {
    let light = |grey: f64| linear_from_srgb([grey; 3])[0];
    let share = |u: usize| {
        let seen = light(f64::from(pixel(image, u, row)[0]));
        (seen - light(from)) / (light(to) - light(from))
    };
    let after = (1..SIZE.0).find(|&u| share(u) >= level).unwrap();
    let (low, high) = (share(after - 1), share(after));
    after as f64 - (high - level) / (high - low)
}

/// A white wall whose left edge is seen at column 159.5, and which moves to the right at 150 px/s.
const WALL: &str = "[objects.wall]
    shape.box.size_m = [0.002, 2, 2]
    color_srgb = [250, 250, 250]
    heading_deg = 0
    path.line = { position_m = [1.001, -1, -1], velocity_mps = [0, -0.5, 0] }";
const WALL_PXPS: f64 = 150.0;
const GREYS: [f64; 2] = [90.0, 250.0];

#[test]
fn defocus_widens_edges_to_its_standard_deviation() {
    for sigma_px in [2.0_f64, 4.0, 8.0] {
        let image = image(&ahead(&format!("blur_px = {sigma_px}"), WALL), 0.0);
        let at = |level| crossing(&image, 120, GREYS, level);
        // Between one standard deviation below and above the edge lie 68 % of a normal distribution. A pixel is as wide
        // as a standard deviation of 0.29 px.
        let found_px = 0.5 * (at(0.841_34) - at(0.158_66));
        let expected_px = sigma_px.hypot(0.29);
        assert!(
            (found_px / expected_px - 1.0).abs() < 0.02,
            "{sigma_px}: {found_px} px"
        );
        assert!((at(0.5) - 159.5).abs() < 0.1);
    }
}

#[test]
fn exposure_smears_edges_over_the_way_that_they_travel() {
    let exposed = "shutter_s = 0.08, instants = 60";
    let image = image(&ahead(exposed, WALL), 0.2);
    let at = |level| crossing(&image, 120, GREYS, level);
    let way_px = (at(0.9) - at(0.1)) / 0.8;
    assert!((way_px - 0.08 * WALL_PXPS).abs() < 0.2, "{way_px} px");
    assert!((at(0.5) - 159.5 - 0.2 * WALL_PXPS).abs() < 0.2);
}

#[test]
fn rolling_shutter_skews_what_moves_and_keeps_the_middle_row() {
    let column = |line_delay_s: f64, row| {
        let world = ahead(&format!("blur_px = 2, line_delay_s = {line_delay_s}"), WALL);
        crossing(&image(&world, 0.1), row, GREYS, 0.5)
    };
    for line_delay_s in [0.0, 1e-3, -5e-4] {
        for row in [20, 60, 119, 220] {
            let late_s = 0.1 + line_delay_s * (row as f64 - 119.5);
            let expected = 159.5 + WALL_PXPS * late_s;
            let found = column(line_delay_s, row);
            // Rays are a third of a pixel apart.
            assert!(
                (found - expected).abs() < 0.2,
                "{line_delay_s} {row}: {found} {expected}"
            );
        }
    }
}

#[test]
fn rows_of_a_rolling_shutter_are_rows_of_images_at_their_times() {
    let objects = "[objects.stick]
        shape.capsule = { radius_m = 0.05, to_m = [0, 0.4, 0.2] }
        color_srgb = [220, 170, 150]
        spin_deg_per_s = 300
        path.circle = { center_m = [1.5, 0, 0], radius_m = 0.3, period_s = 0.7 }
        [objects.ball]
        shape.sphere.radius_m = 0.1
        texture.checker = { size_m = 0.1, colors_srgb = [[220, 120, 30], [80, 120, 130]] }
        path.line = { position_m = [1.2, 0.5, -0.3], velocity_mps = [0, -3, 2] }";
    let world = ahead("line_delay_s = 0.001", objects);
    let all_at_once = ahead("line_delay_s = 0", objects);
    let renderer = Renderer::new(&all_at_once, 0);
    let rolling = image(&world, 0.2);
    let bytes = 3 * SIZE.0;
    for row in 0..SIZE.1 {
        let time_s = 0.2 + 0.001 * (row as f64 - 119.5);
        let at_its_time = renderer.image(0, time_s);
        let span = row * bytes..(row + 1) * bytes;
        assert!(rolling[span.clone()] == at_its_time[span], "row {row}");
    }
    assert!(rolling != renderer.image(0, 0.2));
}

#[test]
fn seams_and_logos_are_seen_turn_with_the_ball_and_belong_to_it() {
    let world = ahead(
        "samples = 3",
        "[objects.ball]
        shape.sphere.radius_m = 0.2
        color_srgb = [235, 110, 30]
        seams = { color_srgb = [20, 20, 20], width_m = 0.02, count = 2 }
        logo = { color_srgb = [240, 240, 240], radius_m = 0.06, direction = [-1, 0, 0] }
        heading_deg = 0
        spin_deg_per_s = 180
        path.still.position_m = [1, 0, 0]",
    );
    let images = [0.0, 0.25, 0.5, 1.0].map(|time_s| image(&world, time_s));
    let [start, eighth, quarter, half] = &images;
    let (orange, black, white) = ([235, 110, 30], [20; 3], [240; 3]);
    // The ball is 61 px in radius. At first the logo covers the middle, where the seams cross.
    assert_eq!(pixel(start, 160, 120), white);
    assert_eq!([pixel(start, 120, 120), pixel(start, 160, 80)], [black; 2]);
    assert_eq!(pixel(start, 120, 80), orange);
    // The ball rolls away: the logo goes up and over its top, and the horizontal seam to its outline and back.
    assert_eq!(pixel(eighth, 160, 70), white);
    assert_eq!(
        [pixel(eighth, 160, 120), pixel(quarter, 160, 90)],
        [black; 2]
    );
    assert_eq!(pixel(quarter, 120, 120), orange);
    assert_eq!([pixel(half, 160, 120), pixel(half, 120, 120)], [black; 2]);
    let width = (0..SIZE.1)
        .filter(|&v| pixel(half, 120, v) == black)
        .count();
    // 0.02 m at a distance of 0.85 m and slightly foreshortened.
    assert!((5..=7).contains(&width), "{width} px");
    // The mask covers seams and logo.
    let coverage = Renderer::new(&world, 0).coverage(0, 0.0);
    let area: f64 = coverage.iter().copied().map(f64::from).sum();
    // A sphere at distance 1 and radius 0.2 covers a disc of tan(asin 0.2) · 300 px.
    let radius_px = 300.0 * 0.2 / (1.0 - 0.04_f64).sqrt();
    let expected = std::f64::consts::PI * radius_px * radius_px;
    assert!((area / expected - 1.0).abs() < 0.002, "{area} {expected}");
}

#[test]
fn streaks_are_fixed_to_the_ball() {
    let ball = |heading_deg: f64, y_m: f64| {
        let objects = format!(
            "[objects.ball]
            shape.sphere.radius_m = 0.1
            texture.noise = {{ size_m = 0.08, octaves = 3, colors_srgb = [[235, 110, 30], [40, 20, 220]] }}
            heading_deg = {heading_deg}
            path.still.position_m = [3, {y_m}, 0]"
        );
        image(&ahead("samples = 2", &objects), 0.0)
    };
    let patch = |image: &[u8], u: usize| -> Vec<[u8; 3]> {
        (118..122)
            .flat_map(|v| (u - 2..u + 2).map(move |u| (u, v)))
            .map(|(u, v)| pixel(image, u, v))
            .collect()
    };
    let (middle, turned) = (ball(0.0, 0.0), ball(90.0, 0.0));
    assert_ne!(patch(&middle, 160), patch(&turned, 160));
    // Moved aside by 0.3 m, 30 px, it is seen from another direction; turned by as much, it shows the same side.
    let aside = ball(-f64::atan2(0.3, 3.0).to_degrees(), -0.3);
    for (a, b) in patch(&middle, 160).iter().zip(patch(&aside, 190)) {
        assert!((0..3).all(|i| a[i].abs_diff(b[i]) < 12), "{a:?} {b:?}");
    }
    let range = |channel: usize| {
        let inside = (152..168).map(|u| pixel(&middle, u, 120)[channel]);
        inside.clone().max().unwrap() - inside.min().unwrap()
    };
    assert!(range(2) > 40);
}

#[test]
fn fingers_hide_a_part_of_the_ball_and_move_with_it() {
    let world = ahead(
        "samples = 3",
        "[objects.ball]
        shape.sphere.radius_m = 0.1
        color_srgb = [235, 110, 30]
        heading_deg = 0
        path.line = { position_m = [1, 0, 0], velocity_mps = [0, -0.2, 0] }
        [objects.finger]
        shape.capsule = { radius_m = 0.02, to_m = [0, -0.2, 0] }
        color_srgb = [220, 170, 150]
        path.attached = { to = \"ball\", offset_m = [-0.12, 0.1, -0.05] }",
    );
    for (time_s, moved_px) in [(0.0, 0), (0.5, 30)] {
        let image = image(&world, time_s);
        assert_eq!(pixel(&image, 160 + moved_px, 137), [220, 170, 150]);
        assert_eq!(pixel(&image, 160 + moved_px, 110), [235, 110, 30]);
        let ball = truth(&world, &world.cameras[0], time_s)[0];
        assert!((0.6..0.9).contains(&ball.visible_fraction), "{ball:?}");
    }
}

#[test]
fn tilted_discs_show_their_face() {
    let area = |tilt_deg: f64| {
        let objects = format!(
            "[objects.disc]
            shape.cylinder = {{ radius_m = 0.2, height_m = 0.001 }}
            color_srgb = [235, 110, 30]
            heading_deg = 0
            tilt_deg = {tilt_deg}
            path.still.position_m = [2, 0, 0]"
        );
        let world = ahead("samples = 3", &objects);
        let coverage = Renderer::new(&world, 0).coverage(0, 0.0);
        coverage.iter().copied().map(f64::from).sum::<f64>()
    };
    // 30 px in radius.
    let full = std::f64::consts::PI * 900.0;
    assert!(area(0.0) < 20.0);
    for tilt_deg in [30.0_f64, 90.0, -150.0] {
        let share = area(tilt_deg) / full / tilt_deg.to_radians().sin().abs();
        assert!((share - 1.0).abs() < 0.03, "{tilt_deg}: {share}");
    }
}
