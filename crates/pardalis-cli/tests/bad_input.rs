//! `pardalis track` on hostile input: every fault of the user's ends with exit code 2 and a message that names the file, the key or line, what is
//! wrong and what is allowed; rows written before stay whole.

mod common;

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use common::{BALL_COLORS, Run, SCENE, Workplace, frame_file, rows_in, scene_with};

/// Checks that the user's input was refused with a message that holds all of `wanted`.
#[track_caller]
fn refused(run: &Run, wanted: &[&str]) {
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(run.stderr.starts_with("error: "), "{}", run.stderr);
    for wanted in wanted {
        assert!(
            run.stderr.contains(wanted),
            "no {wanted:?} in: {}",
            run.stderr
        );
    }
}

/// A PNG file that is but its header and its end.
fn png_of_size(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
    bytes.extend(width.to_be_bytes());
    bytes.extend(height.to_be_bytes());
    bytes.extend(b"\x08\x02\0\0\0\0\0\0\0\0\0\0\0IEND\xae\x42\x60\x82");
    bytes
}

/// A frame whose header states another size.
fn jpeg_of_size(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = fs::read(frame_file(0)).unwrap();
    let marker = bytes.windows(2).position(|b| b == [0xFF, 0xC0]).unwrap();
    bytes[marker + 5..marker + 7].copy_from_slice(&height.to_be_bytes());
    bytes[marker + 7..marker + 9].copy_from_slice(&width.to_be_bytes());
    bytes
}

fn grey_png(place: &Workplace, name: &str, width: u32, height: u32, grey: u8) {
    let image = image::GrayImage::from_pixel(width, height, image::Luma([grey]));
    image.save(place.path(name)).unwrap();
}

#[test]
fn a_faulty_image_in_the_middle_keeps_the_rows_before_it() {
    let whole = fs::read(frame_file(3)).unwrap();
    let mut small = Vec::new();
    image::RgbImage::new(320, 240)
        .write_to(
            &mut std::io::Cursor::new(&mut small),
            image::ImageFormat::Jpeg,
        )
        .unwrap();
    let cases: [(&str, Vec<u8>, &str); 9] = [
        ("cut off", whole[..whole.len() / 2].to_vec(), "cut off"),
        ("cut header", whole[..100].to_vec(), "cut off"),
        ("one byte", vec![0xFF], "not a JPEG or PNG"),
        ("empty", Vec::new(), "0 bytes"),
        ("no pixels", jpeg_of_size(0, 0), "no pixels (0 x 0)"),
        ("another size", small, "320 x 240"),
        ("text", b"hello".to_vec(), "not a JPEG or PNG"),
        ("huge JPEG", jpeg_of_size(60_000, 60_000), "at most 16384"),
        ("huge PNG", png_of_size(60_000, 60_000), "at most 16384"),
    ];
    for (name, bytes, wanted) in cases {
        let place = Workplace::with_frames(5);
        fs::write(place.image(3), bytes).unwrap();
        let run = place.track(SCENE);
        refused(&run, &["000003.jpg", wanted]);
        assert_eq!(place.rows().len(), 3, "{name}");
        let summary = fs::read_to_string(place.path("out/summary.json")).unwrap();
        assert!(summary.contains("000003.jpg"), "{summary}");
    }
    // The first one sets the size, before anything runs.
    let place = Workplace::with_frames(3);
    fs::write(place.image(0), png_of_size(60_000, 60_000)).unwrap();
    refused(
        &place.track(SCENE),
        &["scene.toml", "line 3", "000000.jpg", "60000 x 60000"],
    );
}

#[test]
fn faulty_masks() {
    let place = Workplace::with_frames(2);
    grey_png(&place, "small.png", 64, 48, 255);
    grey_png(&place, "black.png", 640, 480, 127);
    grey_png(&place, "white.png", 640, 480, 255);
    place.write("text.png", "no image");
    for (mask, wanted) in [
        ("mask = \"small.png\"", &["64 x 48", "640 x 480"][..]),
        (
            "mask = \"black.png\"",
            &["black.png", "white (128 or more)"],
        ),
        ("mask = \"none.png\"", &["none.png", "can not be read"]),
        ("mask = \"text.png\"", &["text.png", "not a JPEG or PNG"]),
        ("mask = \".\"", &["can not be read"]),
        ("mask_radius_px = 0.1", &["mask_radius_px", "larger radius"]),
        ("mask_radius_px = 0", &["is 0; allowed: a positive"]),
        ("mask_radius_px = nan", &["is nan; allowed: a finite"]),
        (
            "mask_radius_px = 9\nmask_center_px = [1e308, 0]\nmask = \"white.png\"",
            &["mask_radius_px", "mask_center_px"],
        ),
        ("mask_center_px = [1, 2]", &["needs mask_radius_px"]),
        ("size_px = [320, 240]", &["320 x 240", "640 x 480"]),
    ] {
        let scene = scene_with("fps = 25", &format!("fps = 25\n{mask}"));
        let run = place.track(scene);
        refused(&run, &["scene.toml", "line 5: cameras.cam1."]);
        refused(&run, wanted);
    }
}

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
    let others = [
        (
            "seed = 1",
            "seed = -1",
            "line 1: seed: is -1; allowed: a whole number",
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
            "line 6: cameras.cam1.world_from_camera: the pose matrix is no rotation",
        ),
        (
            "[0, 0, -1, 0.9]",
            "[0, 0, -1.1, 0.9]",
            "line 6: cameras.cam1.world_from_camera: the pose matrix is no rotation",
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
            "line 16: targets.ball.start.gaussian.position_sigma_m: is -1; allowed: 0 to 1e6",
        ),
    ];
    cases.extend(others.map(|(piece, other, key)| (piece, other.to_owned(), key.to_owned())));
    for (piece, other, wanted) in cases {
        let run = place.track(scene_with(piece, &other));
        refused(
            &run,
            &[
                "scene.toml: a problem in the scene:",
                &wanted,
                "; allowed: ",
            ],
        );
        assert!(run.stderr.len() < 1000, "{}", run.stderr);
    }
    assert!(!place.path("out").exists());
}

/// Whatever number stands anywhere: it is refused with its line, or all of the rows are finite numbers.
#[test]
fn no_number_makes_rows_that_are_none() {
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
            // The greatest numbers that are taken must also be drawn.
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
            run.fine();
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
fn faulty_times() {
    let place = Workplace::with_frames(3);
    let scene = scene_with("fps = 25\n", "");
    let refused_times = |text: &str, wanted: &[&str]| {
        place.write("images/times.csv", text);
        let run = place.track(&scene);
        refused(
            &run,
            &["scene.toml", "line 3: cameras.cam1.images: ", "times.csv"],
        );
        refused(&run, wanted);
    };
    for time in ["nan", "inf", "-inf", "1e308", "1e400", "", "soon", "1,5"] {
        let text = format!("frame,time_s\n0,0\n1,{time}\n2,0.08\n");
        refused_times(
            &text,
            &[
                "line 3",
                if time == "1,5" {
                    "fields"
                } else {
                    "number of seconds"
                },
            ],
        );
    }
    refused_times(
        "frame,time_s\n0,0\n1,0.08\n2,0.04\n",
        &["line 4", "runs backwards, from 0.08 to 0.04"],
    );
    refused_times(
        "frame,time_s\n0,0\n1,0.04\n1,0.08\n2,0.1\n",
        &["line 4", "frame 1 is given a second time"],
    );
    refused_times(
        "frame,time_s\n0,0\n2,0.04\n1,0.08\n",
        &["line 4", "frames must ascend"],
    );
    refused_times(
        "frame,time_s\n0,0\n-1,0.04\n",
        &["line 3", "whole number from 0"],
    );
    refused_times(
        "frame,time_s\n0,0\n99999999999999999999,0.04\n",
        &["line 3", "whole number from 0"],
    );
    refused_times(
        "frame,time_s\n0,0\n2,0.04\n",
        &["no row for frame 1 (000001.jpg)"],
    );
    refused_times("", &["line 1", "no column frame"]);
    refused_times("time_s,number\n0,0\n", &["line 1", "no column frame"]);
    refused_times("frame,time_s\n0,0\n\u{0}\u{1}\n", &["line 3"]);

    let run = place.track(SCENE);
    refused(
        &run,
        &[
            "line 3: cameras.cam1.images",
            "times.csv",
            "gives fps; keep one",
        ],
    );
    fs::remove_file(place.path("images/times.csv")).unwrap();
    refused(
        &place.track(&scene),
        &["line 3: cameras.cam1.images", "give fps"],
    );

    // A gap of numbers that no clock spans.
    fs::copy(frame_file(3), place.path("images/9223372036854775807.jpg")).unwrap();
    refused(
        &place.track(SCENE),
        &["images", "time_s is", "-1e12 to 1e12"],
    );
    assert_eq!(place.rows().len(), 3);
}

#[test]
fn all_problems_of_a_scene_in_one_run() {
    let place = Workplace::with_frames(2);
    let scene = scene_with("seed = 1\n", "seed = 1\nseed = 2\nsead = 3\n")
        .replace("fps = 25", "fps = 25\nmask = 7\nmask = 8")
        .replace("radius_m = 0.11", "radius_m = 0\nshape.cube.side_m = 1")
        .replace("colors = \"ball.toml\"\n", "")
        + "[targets.ball.filter]\nx = 1\n[extra]\n[cameras.cam2]\nmodel.unified = { m = 1, center_px = [1] }\n";
    let run = place.track(scene);
    refused(
        &run,
        &[
            "scene.toml: ",
            "line 2: the key seed stands there twice",
            "line 3: sead: is not a key; did you mean seed?",
            "line 7: cameras.cam1.mask: is 7; allowed: a text",
            "line 8: the key mask stands there twice",
            "line 11: targets.ball.colors: is missing",
            "line 12: targets.ball.shape.sphere.radius_m: is 0; allowed: above 0",
            "line 13: targets.ball.shape.cube: is not a key; allowed here: sphere",
            "line 21: the key filter stands there twice",
            "line 22: targets.ball.filter.x: is not a key; allowed here: particles",
            "line 23: extra: is not a key; allowed here: cameras, seed, targets",
            "line 24: cameras.cam2: says no input; give images",
            "line 24: cameras.cam2.world_from_camera: is missing",
            "line 25: cameras.cam2.model.unified.l: is missing",
            "line 25: cameras.cam2.model.unified.center_px: is [1]; allowed: two finite",
        ],
    );
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

    // Problems that show only when files are opened come all at once as well.
    let scene = scene_with("\"images\"", "\"nowhere\"").replace("ball.toml", "none.toml");
    refused(
        &place.track(scene),
        &[
            "2 problems",
            "line 3: cameras.cam1.images: nowhere",
            "line 9: targets.ball.colors: none.toml",
        ],
    );
}

#[test]
fn files_that_are_no_scenes() {
    let place = Workplace::with_frames(1);
    let missing = [
        "cameras: is missing",
        "[cameras.NAME]",
        "targets: is missing",
        "[targets.NAME]",
    ];
    refused(&place.track(""), &missing);
    refused(
        &place.track("seed = 1\n[cameras]\n[targets]\n"),
        &["line 2: cameras: is empty", "line 3: targets: is empty"],
    );
    refused(
        &place.track((0..=255).collect::<Vec<u8>>()),
        &["scene.toml: line 2: is no UTF-8 text"],
    );
    refused(
        &place.track(b"seed = 1\n# caf\xe9\n"),
        &["scene.toml: line 2: is no UTF-8 text; save"],
    );
    refused(&place.track("seed = 1\0\n"), &["scene.toml", "line 1"]);
    refused(
        &place.track("#".repeat(20 << 20)),
        &["scene.toml: has 20971520 bytes; allowed: at most"],
    );
    refused(
        &place.track(fs::read(frame_file(0)).unwrap()),
        &["scene.toml: line 1: is no UTF-8"],
    );
    let both = scene_with(
        "shape.sphere.radius_m",
        "shape.cube.side_m = 1\nshape.sphere.radius_m",
    );
    refused(
        &place.track(both),
        &["line 8: targets.ball.shape.cube: is not a key"],
    );
    let both = scene_with("model.equi", "model.pinhole = {}\nmodel.equi");
    refused(
        &place.track(both),
        &["cameras.cam1.model: has \"equidistant\", \"pinhole\"; allowed: one"],
    );
    let near = scene_with("model.equidistant", "model.equidistent");
    refused(
        &place.track(near),
        &["line 5: cameras.cam1.model.equidistent: is not a key; did you mean equidistant?"],
    );

    let program = || Command::new(env!("CARGO_BIN_EXE_pardalis"));
    refused(
        &Run::of(program().arg("track").arg(place.path(""))),
        &["is a folder or a device; give a text file"],
    );
    refused(
        &Run::of(program().args(["track", "no/such.toml"])),
        &["no/such.toml: can not be read"],
    );
}

#[test]
fn deep_and_long_scenes_end_soon() {
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
        refused(&place.track(text), &["scene.toml", "line 1: ", "too deep"]);
    }
    let numbered: String = (0..200_000).map(|i| format!("key{i} = 1\n")).collect();
    refused(
        &place.track(numbered),
        &["line 1: ", "is not a key", "more"],
    );
    refused(
        &place.track("a = 1\n".repeat(50_000)),
        &["line 2: the key a stands there twice"],
    );
    let long = place.track(format!(
        "{} = {}",
        "k".repeat(1_000_000),
        "9".repeat(1_000_000)
    ));
    refused(&long, &["is not a key"]);
    assert!(long.stderr.len() < 2000);
}

#[test]
fn outputs_that_can_not_be_written() {
    let place = Workplace::with_frames(2);
    place.write("file", "mine");
    refused(
        &place.track_with(SCENE, &["-o", "file"]),
        &["-o file: this is a file; give a folder"],
    );
    refused(
        &place.track_with(SCENE, &["-o", "file/below"]),
        &["-o file/below: ", "give a folder that can be written"],
    );
    assert_eq!(fs::read(place.path("file")).unwrap(), b"mine");
    fs::create_dir_all(place.path("out/tracks.csv")).unwrap();
    refused(&place.track(SCENE), &["-o out: "]);
    if cfg!(target_os = "linux") {
        let full = fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let run = Run::of(place.command(SCENE, &["-o", "-"]).stdout(full));
        assert_eq!(run.code, Some(1));
        assert!(
            run.stderr
                .starts_with("error: standard output: the rows cannot be written: No space"),
            "{}",
            run.stderr
        );
    }
}

#[test]
fn a_reader_who_has_seen_enough_ends_the_run_quietly() {
    let place = Workplace::with_frames(12);
    for lines in [0, 1, 3] {
        let mut child = place
            .command(SCENE, &["-o", "-"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut reader = BufReader::new(child.stdout.take().unwrap());
        for _ in 0..lines {
            reader.read_line(&mut String::new()).unwrap();
        }
        drop(reader);
        let output = child.wait_with_output().unwrap();
        assert_eq!(
            (output.status.code(), &output.stderr[..]),
            (Some(0), &b""[..]),
            "{lines} lines"
        );
    }
    // Nor do the words at the end need a reader.
    let mut child = place
        .command(SCENE, &["-o", "out", "--no-plots"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(
        (output.status.code(), &output.stderr[..]),
        (Some(0), &b""[..])
    );
    assert_eq!(place.rows().len(), 12);
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_the_rows_and_says_so() {
    let place = Workplace::with_frames(1);
    // Hard links to one image: a long sequence that costs no room.
    for number in 1..500 {
        fs::hard_link(place.image(0), place.image(number)).unwrap();
    }
    let scene = scene_with("particles = 100", "particles = 20000");
    let mut child = place
        .command(scene, &["-o", "out", "--no-plots"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let tracks = place.path("out/tracks.csv");
    while fs::read_to_string(&tracks)
        .unwrap_or_default()
        .lines()
        .count()
        < 4
    {
        assert!(
            child.try_wait().unwrap().is_none(),
            "it ended before it wrote rows"
        );
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let sent = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let rows = place.rows().len();
    assert!((3..500).contains(&rows), "{rows}");
    assert!(
        stderr.starts_with(&format!("error: interrupted after {rows} frames")),
        "{stderr}"
    );
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("out/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["interrupted"], true);
    assert_eq!(summary["frame_sets"], rows);
}

#[test]
fn faulty_color_models() {
    let place = Workplace::with_frames(1);
    let refused_colors = |text: &[u8], wanted: &[&str]| {
        place.write("ball.toml", text);
        let run = place.track(SCENE);
        refused(
            &run,
            &[
                "scene.toml",
                "line 9: targets.ball.colors: ball.toml: ",
                "pardalis learn",
            ],
        );
        refused(&run, wanted);
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
        &["line 1: format is \"pardalis color model 2\"; allowed"],
    );
    refused_colors(&with("302", "-302"), &["line 6"]);
    refused_colors(&with("302", "1e308"), &["line 6"]);
    refused_colors(&with("302", "0"), &["line 6", "allowed: 1 to 2^40"]);
    refused_colors(b"\xff\xfe", &["is no UTF-8"]);
    refused_colors(&vec![b'#'; 20 << 20], &["allowed: at most"]);
    fs::remove_file(place.path("ball.toml")).unwrap();
    let run = place.track(SCENE);
    refused(
        &run,
        &[
            "line 9: targets.ball.colors: ball.toml: can not be read",
            "pardalis learn",
        ],
    );
}

#[test]
fn clicked_pixels_where_there_is_no_ray() {
    let place = Workplace::with_frames(1);
    let (before, _) = SCENE.split_once("[targets.ball.start").unwrap();
    let scene = |pixel: &str| format!("{before}[targets.ball.start.pixel]\npixel = {pixel}\n");
    for pixel in [
        "[9999, 5]",
        "[-5, 100]",
        "[0, 0]",
        "[1e300, 1]",
        "[640, 240]",
        "[320, 479.6]",
    ] {
        let run = place.track(scene(pixel));
        refused(
            &run,
            &[
                "scene.toml",
                "line 15: targets.ball.start.pixel.pixel: ",
                "allowed: a pixel of the 640 x 480 image",
                "field of view",
            ],
        );
        assert!(!place.path("out").exists());
    }
    refused(
        &place.track(scene("[nan, 1]")),
        &["line 15", "is [nan, 1]; allowed: two finite numbers"],
    );
    refused(
        &place.track(scene("[460, 88]\ncamera = \"cam7\"")),
        &["line 16: targets.ball.start.pixel.camera: is \"cam7\"; allowed: cam1"],
    );
}

#[test]
fn results_of_an_earlier_run_are_replaced_whole() {
    let place = Workplace::with_frames(6);
    place.track(SCENE).fine();
    assert_eq!(place.rows().len(), 6);
    place
        .track(scene_with("fps = 25", "fps = 25\nframe_limit = 2"))
        .fine();
    assert_eq!(place.rows().len(), 2);
    // A scene that is refused leaves them as they are.
    refused(&place.track("seed = 0"), &["cameras"]);
    assert_eq!(place.rows().len(), 2);
    place.write("out/tracks.csv", "x".repeat(100_000));
    place.track(SCENE).fine();
    assert_eq!(place.rows().len(), 6);
}

#[test]
fn videos_without_ffmpeg_or_without_end() {
    let place = Workplace::with_frames(10);
    let video = scene_with("images = \"images\"\nfps = 25", "video = \"cut.mkv\"");
    let without = Run::of(place.command(&video, &["-o", "-"]).env("PATH", ""));
    refused(
        &without,
        &[
            "scene.toml",
            "line 3: cameras.cam1.video: ",
            "ffmpeg",
            "install the ffmpeg package",
        ],
    );

    let installed = Command::new("ffmpeg")
        .arg("-version")
        .output()
        .is_ok_and(|o| o.status.success());
    if !installed {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    refused(
        &place.track(&video),
        &["line 3: cameras.cam1.video: cut.mkv", "ffprobe"],
    );
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args([
            "-v",
            "error",
            "-framerate",
            "25",
            "-i",
            "images/%06d.jpg",
            "-c:v",
            "copy",
            "whole.mkv",
        ])
        .status()
        .unwrap();
    assert!(encoded.success());
    let whole = fs::read(place.path("whole.mkv")).unwrap();
    for share in [0, 10] {
        place.write("cut.mkv", &whole[..whole.len() * share / 1000]);
        refused(
            &place.track(&video),
            &["cut.mkv: ff", "check the", "It says:"],
        );
    }
    // Cut off amid its frames: those before are tracked, and ffmpeg's complaint is passed on.
    place.write("cut.mkv", &whole[..whole.len() * 7 / 10]);
    let run = place.track(&video);
    let rows = place.rows().len();
    assert!((5..10).contains(&rows), "{rows} rows, {}", run.stderr);
    assert_eq!(run.code, Some(0));
    let warning = "warning: cameras.cam1: ffmpeg reported 1 errors in cut.mkv";
    assert!(run.stderr.starts_with(warning), "{}", run.stderr);
    place.write("cut.mkv", &whole);
    let run = place.track_with(&video, &["-o", "-"]).fine();
    assert_eq!(rows_in(&run.stdout).len(), 10);
}
