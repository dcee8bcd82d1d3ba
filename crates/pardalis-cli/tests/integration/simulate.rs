//! `pardalis simulate`: its output, which the other commands accept, and its errors.

use std::fs;
use std::path::Path;

use crate::common::Run;

/// Two cameras with all kinds of faults, a moving ball and an occluder. The tests refer to line numbers of this text.
const WORLD: &str = r"seed = 3
duration_s = 0.8
training_stills = 2
start_sigma_m = 0.02
[cameras.left]
size_px = [96, 72]
model.pinhole = { f_px = [100, 100], center_px = [47.5, 35.5] }
look_from_m = [-1, 0, 0.3]
look_at_m = [0, 0, 0.2]
[cameras.right]
size_px = [80, 60]
model.equidistant = { f_px_per_rad = 60, center_px = [39.5, 29.5] }
look_from_m = [0, -1, 0.3]
look_at_m = [0, 0, 0.2]
[cameras.right.timing]
drops_s = [[0.2, 0.4]]
freezes_s = [[0.5, 0.6]]
delay_s = 0.03
clock_offset_s = 0.25
broken_frames = [2]
[image]
samples = 2
read_noise = 2
[ground]
texture.checker = { size_m = 0.2, colors_srgb = [[90, 90, 80], [140, 140, 130]] }
[objects.ball]
target = true
shape.sphere.radius_m = 0.1
color_srgb = [230, 60, 30]
path.circle = { center_m = [0, 0, 0.25], radius_m = 0.15, period_s = 2 }
";

/// A folder with a world file.
struct Place(tempfile::TempDir);

impl Place {
    fn with(world: &str) -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        fs::write(place.path("world.toml"), world).unwrap();
        place
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn run(&self, arguments: &[&str]) -> Run {
        Run::pardalis(&self.0, arguments)
    }
}

/// Returns all files below a folder with their bytes.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            let bytes = fs::read(&path).unwrap();
            found.push((path.display().to_string(), bytes));
        }
    }
    found.sort();
    found
}

/// Returns some columns of a table as numbers.
fn columns<const N: usize>(text: &str, names: [&str; N], only: &str) -> Vec<[f64; N]> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let places = names.map(|name| header.iter().position(|column| *column == name).unwrap());
    lines
        .filter(|line| line.contains(only))
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            places.map(|place| cells[place].parse().unwrap())
        })
        .collect()
}

#[test]
fn the_bundled_world_is_tracked_within_a_millimetre() {
    let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/worlds/ring.toml");
    let world = fs::read_to_string(bundled).unwrap();
    let place = Place::with(&world.replace("duration_s = 4.0", "duration_s = 0.8"));
    let run = place.run(&["simulate", "world.toml", "-o", "ring"]).fine();
    assert!(run.stdout.contains("cam4: 20 images"), "{}", run.stdout);
    // The tracker as shipped, which needs no start.
    assert!(!place.read("ring/scene.toml").contains("start"));
    place
        .run(&["track", "ring/scene.toml", "-o", "tracks", "--no-plots"])
        .fine();
    let run = place
        .run(&["evaluate", "tracks", "ring", "--json", "-"])
        .fine();
    let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    let all = &report["targets"][0]["all"];
    assert_eq!(all["frames"], 20, "{report:#}");
    let rmse_m = all["errors"]["position_m"]["rmse"].as_f64().unwrap();
    assert!(rmse_m < 0.001, "{rmse_m}");
    // Other commands accept the other files of the sequence.
    place
        .run(&[
            "learn",
            "ring/training",
            "--masks",
            "_ball_mask.png",
            "-o",
            "again.toml",
            "--no-pictures",
        ])
        .fine();
    assert_eq!(
        place.read("again.toml"),
        place.read("ring/ball.colors.toml")
    );
    place
        .run(&["camera", "show", "ring/cameras.json", "-o", "pictures"])
        .fine();
}

#[test]
fn images_and_times_have_the_configured_faults() {
    let place = Place::with(WORLD);
    place.run(&["simulate", "world.toml", "-o", "out"]).fine();
    // 0 to 0.76 s without 0.2 to 0.36 s.
    let times = columns(
        &place.read("out/frames/right/times.csv"),
        ["frame", "time_s", "arrival_s"],
        "",
    );
    assert_eq!(times.len(), 15);
    let truth = place.read("out/truth.csv");
    let true_times = columns(&truth, ["frame", "time_s"], "right");
    for ([frame, stamp_s, arrival_s], [same_frame, time_s]) in times.iter().zip(true_times) {
        assert_eq!(*frame, same_frame);
        assert!(!(0.2..0.4).contains(&time_s));
        assert!((stamp_s - time_s - 0.25).abs() < 1e-9);
        assert!((arrival_s - time_s - 0.03).abs() < 1e-9);
    }
    let left = place.read("out/frames/left/times.csv");
    assert!(left.starts_with("frame,time_s\n0,0\n1,0.04\n"), "{left}");
    let image = |name: &str| fs::read(place.path(&format!("out/frames/right/{name}.png"))).unwrap();
    // 0.48 s, then frozen at 0.52 and 0.56 s, then 0.6 s.
    assert_eq!(image("000007"), image("000008"));
    assert_eq!(image("000007"), image("000009"));
    assert_ne!(image("000007"), image("000010"));
    assert!(image("000002").len() < image("000001").len() * 6 / 10);
    // The truth is that of the path.
    for [time_s, x_m, y_m, vx_mps] in
        columns(&truth, ["time_s", "x_m", "y_m", "vx_mps"], "ball,left")
    {
        let (sin, cos) = (std::f64::consts::PI * time_s).sin_cos();
        assert!((x_m - 0.15 * cos).abs() < 1e-12 && (y_m - 0.15 * sin).abs() < 1e-12);
        assert!((vx_mps + 0.15 * std::f64::consts::PI * sin).abs() < 1e-12);
    }
    assert!(
        place
            .read("out/scene.toml")
            .contains("# time_offset_s = -0.250000")
    );
}

/// The mean distance of the positions in tracks.csv from those in truth.csv after 0.3 s, in metres.
fn mean_error_m(tracks: &str, truth: &str) -> f64 {
    let names = ["time_s", "x_m", "y_m", "z_m"];
    let truth = columns(truth, names, "ball,left");
    let tracks = columns(tracks, names, ",tracking,");
    let distance_m = |[time_s, x, y, z]: [f64; 4]| {
        let there = truth.iter().find(|row| (row[0] - time_s).abs() < 1e-6);
        let [_, tx, ty, tz] = there.unwrap();
        (x - tx).hypot(y - ty).hypot(z - tz)
    };
    let late = tracks.into_iter().filter(|row| row[0] > 0.3);
    let errors_m: Vec<f64> = late.map(distance_m).collect();
    assert!(errors_m.len() > 10, "{}", errors_m.len());
    errors_m.iter().sum::<f64>() / errors_m.len() as f64
}

#[test]
fn scenes_of_rolling_shutters_say_so_and_are_tracked_accordingly() {
    let (before, timing) = WORLD.split_once("[cameras.right.timing]").unwrap();
    let (_, after) = timing.split_once("[image]").unwrap();
    let world = format!("{before}[image]{after}")
        .replace("size_px = [96, 72]", "size_px = [320, 240]")
        .replace("f_px = [100, 100]", "f_px = [333, 333]")
        .replace("center_px = [47.5, 35.5]", "center_px = [159.5, 119.5]")
        .replace("read_noise = 2", "read_noise = 2\nline_delay_s = 4e-4")
        .replace(
            "path.circle = { center_m = [0, 0, 0.25], radius_m = 0.15, period_s = 2 }",
            "path.line = { position_m = [0, -0.25, 0.05], velocity_mps = [0, 0.6, 0.5] }",
        );
    let place = Place::with(&world);
    place.run(&["simulate", "world.toml", "-o", "out"]).fine();
    let scene = place.read("out/scene.toml");
    assert_eq!(
        scene.matches("line_delay_s = 0.0004\n").count(),
        2,
        "{scene}"
    );
    let initialized = place.run(&["check", "out/scene.toml"]);
    let warning = "line_delay_s has no effect on targets.ball, which has a start";
    assert!(
        initialized.stderr.contains(warning),
        "{}",
        initialized.stderr
    );
    // Without its start, the target is detected.
    let (aware, _) = scene.split_once("[targets.ball.start").unwrap();
    let unaware = aware.replace("line_delay_s = 0.0004\n", "");
    fs::write(place.path("out/aware.toml"), aware).unwrap();
    fs::write(place.path("out/unaware.toml"), unaware).unwrap();
    let [aware_m, unaware_m] = ["aware", "unaware"].map(|name| {
        let path = format!("out/{name}.toml");
        place
            .run(&["track", &path, "-o", name, "--no-plots"])
            .fine();
        let tracks = place.read(&format!("{name}/tracks.csv"));
        mean_error_m(&tracks, &place.read("out/truth.csv"))
    });
    assert!(aware_m < 0.5 * unaware_m, "{aware_m} {unaware_m}");
}

#[test]
fn bytes_depend_on_the_seed_but_not_on_the_number_of_threads() {
    let place = Place::with(WORLD);
    place
        .run(&["simulate", "world.toml", "-o", "out", "--threads", "1"])
        .fine();
    let one = files(&place.path("out"));
    let replace = [
        "simulate",
        "world.toml",
        "-o",
        "out",
        "--force",
        "--threads",
    ];
    place.run(&[&replace[..], &["2"]].concat()).fine();
    assert!(one == files(&place.path("out")));
    place
        .run(&[&replace[..], &["2", "--seed", "4"]].concat())
        .fine();
    assert!(one != files(&place.path("out")));
}

#[test]
fn folders_with_other_contents_are_not_replaced() {
    let place = Place::with(WORLD);
    fs::create_dir(place.path("mine")).unwrap();
    fs::write(place.path("mine/diary.txt"), "dear diary").unwrap();
    let run = place.run(&["simulate", "world.toml", "-o", "mine"]);
    run.refused(&["mine: is not empty", "--force"]);
    let run = place.run(&["simulate", "world.toml", "-o", "mine", "--force"]);
    run.refused(&["mine: holds no simulated.txt"]);
    assert_eq!(place.read("mine/diary.txt"), "dear diary");
    fs::write(place.path("mine/simulated.txt"), "").unwrap();
    let run = place.run(&["simulate", "world.toml", "-o", "mine", "--force"]);
    run.refused(&[
        "mine: holds diary.txt",
        "does not belong to a simulated sequence",
    ]);
    assert_eq!(place.read("mine/diary.txt"), "dear diary");
    // A failure leaves nothing behind: no camera ever sees this ball.
    let hidden = WORLD.replace("center_m = [0, 0, 0.25]", "center_m = [0, 0, -5]");
    fs::write(place.path("hidden.toml"), hidden).unwrap();
    let run = place.run(&["simulate", "hidden.toml"]);
    run.refused(&["hidden.toml: objects.ball", "colours cannot be learnt"]);
    assert_eq!(fs::read_dir(place.0.path()).unwrap().count(), 3);
}

#[test]
fn invalid_worlds_are_rejected_with_every_key_and_line() {
    let bad = [
        (
            "duration_s = 0.8",
            "duration_s = 99999",
            "line 2: duration_s: gives more than 100000 images of camera left",
        ),
        (
            "duration_s = 0.8",
            "duration_s = -1",
            "line 2: duration_s: is -1; allowed: above 0",
        ),
        (
            "size_px = [96, 72]",
            "size_px = [96, 72000]",
            "line 6: cameras.left.size_px",
        ),
        (
            "look_at_m = [0, 0, 0.2]\n[cameras.right]",
            "[cameras.right]",
            "line 5: cameras.left.look_at_m: is missing",
        ),
        (
            "look_from_m = [0, -1, 0.3]",
            "look_from_m = [0, 0, 0.2]",
            "cameras.right.look_at_m",
        ),
        (
            "[[0.2, 0.4]]",
            "[[0.4, 0.2]]",
            "line 16: cameras.right.timing.drops_s",
        ),
        (
            "delay_s = 0.03",
            "fps = 1e9",
            "line 18: cameras.right.timing.fps",
        ),
        (
            "samples = 2",
            "samples = 200",
            "line 22: image.samples: is 200; allowed: 1 to 16",
        ),
        (
            "read_noise = 2",
            "red_noise = 2",
            "line 23: image.red_noise: is not a key; did you mean read_noise?",
        ),
        (
            "[140, 140, 130]]",
            "[140, 140, 1300]]",
            "line 25: ground.texture.checker.colors_srgb",
        ),
        (
            "target = true",
            "target = false",
            "objects: contain no target",
        ),
        (
            "color_srgb = [230, 60, 30]",
            "",
            "line 26: objects.ball.color_srgb: is missing",
        ),
        (
            "radius_m = 0.15, ",
            "",
            "line 30: objects.ball.path.circle.radius_m: is missing",
        ),
        (
            "period_s = 2 }",
            "period_s = 0 }",
            "line 30: objects.ball.path.circle.period_s",
        ),
        (
            "path.circle = { center_m = [0, 0, 0.25], radius_m = 0.15, period_s = 2 }",
            "path.attached = { to = \"robot\", offset_m = [0, 0, 0] }",
            "line 30: objects.ball.path.attached.to: is the text \"robot\"",
        ),
        ("path.circle", "path.spiral", "objects.ball.path"),
    ];
    for (piece, other, wanted) in bad {
        assert_rejected(piece, other, wanted);
    }
    let place = Place::with(&WORLD.replace("clock_offset_s", "phase_s = 9\n#"));
    let run = place.run(&["simulate", "world.toml", "-o", "out"]);
    run.refused(&["world.toml: camera right delivers no image"]);
}

#[test]
fn invalid_details_of_balls_and_shutters_are_rejected_with_key_and_line() {
    let bad = [
        (
            "samples = 2",
            "line_delay_s = 2",
            "line 22: image.line_delay_s: is 2; allowed: -0.001 to 0.001",
        ),
        (
            "color_srgb = [230, 60, 30]",
            "color_srgb = [230, 60, 30]\ntexture.plain.color_srgb = [9, 9, 9]",
            "line 29: objects.ball.color_srgb: cannot be combined with texture",
        ),
        (
            "color_srgb = [230, 60, 30]",
            "color_srgb = [230, 60, 30]\nseams = { color_srgb = [9, 9, 9], width_m = 0.01, count = 4 }",
            "line 30: objects.ball.seams.count: is 4; allowed: 1 to 3",
        ),
        (
            "color_srgb = [230, 60, 30]",
            "color_srgb = [230, 60, 30]\nlogo = { color_srgb = [9, 9, 9], radius_m = 0.01, direction = [0, 0, 0] }",
            "line 30: objects.ball.logo.direction: is [0, 0, 0]; allowed: a direction",
        ),
        (
            "shape.sphere.radius_m = 0.1",
            "shape.cylinder = { radius_m = 0.1, height_m = 0.1 }\ntilt_deg = 10",
            "line 29: objects.ball.tilt_deg: tilts a target that is no ball",
        ),
        (
            "shape.sphere.radius_m = 0.1",
            "shape.cylinder = { radius_m = 0.1, height_m = 0.1 }\nlogo = { color_srgb = [9, 9, 9], radius_m = 0.01 }",
            "line 29: objects.ball.logo: is given for another shape; allowed: on spheres",
        ),
        (
            "shape.sphere.radius_m = 0.1",
            "shape.cone = { radius_m = 0.1, height_m = 0.1 }",
            "line 27: objects.ball.target: is true of another shape",
        ),
        (
            "shape.sphere.radius_m = 0.1",
            "shape.capsule = { radius_m = 0.1, to_m = [0, 0, 0] }",
            "line 28: objects.ball.shape.capsule.to_m: is [0, 0, 0]; allowed: a point other than",
        ),
    ];
    for (piece, other, wanted) in bad {
        assert_rejected(piece, other, wanted);
    }
}

/// Asserts that [`WORLD`] with a piece replaced is rejected with this message, and leaves no output.
#[track_caller]
fn assert_rejected(piece: &str, other: &str, wanted: &str) {
    assert!(WORLD.contains(piece), "{piece}");
    let place = Place::with(&WORLD.replacen(piece, other, 1));
    let run = place.run(&["simulate", "world.toml", "-o", "out"]);
    run.refused(&["world.toml: ", "in the world", wanted]);
    assert!(!place.path("out").exists());
}

/// The chroma of JPEG files, which has half the resolution, is aligned with the body.
#[test]
fn chroma_is_aligned_with_the_body() {
    let world = "seed = 1\nduration_s = 0.4\n[cameras.cam]\nsize_px = [96, 72]\n\
         model.pinhole = { f_px = [100, 100], center_px = [47.5, 35.5] }\n\
         look_from_m = [-1, 0, 0.3]\nlook_at_m = [0, 0, 0.3]\n\
         [image]\njpeg_quality = 95\n[light]\nambient = 1\n\
         [objects.ball]\ntarget = true\nshape.sphere.radius_m = 0.1\ncolor_srgb = [200, 60, 60]\n\
         path.circle = { center_m = [0, 0, 0.3], radius_m = 0.1, period_s = 1 }\n";
    let place = Place::with(world);
    place.run(&["simulate", "world.toml", "-o", "out"]).fine();
    let truth = columns(&place.read("out/truth.csv"), ["u_px", "v_px"], "");
    let mut off_px = [0.0; 2];
    for (index, seen) in truth.iter().enumerate() {
        let file = format!("out/frames/{index:06}.jpg");
        let picture = pardalis_images::decode(&fs::read(place.path(&file)).unwrap()).unwrap();
        let (mut sums, mut total) = ([0.0; 2], 0.0);
        for (x, y, pixel) in picture.enumerate_pixels() {
            // Pixels whose red exceeds green in the background do not count.
            let red = f64::from(pixel[0]) - f64::from(pixel[1]) - 30.0;
            if red > 0.0 {
                sums[0] += red * f64::from(x);
                sums[1] += red * f64::from(y);
                total += red;
            }
        }
        for axis in 0..2 {
            off_px[axis] += (sums[axis] / total - seen[axis]) / truth.len() as f64;
        }
    }
    assert!(
        truth.len() >= 5 && off_px.iter().all(|off| off.abs() < 0.1),
        "{off_px:?}"
    );
}
