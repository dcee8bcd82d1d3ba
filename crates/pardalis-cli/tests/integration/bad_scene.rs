//! `pardalis track` on hostile scenes and colour models: every problem ends with exit code 2 and a message that names
//! the file, the key, the line, the problem and the allowed values.

use std::fs;
use std::process::Command;

use crate::common::{BALL_COLORS, Run, SCENE, Workplace, frame_file, scene_with};

#[test]
fn numbers_out_of_range_name_their_key_and_line() {
    let place = Workplace::with_frames(2);
    let equidistant = "equidistant = { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }";
    let center = "center_px = [319.5, 239.5]";
    let models = [
        ("equidistant", "f_px_per_rad"),
        ("perspective_mirror", "m_px"),
        ("unified", "f_px"),
    ];
    let mut cases = Vec::new();
    for value in [
        "nan", "inf", "-inf", "-1", "0", "1e308", "1e400", "true", "[1, 2]",
    ] {
        for (model, focal) in models {
            let others = if model == "unified" {
                "l = 1, m = 0, "
            } else {
                ""
            };
            let text = format!("{model} = {{ {others}{focal} = {value}, {center} }}");
            let key = format!("line 5: cameras.cam1.model.{model}.{focal}: is {value}");
            cases.push((equidistant, text, key));
        }
        if value != "[1, 2]" {
            cases.push((
                equidistant,
                format!("pinhole = {{ f_px = [300, {value}], {center} }}"),
                "line 5: cameras.cam1.model.pinhole.f_px: is [300, ".to_owned(),
            ));
            let key = format!("line 5: cameras.cam1.model.unified.l: is {value}");
            if value != "0" {
                let text = format!("unified = {{ l = {value}, m = 300, {center} }}");
                cases.push((equidistant, text, key));
            }
        }
        for (piece, key) in [
            (
                "radius_m = 0.11",
                "line 8: targets.ball.shape.sphere.radius_m",
            ),
            ("fps = 25", "line 4: cameras.cam1.fps"),
            ("particles = 100", "line 11: targets.ball.filter.particles"),
        ] {
            let name = piece.split(' ').next().unwrap();
            cases.push((
                piece,
                format!("{name} = {value}"),
                format!("{key}: is {value}"),
            ));
        }
    }
    for (piece, other, wanted) in cases {
        let run = place.track(scene_with(piece, &other));
        run.refused(&[
            "scene.toml: a problem in the scene:",
            &wanted,
            "; allowed: ",
        ]);
        assert!(run.stderr.len() < 1000, "{}", run.stderr);
    }
    assert!(!place.path("out").exists());
}

#[test]
fn other_numbers_and_types_name_their_key_and_line() {
    let place = Workplace::with_frames(2);
    let cases = [
        (
            "seed = 1",
            "seed = -1",
            "line 1: seed: is -1; allowed: a whole number",
        ),
        (
            "seed = 1",
            "seed = 1\ntiming.max_delay_s = 61",
            "line 2: timing.max_delay_s: is 61; allowed: 0 to 60",
        ),
        (
            "seed = 1",
            "seed = 1\ntiming.max_delay_s = -0.1",
            "line 2: timing.max_delay_s: is -0.1; allowed: 0 to 60",
        ),
        (
            "seed = 1",
            "seed = 9223372036854775808",
            "line 1: seed: is 9223372036854775808",
        ),
        (
            "seed = 1",
            "seed = 99999999999999999999999",
            "line 1: seed: is 9999",
        ),
        (
            "particles = 100",
            "particles = 1000000000",
            "line 11: targets.ball.filter.particles: is 1000000000; allowed: 1 to 1000000",
        ),
        (
            "[0, 0, -1, 0.9]",
            "[0, 0, 1, 0.9]",
            "line 6: cameras.cam1.world_from_camera: the pose matrix is not a rotation",
        ),
        (
            "[0, 0, -1, 0.9]",
            "[0, 0, -1.1, 0.9]",
            "line 6: cameras.cam1.world_from_camera: the pose matrix is not a rotation",
        ),
        (
            "[0, 0, -1, 0.9]",
            "[0, 0, -1, 1e308]",
            "line 6: cameras.cam1.world_from_camera: the pose matrix is 1e308 in its last column",
        ),
        (
            "[0, 0, 0, 1]",
            "[0, 0, 1, 1]",
            "line 6: cameras.cam1.world_from_camera: the pose matrix is [0.0, 0.0, 1.0, 1.0] in its last row",
        ),
        (
            "[0, 0, 0, 1]",
            "[0, 0, 1]",
            "line 6: cameras.cam1.world_from_camera: is [[0, -1, 0, 0]",
        ),
        (
            "fps = 25",
            "fps = 25\nfirst_frame = 2",
            "line 3: cameras.cam1.images: images: first_frame is 2",
        ),
        (
            "fps = 25",
            "fps = 25\nfirst_frame = -1",
            "line 5: cameras.cam1.first_frame: is -1",
        ),
        (
            "fps = 25",
            "fps = 25\nframe_limit = 0",
            "line 5: cameras.cam1.frame_limit: is 0; allowed: 1 or more",
        ),
        (
            "fps = 25",
            "fps = 25\ntime_offset_s = 1e308",
            "line 5: cameras.cam1.time_offset_s: is 1e308; allowed: -1e12 to 1e12",
        ),
        (
            "position_m = [1.35",
            "position_m = [1e300",
            "line 15: targets.ball.start.gaussian.position_m: is [1e300, -1.25, 0.62]; allowed",
        ),
        (
            "sigma_m = 0.1",
            "sigma_m = -1",
            "line 16: targets.ball.start.gaussian.position_sigma_m: is -1; allowed: 0 to 1000000",
        ),
    ];
    for (piece, other, wanted) in cases {
        let run = place.track(scene_with(piece, other));
        run.refused(&["scene.toml: a problem in the scene:", wanted, "; allowed: "]);
        assert!(run.stderr.len() < 1000, "{}", run.stderr);
    }
    assert!(!place.path("out").exists());
}

/// Any number in any setting is either rejected with its line, or all rows contain finite numbers.
#[test]
fn no_number_causes_invalid_rows() {
    let place = Workplace::with_frames(3);
    let rest = "mask_radius_px = 1000\nmask_center_px = [300.0, 200.0]\nfirst_frame = 1\nframe_limit = 2\n\
                time_offset_s = 0.5\nworld_from";
    let more = "contour = { kappa = 1.5, b = 0.05, points = 50, inner";
    let scene = scene_with("world_from", rest)
        .replace("contour = { inner", more)
        .replace(
            "sigma_m = 0.1",
            "sigma_m = 0.1\nvelocity_mps = [0.25, 0, 0]\nvelocity_sigma_mps = 0.5",
        )
        .replace("particles = 100", "particles = 100, resample_below = 0.5");
    place.track(&scene).fine();
    let mut runs = 0;
    let mut at = 0;
    while let Some(start) = scene[at..]
        .find(|c: char| c.is_ascii_digit())
        .map(|i| at + i)
    {
        let end = start
            + scene[start..]
                .find(|c: char| !(c.is_ascii_digit() || c == '.'))
                .unwrap();
        at = end;
        let is_value = scene[..start].ends_with([' ', '[', '-']);
        if !is_value {
            continue;
        }
        let line = scene[..start].matches('\n').count() + 1;
        for value in [
            "0",
            "1e-320",
            "1e-30",
            "1e9",
            "1e30",
            "1e308",
            "9223372036854775807",
        ] {
            let text = [&scene[..start], value, &scene[end..]].concat();
            // The largest accepted numbers must also be drawable.
            let drawn = if value == "1e9" {
                "--annotate"
            } else {
                "--no-plots"
            };
            let run = place.track_with(text, &["-o", "out", drawn]);
            runs += 1;
            if run.code == Some(2) {
                assert!(
                    run.stderr.contains(&format!("line {line}: "))
                        || run.stderr.contains("first_frame")
                        || run.stderr.contains("mask_center_px"),
                    "{value} in line {line}: {}",
                    run.stderr
                );
                continue;
            }
            assert_eq!(run.code, Some(0), "{value} in line {line}: {}", run.stderr);
            // With some numbers the ball is not found.
            let warned = "warning: targets.ball: was not found in any of the 2 frames\n";
            let is_expected = run.stderr.is_empty() || run.stderr.starts_with(warned);
            assert!(is_expected, "{value} in line {line}: {}", run.stderr);
            for field in place
                .rows()
                .iter()
                .flat_map(|row| [&row[1..2], &row[4..]].concat())
            {
                let finite = field.is_empty() || field.parse::<f64>().unwrap().is_finite();
                assert!(finite, "{value} in line {line}: {:?}", place.rows());
            }
        }
    }
    assert!(runs > 200, "{runs}");
}

#[test]
fn all_problems_of_a_scene_are_reported_in_one_run() {
    let place = Workplace::with_frames(2);
    let scene = scene_with("seed = 1\n", "seed = 1\nseed = 2\nsead = 3\n")
        .replace("fps = 25", "fps = 25\nmask = 7\nmask = 8")
        .replace("radius_m = 0.11", "radius_m = 0\nshape.cube.side_m = 1")
        .replace("colors = \"ball.toml\"\n", "")
        + "[targets.ball.filter]\nx = 1\n[extra]\n[cameras.cam2]\nmodel.unified = { m = 1, center_px = [1] }\n";
    let run = place.track(scene);
    run.refused(&[
        "scene.toml: ",
        "line 2: the key seed is given twice",
        "line 3: sead: is not a key; did you mean seed?",
        "line 7: cameras.cam1.mask: is 7; allowed: a text",
        "line 8: the key mask is given twice",
        "line 11: targets.ball.colors: is missing",
        "line 12: targets.ball.shape.sphere.radius_m: is 0; allowed: above 0",
        "line 13: targets.ball.shape.cube: is not a key; allowed here: sphere",
        "line 21: the key filter is given twice",
        "line 22: targets.ball.filter.x: is not a key; allowed here: min_particles, particles",
        "line 23: extra: is not a key; allowed here: cameras, guessed, platforms, seed, targets",
        "line 24: cameras.cam2: has no input; give images",
        "line 24: cameras.cam2.world_from_camera: is missing",
        "line 25: cameras.cam2.model.unified.l: is missing",
        "line 25: cameras.cam2.model.unified.center_px: is [1]; allowed: two finite",
    ]);
    let lines: Vec<usize> = run
        .stderr
        .lines()
        .skip(1)
        .map(|line| {
            line.trim()
                .split([' ', ':'])
                .nth(1)
                .unwrap()
                .parse()
                .unwrap()
        })
        .collect();
    assert!(lines.is_sorted(), "{}", run.stderr);

    // Problems that appear only when files are opened are reported together as well.
    let scene = scene_with("\"images\"", "\"nowhere\"").replace("ball.toml", "none.toml");
    place.track(scene).refused(&[
        "2 problems",
        "line 3: cameras.cam1.images: nowhere",
        "line 9: targets.ball.colors: none.toml",
    ]);
}

#[test]
fn files_that_are_not_scenes_are_rejected() {
    let place = Workplace::with_frames(1);
    let missing = [
        "cameras: is missing",
        "[cameras.NAME]",
        "targets: is missing",
        "[targets.NAME]",
    ];
    place.track("").refused(&missing);
    place
        .track("seed = 1\n[cameras]\n[targets]\n")
        .refused(&["line 2: cameras: is empty", "line 3: targets: is empty"]);
    place
        .track((0..=255).collect::<Vec<u8>>())
        .refused(&["scene.toml: line 2: is not UTF-8 text"]);
    place
        .track(b"seed = 1\n# caf\xe9\n")
        .refused(&["scene.toml: line 2: is not UTF-8 text; save"]);
    place
        .track("seed = 1\0\n")
        .refused(&["scene.toml", "line 1"]);
    place
        .track("#".repeat(20 << 20))
        .refused(&["scene.toml: has 20971520 bytes; allowed: at most"]);
    place
        .track(fs::read(frame_file(0)).unwrap())
        .refused(&["scene.toml: is an image, not a scene; `pardalis init FOLDER` writes"]);
    place.track(b"\0\0\0\x20ftypisom\0\0\x02\0\xff").refused(&[
        "scene.toml: is a video, not a scene; `pardalis init scene.toml` writes a scene of it",
    ]);
    for (number, has_remedy) in [("0,11", true), ("0.11 1", false)] {
        let run = place.track(scene_with("0.11\n", &format!("{number}\n")));
        let quoted = format!("line 8: at `shape.sphere.radius_m = {number}`: ");
        run.refused(&[&format!("scene.toml: a problem in the scene:\n  {quoted}")]);
        let remedy = "; use a decimal point instead of the comma\n";
        assert_eq!(run.stderr.ends_with(remedy), has_remedy, "{}", run.stderr);
    }
    // Only the name is wrong: nothing is missing.
    place.track(scene_with("radius_m", "raduis_m")).refused(&[
        "scene.toml: a problem in the scene:\n  line 8: targets.ball.shape.sphere.raduis_m: is not a key; did you mean radius_m?\n",
    ]);
    let both = scene_with(
        "shape.sphere.radius_m",
        "shape.cube.side_m = 1\nshape.sphere.radius_m",
    );
    place
        .track(both)
        .refused(&["line 8: targets.ball.shape.cube: is not a key"]);
    let both = scene_with("model.equi", "model.pinhole = {}\nmodel.equi");
    place
        .track(both)
        .refused(&["cameras.cam1.model: has \"equidistant\", \"pinhole\"; keep one of them"]);
    let near = scene_with("model.equidistant", "model.equidistent");
    place.track(near).refused(&[
        "line 5: cameras.cam1.model.equidistent: is not a key; did you mean equidistant?",
    ]);

    let program = || Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let folder = |name: &str| Run::of(program().arg("track").arg(place.path(name)));
    folder("").refused(&["is a folder; give the scene in it: ", "scene.toml"]);
    folder("images").refused(&["is a folder without scene.toml", "`pardalis init "]);
    Run::of(program().args(["track", "no/such.toml"])).refused(&["no/such.toml: cannot be read"]);
}

#[test]
fn deep_and_long_scenes_are_rejected_quickly() {
    let place = Workplace::with_frames(1);
    let keys = vec!["a"; 10_000].join(".");
    let cases = [
        format!("a = {}{}", "[".repeat(10_000), "]".repeat(10_000)),
        format!("a = {}", "[".repeat(1_000_000)),
        format!("a = {}1{}", "{ a = ".repeat(10_000), " }".repeat(10_000)),
        format!("{keys} = 1"),
        format!("[{keys}]"),
        format!("[[cameras.{keys}]]"),
    ];
    for text in cases {
        place
            .track(text)
            .refused(&["scene.toml", "line 1: ", "too deep"]);
    }
    let numbered: Vec<_> = (0..200_000).map(|i| format!("key{i} = 1")).collect();
    place
        .track(numbered.join("\n"))
        .refused(&["line 1: ", "is not a key", "more"]);
    place
        .track("a = 1\n".repeat(50_000))
        .refused(&["line 2: the key a is given twice"]);
    let long = place.track(format!(
        "{} = {}",
        "k".repeat(1_000_000),
        "9".repeat(1_000_000)
    ));
    long.refused(&["is not a key"]);
    assert!(long.stderr.len() < 2000);
}

#[test]
fn invalid_color_models_are_rejected() {
    let place = Workplace::with_frames(1);
    let refused_colors = |text: &[u8], wanted: &[&str]| {
        place.write("ball.toml", text);
        let run = place.track(SCENE);
        run.refused(&[
            "scene.toml",
            "line 9: targets.ball.colors: ball.toml: ",
            "pardalis learn",
        ]);
        run.refused(wanted);
    };
    for length in (0..BALL_COLORS.len()).step_by(50) {
        refused_colors(&BALL_COLORS.as_bytes()[..length], &["line "]);
    }
    let with = |piece: &str, other: &str| BALL_COLORS.replace(piece, other).into_bytes();
    refused_colors(&with("[palette.hsi]", "[palette.hsv]"), &["line ", "hsv"]);
    refused_colors(
        &with("[palette.hsi]\nhue_bins", "[palette.yuv]\nhue_bins"),
        &["line "],
    );
    refused_colors(
        &with("hue_bins = 12", "hue_bins = 65"),
        &["line 18", "65; allowed: 1 to 64"],
    );
    refused_colors(
        &with("hue_bins = 12", "hue_bins = 0"),
        &["line 18", "0; allowed: 1 to 64"],
    );
    refused_colors(
        &with("saturation_bins = 12", "saturation_bins = 9"),
        &["line 5", "bin 0, 9, 1 does not exist"],
    );
    refused_colors(
        &with("1553", "1552"),
        &["line 2: pixel_count is 1552, but the bins hold 1553"],
    );
    refused_colors(
        &with("model 1", "model 2"),
        &["line 1: format is \"pardalis color model 2\"; expected"],
    );
    refused_colors(&with("302", "-302"), &["line 6"]);
    refused_colors(&with("302", "1e308"), &["line 6"]);
    refused_colors(&with("302", "0"), &["line 6", "allowed: 1 to 2^40"]);
    refused_colors(b"\xff\xfe", &["is not UTF-8"]);
    refused_colors(&vec![b'#'; 20 << 20], &["allowed: at most"]);
    fs::remove_file(place.path("ball.toml")).unwrap();
    let run = place.track(SCENE);
    run.refused(&[
        "line 9: targets.ball.colors: ball.toml: cannot be read",
        "pardalis learn",
    ]);
}

#[test]
fn clicked_pixels_without_a_ray_are_rejected() {
    let place = Workplace::with_frames(1);
    let (before, _) = SCENE.split_once("[targets.ball.start").unwrap();
    let scene = |pixel: &str| format!("{before}[targets.ball.start.pixel]\npixel_px = {pixel}\n");
    for pixel in [
        "[9999, 5]",
        "[-5, 100]",
        "[0, 0]",
        "[1e300, 1]",
        "[640, 240]",
        "[320, 479.6]",
    ] {
        let run = place.track(scene(pixel));
        run.refused(&[
            "scene.toml",
            "line 15: targets.ball.start.pixel.pixel_px: ",
            "allowed: a pixel of the 640 x 480 image",
            "field of view",
        ]);
        assert!(!place.path("out").exists());
    }
    place
        .track(scene("[nan, 1]"))
        .refused(&["line 15", "is [nan, 1]; allowed: two finite numbers"]);
    place
        .track(scene("[460, 88]\ncamera = \"cam7\""))
        .refused(&[
            "line 16: targets.ball.start.pixel.camera: is the text \"cam7\"; allowed: cam1",
        ]);
}
