//! `pardalis track` on frames of data/dioptric-jump: rows, summary, pictures, and that they depend only on scene,
//! frames and seed.

use std::fs;

use crate::common::{SCENE, Workplace, data, frame_file, rows_in, scene_with};

use pardalis_images::{GrayImage, decode, encode_png};
use serde_json::Value;

/// Returns the ball's true position in frame 0, from data/dioptric-jump/truth.csv.
fn first_truth_m() -> [f64; 3] {
    let path = data().join("truth.csv");
    let text = fs::read_to_string(path).unwrap();
    let row: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    [4, 5, 6].map(|column| row[column].parse().unwrap())
}

fn numbers<const N: usize>(row: &[String], first: usize) -> [f64; N] {
    std::array::from_fn(|i| row[first + i].parse().unwrap())
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

fn summary(place: &Workplace) -> Value {
    serde_json::from_slice(&fs::read(place.path("out/summary.json")).unwrap()).unwrap()
}

/// Returns a column of all rows.
fn column(rows: &[Vec<String>], column: usize) -> Vec<&str> {
    rows.iter().map(|row| &*row[column]).collect()
}

#[test]
fn rows_are_as_documented() {
    let place = Workplace::with_frames(12);
    let scene = scene_with("particles = 100", "particles = 1000");
    place.track(&scene).fine();
    let rows = place.rows();
    assert_eq!(rows.len(), 12);
    for (frame, row) in rows.iter().enumerate() {
        assert_eq!(row[0], frame.to_string());
        assert_eq!(row[1], (frame as f64 / 25.0).to_string());
        assert_eq!((&*row[2], &*row[3], &*row[10]), ("ball", "tracking", ""));
        let position_m: [f64; 3] = numbers(row, 4);
        let error_m = distance_m(position_m, first_truth_m());
        assert!(error_m < 0.3, "frame {frame}: {error_m} m off");
        let velocity_mps: [f64; 3] = numbers(row, 7);
        assert!(velocity_mps.iter().all(|v| v.abs() < 20.0));
        let [xx, xy, _, yy, _, zz] = numbers::<6>(row, 11);
        assert!(xx > 0.0 && yy > 0.0 && zz > 0.0 && xy * xy <= xx * yy);
        let [xx, xy, _, yy, _, zz] = numbers::<6>(row, 25);
        assert!(xx > 0.0 && yy > 0.0 && zz > 0.0 && xy * xy <= xx * yy);
        let [ess, confidence] = numbers(row, 17);
        assert!((1.0..=1000.0).contains(&ess), "{ess}");
        assert!((0.0..=1.0 + 1e-9).contains(&confidence), "{confidence}");
        // The shortest form that parses to the same value.
        for field in row[4..].iter().filter(|field| !field.is_empty()) {
            assert_eq!(field.parse::<f64>().unwrap().to_string(), *field);
        }
    }
}

#[test]
fn results_depend_only_on_scene_frames_and_seed() {
    let place = Workplace::with_frames(12);
    let scene = scene_with("particles = 100", "particles = 1500");
    let streamed = |arguments: &[&str]| {
        let arguments = [&["-o", "-"], arguments].concat();
        let run = place.track_with(&scene, &arguments).fine();
        assert_eq!(rows_in(&run.stdout).len(), 12);
        run.stdout
    };
    let first = streamed(&[]);
    place.track(&scene).fine();
    assert_eq!(
        fs::read_to_string(place.path("out/tracks.csv")).unwrap(),
        first
    );
    for threads in ["1", "2", "3", "8"] {
        assert!(
            streamed(&["--threads", threads]) == first,
            "{threads} threads"
        );
    }
    assert!(streamed(&["--seed", "1"]) == first);
    assert!(streamed(&["--seed", "2"]) != first);
    let other = place.track_with(scene.replace("seed = 1", "seed = 2"), &["-o", "-"]);
    assert!(streamed(&["--seed", "2"]) == other.stdout);
}

#[test]
fn the_summary_describes_the_run() {
    let place = Workplace::with_frames(4);
    let arguments = ["-o", "out", "--no-plots", "--seed", "9", "--threads", "2"];
    place.track_with(SCENE, &arguments).fine();
    let summary = summary(&place);
    assert_eq!(summary["program"], "pardalis");
    assert_eq!(summary["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(summary["scene"], "scene.toml");
    assert_eq!(
        (&summary["seed"], &summary["threads"]),
        (&9.into(), &2.into())
    );
    assert_eq!(summary["frame_sets"], 4);
    assert_eq!(summary["max_delay_s"], 0.0);
    assert_eq!(
        (&summary["interrupted"], &summary["error"]),
        (&false.into(), &Value::Null)
    );
    for part in [
        "decoding_beside_tracking_s",
        "waiting_for_frames_s",
        "tracking_s",
        "writing_s",
    ] {
        let time_s = summary["time"][part].as_f64().unwrap();
        assert!((0.0..60.0).contains(&time_s), "{part}: {time_s}");
    }
    let camera = &summary["cameras"]["cam1"];
    assert_eq!(camera["frames"]["used"], 4);
    assert_eq!(
        (&camera["frames"]["delivered"], &camera["stopped"]),
        (&4.into(), &Value::Null)
    );
    assert_eq!(camera["source"]["size_px"], serde_json::json!([640, 480]));
    assert_eq!(camera["position_m"], serde_json::json!([0.0, 0.0, 0.9]));
    assert_eq!(summary["targets"]["ball"]["rows"]["tracking"], 4);
    let settings = &summary["settings"];
    assert_eq!(settings["seed"], 9);
    assert_eq!(settings["cameras"]["cam1"]["fps"], 25.0);
    let ball = &settings["targets"]["ball"];
    assert_eq!(ball["filter"]["particles"], 100);
    // Not in the scene: defaults.
    assert_eq!(ball["filter"]["resampling"], "systematic");
    assert_eq!(ball["filter"]["resample_below"], 1.0);
    assert_eq!(ball["contour"]["points"], 50);
    assert_eq!(ball["shape"]["sphere"]["outline"], "tangent");
    assert_eq!(settings["cameras"]["cam1"]["time_offset_s"], 0.0);
}

#[test]
fn one_frame_is_counted_in_the_singular() {
    let run = Workplace::with_frames(1).track(SCENE).fine();
    for wanted in ["processed 1 frame (", "ball: 1 frame tracked,"] {
        assert!(run.stdout.contains(wanted), "{}", run.stdout);
    }
}

#[test]
fn times_of_images_are_read() {
    let place = Workplace::with_frames(8);
    place.track(SCENE).fine();
    let plain = fs::read(place.path("out/tracks.csv")).unwrap();
    let plain_rows = place.rows();

    place
        .track(scene_with(
            "fps = 25",
            "fps = 25\nfirst_frame = 3\nframe_limit = 4",
        ))
        .fine();
    assert_eq!(column(&place.rows(), 0), ["0", "1", "2", "3"]);
    assert_eq!(column(&place.rows(), 1), ["0.12", "0.16", "0.2", "0.24"]);

    place
        .track(scene_with("fps = 25", "fps = 25\ntime_offset_s = 100.5"))
        .fine();
    let rows = place.rows();
    assert_eq!(column(&rows[..3], 1), ["100.5", "100.54", "100.58"]);
    let [last, plain_last] = [&rows[7], &plain_rows[7]].map(|row| numbers::<3>(row, 4));
    assert!(
        distance_m(last, plain_last) < 0.05,
        "{last:?} {plain_last:?}"
    );

    let by_times = scene_with("fps = 25\n", "");
    let times = |frames: &[(usize, f64)]| {
        let rows: Vec<_> = frames.iter().map(|(n, t)| format!("{n},{t}")).collect();
        let text = format!("frame,time_s\n{}\n", rows.join("\n"));
        place.write("images/times.csv", text);
        place.track(&by_times).fine();
    };
    let even: Vec<_> = (0..8).map(|n| (n, n as f64 / 25.0)).collect();
    times(&even);
    assert!(
        fs::read(place.path("out/tracks.csv")).unwrap() == plain,
        "as with fps"
    );

    // A frame with the time stamp of the previous one is ignored: the results are as without it.
    let mut repeated = even.clone();
    repeated[4].1 = repeated[3].1;
    times(&repeated);
    let with = place.rows();
    assert_eq!(summary(&place)["frame_sets"], 7);
    assert_eq!(summary(&place)["cameras"]["cam1"]["frames"]["repeated"], 1);
    assert_eq!(column(&with, 0), ["0", "1", "2", "3", "5", "6", "7"]);
    fs::remove_file(place.path("images/times.csv")).unwrap();
    fs::remove_file(place.image(4)).unwrap();

    // A missing number leaves a gap in time.
    place.track(SCENE).fine();
    let without = place.rows();
    assert_eq!(
        column(&without, 1),
        ["0", "0.04", "0.08", "0.12", "0.2", "0.24", "0.28"]
    );
    let after_time =
        |rows: &[Vec<String>]| rows.iter().map(|r| r[1..].to_vec()).collect::<Vec<_>>();
    assert_eq!(after_time(&with), after_time(&without));
    assert_eq!(without[..4], plain_rows[..4]);
    assert_ne!(without[4][4..], plain_rows[5][4..]);
}

#[test]
fn pictures_and_quiet_mode() {
    let place = Workplace::with_frames(3);
    let run = place.track_with(SCENE, &["--annotate"]).fine();
    let files = [
        "tracks.csv",
        "summary.json",
        "above.svg",
        "above.png",
        "side.svg",
        "side.png",
        "3d.svg",
        "3d.png",
        "coordinates.svg",
        "coordinates.png",
        "annotated",
    ];
    for file in files {
        let file = format!("scene-tracks/{file}");
        assert!(place.path(&file).exists(), "{file}");
        assert!(run.stdout.contains(&file), "{file}: {}", run.stdout);
    }
    assert!(
        run.stdout.contains("processed 3 frames") && run.stdout.contains("ball: 3 frames tracked")
    );
    assert!(
        !run.stdout.contains(['\r', '\u{1b}']),
        "no progress bar in a pipe"
    );
    for frame in 0..3 {
        let name = format!("scene-tracks/annotated/{frame:06}.jpg");
        let drawn = decode(&fs::read(place.path(&name)).unwrap()).unwrap();
        let raw = decode(&fs::read(place.image(frame)).unwrap()).unwrap();
        assert_eq!(drawn.width(), 640);
        // Near the ball, at (460, 88).
        let differing = (430..490)
            .flat_map(|x| (58..118).map(move |y| (x, y)))
            .filter(|&(x, y)| {
                let [a, b] = [&drawn, &raw].map(|image| image.get_pixel(x, y));
                a.iter().zip(b).any(|(a, b)| a.abs_diff(b) > 60)
            })
            .count();
        assert!(differing > 50, "{differing}");
    }
    let run = place.track_with(SCENE, &["-o", "out"]).fine();
    assert!(!run.stdout.contains("annotated") && !place.path("out/annotated").exists());
}

#[test]
fn masked_pixels_are_ignored() {
    let place = Workplace::with_frames(2);
    // Black on the ball.
    let mask = GrayImage::from_fn(640, 480, |x, y| {
        let black = x.abs_diff(460) < 60 && y.abs_diff(88) < 60;
        [if black { 0 } else { 255 }]
    });
    fs::write(place.path("mask.png"), encode_png(&mask).unwrap()).unwrap();
    // The same with a circle that ends before the ball.
    for mask in ["mask = \"mask.png\"", "mask_radius_px = 140"] {
        let run = place.track(scene_with("fps = 25", &format!("fps = 25\n{mask}")));
        let warned = "warning: targets.ball: was not found in any of the 2 frames\n";
        assert!(run.stderr.starts_with(warned), "{}", run.stderr);
        assert_eq!(run.code, Some(0));
        assert_eq!(column(&place.rows(), 3), ["occluded"; 2]);
    }
    place
        .track(scene_with("fps = 25", "fps = 25\nmask_radius_px = 260"))
        .fine();
    assert_eq!(column(&place.rows(), 3), ["tracking"; 2]);
}

/// Two runs had mixed their results.
#[test]
fn a_folder_takes_the_results_of_one_run_at_a_time() {
    let place = Workplace::with_frames(2);
    fs::create_dir(place.path("out")).unwrap();
    let other = fs::File::open(place.path("out")).unwrap();
    other.lock().unwrap();
    let run = place.track(SCENE);
    run.refused(&["out: another run is writing its results there; give another folder"]);
    assert_eq!(fs::read_dir(place.path("out")).unwrap().count(), 0);
    drop(other);
    place.track(SCENE).fine();
}

#[test]
fn a_click_locates_the_ball() {
    let place = Workplace::with_frames(1);
    let (before, _) = SCENE.split_once("[targets.ball.start").unwrap();
    let scene = format!("{before}[targets.ball.start.pixel]\npixel_px = [460, 88]\n")
        .replace("particles = 100", "particles = 2000");
    let errors_m: Vec<f64> = (1..=10)
        .map(|seed| {
            let run = place
                .track_with(&scene, &["-o", "-", "--seed", &seed.to_string()])
                .fine();
            let rows = rows_in(&run.stdout);
            assert_eq!(rows[0][3], "tracking");
            distance_m(numbers(&rows[0], 4), first_truth_m())
        })
        .collect();
    let worst_m = errors_m.iter().copied().fold(0.0, f64::max);
    println!("worst of ten: {worst_m:.3} m");
    assert!(worst_m < 0.5, "{errors_m:?}");
}

#[test]
fn two_cameras() {
    let place = Workplace::with_frames(3);
    fs::create_dir(place.path("images2")).unwrap();
    for number in 0..3 {
        let to = place.path(&format!("images2/{number:06}.jpg"));
        fs::copy(frame_file(number), to).unwrap();
    }
    // The other camera is slightly to the side.
    let (_, camera) = SCENE.split_once("[cameras.cam1]").unwrap();
    let (camera, _) = camera.split_once("[targets.ball]").unwrap();
    let second = camera
        .replace("\"images\"", "\"images2\"")
        .replace("[0, -1, 0, 0]", "[0, -1, 0, 0.05]");
    let scene = format!("{SCENE}[cameras.cam2]{second}");
    place
        .track_with(&scene, &["-o", "out", "--annotate"])
        .fine();
    let both = place.rows();
    assert_eq!(column(&both, 1), ["0", "0.04", "0.08"]);
    let summary = summary(&place);
    for camera in ["cam1", "cam2"] {
        assert_eq!(summary["cameras"][camera]["frames"]["used"], 3);
        assert!(
            place
                .path(&format!("out/annotated/{camera}/000002.jpg"))
                .exists()
        );
    }
    assert_eq!(summary["cameras"]["cam2"]["position_m"][0], 0.05);
    place.track(SCENE).fine();
    assert_ne!(
        place.rows()[0][4..],
        both[0][4..],
        "the second camera changes the estimate"
    );

    // Cameras that are not synchronised: each time has its own row.
    let apart = scene.replace("[cameras.cam2]", "[cameras.cam2]\ntime_offset_s = 0.01");
    place.track(&apart).fine();
    assert_eq!(
        column(&place.rows(), 1),
        ["0", "0.01", "0.04", "0.05", "0.08", "0.09"]
    );

    // With two cameras, a click must name one.
    let (before, _) = scene.split_once("[targets.ball.start").unwrap();
    let click =
        format!("{before}[targets.ball.start.pixel]\npixel_px = [460, 88]\n[cameras.cam2]{second}");
    let run = place.track(&click);
    run.refused(&["targets.ball.start.pixel.camera: is missing"]);
    place
        .track(click.replace("88]", "88]\ncamera = \"cam1\""))
        .fine();
    assert_eq!(place.rows().len(), 3);
}

#[test]
fn rows_of_an_earlier_run_are_kept() {
    let place = Workplace::with_frames(4);
    let track = |frames: &str| {
        let arguments = [
            "-o",
            "out",
            "--no-plots",
            "--particles",
            "p.csv",
            "--frames",
            frames,
        ];
        place.track_with(SCENE, &arguments)
    };
    let read = |name: &str| fs::read(place.path(name)).unwrap();
    track("2").fine();
    let first = ["out/tracks.csv", "out/summary.json", "p.csv"].map(read);
    assert_eq!(
        track("3").fine().kept,
        [
            "out/tracks.csv of an earlier run is kept as out/tracks.previous.csv",
            "p.csv of an earlier run is kept as p.previous.csv"
        ]
    );
    assert_eq!(place.rows().len(), 3);
    let previous = [
        "out/tracks.previous.csv",
        "out/summary.previous.json",
        "p.previous.csv",
    ];
    assert_eq!(previous.map(read), first);
    // A scene that cannot be tracked touches nothing.
    let rows = read("out/tracks.csv");
    place
        .track(SCENE.replace("fps = 25", "fps = 0"))
        .refused(&["fps"]);
    assert_eq!(
        (read("out/tracks.csv"), previous.map(read)),
        (rows.clone(), first)
    );
    // The third run replaces the first one.
    assert_eq!(track("1").code, Some(0));
    assert_eq!(read("out/tracks.previous.csv"), rows);
}

#[test]
fn particles_replace_no_file_of_anything_else() {
    let place = Workplace::with_frames(2);
    let track = |particles: &str| {
        let arguments = ["-o", "out", "--explain", "--particles", particles];
        place.track_with(SCENE, &arguments)
    };
    place.write("mine.csv", "mine\n");
    for input in ["mine.csv", "scene.toml", "images/000000.jpg"] {
        let before = (input != "scene.toml").then(|| fs::read(place.path(input)).unwrap());
        track(input).refused(&[
            &format!("--particles {input}: exists and holds no particles"),
            "choose another name",
        ]);
        assert!(before.is_none_or(|before| fs::read(place.path(input)).unwrap() == before));
    }
    assert!(!place.path("out").exists());
    // Results that are not there yet.
    for result in ["tracks.csv", "candidates.csv", "summary.json"] {
        track(&format!("out/{result}")).refused(&[
            &format!("--particles out/{result}: is the name of another result"),
            "particles.csv",
        ]);
    }
    // Its own file, an empty one and names like those of results elsewhere are fine.
    place.write("empty.csv", "");
    for name in ["empty.csv", "out/cloud.csv", "out/cloud.csv", "tracks.csv"] {
        track(name).fine();
    }
}

#[test]
fn nothing_of_an_earlier_run_stays_beside_other_rows() {
    let place = Workplace::with_frames(4);
    let (detected, _) = SCENE.split_once("contour = ").unwrap();
    let crossing = format!("{detected}crossing.point_m = [0, 0, 0.3]\n");
    let everything = [
        "-o",
        "out",
        "--annotate",
        "--explain",
        "--smooth",
        "--particles",
        "out/cloud.txt",
    ];
    place.track_with(&crossing, &everything).fine();
    let cloud = fs::read(place.path("out/cloud.txt")).unwrap();
    let files = || {
        let entries = fs::read_dir(place.path("out")).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    };
    for name in [
        "annotated",
        "candidates.csv",
        "cloud.txt",
        "crossings.csv",
        "events.csv",
        "filtered.csv",
    ] {
        assert!(files().iter().any(|file| file == name), "{name}");
    }
    assert_eq!(
        place.track(detected).fine().kept,
        [
            "out/tracks.csv of an earlier run is kept as out/tracks.previous.csv",
            "out/cloud.txt of an earlier run is kept as out/cloud.previous.txt"
        ]
    );
    let (rows, kept) = (
        ["summary.json", "tracks.csv"],
        ["summary.previous.json", "tracks.previous.csv"],
    );
    let mut wanted = [&rows[..], &kept, &["cloud.previous.txt"]].concat();
    wanted.sort_unstable();
    assert_eq!(files(), wanted);
    assert_eq!(
        fs::read(place.path("out/cloud.previous.txt")).unwrap(),
        cloud
    );
    // The rows that are kept now had no particles.
    place.track(detected).fine();
    let mut wanted = [&rows[..], &kept].concat();
    wanted.sort_unstable();
    assert_eq!(files(), wanted);
}
