//! `pardalis rectify`: maps are tracked like the images they are made from, with any camera; and errors.

use std::fs;
use std::path::Path;

use crate::common::{
    FRONT_LANDMARK, PLANE_ROBOT, REAR_LANDMARK, Run, SCENE, Workplace, rows_in, scene_with,
};

use pardalis_images::decode_grey;

/// The robot on data/plane-robot, with the rear landmark first and a comment.
fn robot() -> String {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    [PLANE_ROBOT, REAR_LANDMARK, FRONT_LANDMARK]
        .concat()
        .replace("frame_limit = 20", "frame_limit = 60")
        .replace("-0.2679295],", "-0.2679295], # nearest")
        .replace("DATA", data.to_str().unwrap())
}

/// Runs `pardalis` in the folder of a workplace.
fn pardalis(place: &Workplace, arguments: &[&str]) -> Run {
    Run::pardalis(place.path(""), arguments)
}

fn read(place: &Workplace, name: &str) -> String {
    fs::read_to_string(place.path(name)).unwrap()
}

/// Returns the size and the grey values of a picture.
fn grey(place: &Workplace, name: &str) -> ((u32, u32), Vec<u8>) {
    let picture = decode_grey(&fs::read(place.path(name)).unwrap()).unwrap();
    (picture.dimensions(), picture.into_raw())
}

/// Returns x and y of each row of a track, in metres.
fn track(place: &Workplace, folder: &str) -> Vec<[f64; 2]> {
    let rows = rows_in(&read(place, &format!("{folder}/tracks.csv")));
    let number = |row: &Vec<String>, column: usize| row[column].parse().unwrap();
    rows.iter()
        .map(|row| [number(row, 4), number(row, 5)])
        .collect()
}

/// Returns the true positions of the robot in the first frames of data/plane-robot.
fn truth(count: usize) -> Vec<[f64; 2]> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    let text = fs::read_to_string(data.join("plane-robot/truth.csv")).unwrap();
    let rows = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let robots = rows.filter(|row| row[2] == "robot");
    robots
        .map(|row| [row[4].parse().unwrap(), row[5].parse().unwrap()])
        .take(count)
        .collect()
}

/// Returns the mean distance between two tracks, in metres.
#[track_caller]
fn mean_distance_m(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let distance = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
    a.iter().zip(b).map(distance).sum::<f64>() / a.len() as f64
}

/// Two seeds on the same images differ by some 4 mm; a pixel of the map is 10 mm.
#[test]
fn tracking_on_maps_matches_tracking_on_images() {
    let place = Workplace::with_frames(0);
    place
        .track_with(robot(), &["-o", "direct", "--no-plots"])
        .fine();
    let area = ["--area", "-2,-1.2,2.2,2.4", "--step", "0.01", "-o", "map"];
    let run = pardalis(&place, &[&["rectify", "scene.toml"], &area[..]].concat()).fine();
    assert!(
        run.stdout.contains("60 images of 420 x 360 pixels"),
        "{}",
        run.stdout
    );
    pardalis(
        &place,
        &["track", "map/scene.toml", "-o", "on-maps", "--no-plots"],
    )
    .fine();
    let (direct, on_maps) = (track(&place, "direct"), track(&place, "on-maps"));
    assert_eq!(direct.len(), 60);
    assert!(
        mean_distance_m(&direct, &on_maps) < 0.008,
        "{}",
        mean_distance_m(&direct, &on_maps)
    );
    for track in [&direct, &on_maps] {
        let error_m = mean_distance_m(track, &truth(60));
        assert!(error_m < 0.02, "{error_m}");
    }
    // Landmarks keep their order, on which random numbers depend.
    let scene = read(&place, "map/scene.toml");
    let at = |name: &str| scene.find(&format!("landmarks.{name}]")).unwrap();
    assert!(at("rear") < at("front"), "{scene}");
}

/// The orange ball, seen by a fisheye camera that looks straight down.
#[test]
fn fisheye_maps_have_a_mask_times_and_the_converted_click() {
    let place = Workplace::with_frames(3);
    let scene = scene_with("fps = 25\n", "time_offset_s = 2\nmask_radius_px = 150\n");
    let scene = scene.replace(
        "[targets.ball.start.gaussian]\nposition_m = [1.35, -1.25, 0.62]\nposition_sigma_m = 0.1\n",
        "[targets.ball.start.pixel]\npixel_px = [419.5, 239.5]\n",
    );
    place.write(
        "images/times.csv",
        "frame,time_s,arrival_s\n0,0.5,0.6\n1,0.625,0.7\n2,0.75,0.9\n",
    );
    place.write("scene.toml", &scene);
    let area = ["--area", "-3,-2,3,2.02", "--step", "0.02"];
    let run = pardalis(&place, &[&["rectify", "scene.toml"], &area[..]].concat()).fine();
    assert!(
        run.stdout.contains("3 images of 300 x 201 pixels"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout.contains("seen from (0.000, 0.000, 0.900) m"),
        "{}",
        run.stdout
    );
    let times = read(&place, "scene-rectified/frames/times.csv");
    assert_eq!(
        times,
        "frame,time_s,arrival_s\n0,2.5,0.6\n1,2.625,0.7\n2,2.75,0.9\n"
    );
    let (size, mask) = grey(&place, "scene-rectified/mask.png");
    assert_eq!(size, (300, 201));
    let (size, map) = grey(&place, "scene-rectified/frames/000002.png");
    assert_eq!(size, (300, 201));
    // The mask ends 59 degrees from the axis, 1.5 m from the point below the camera.
    let at = |x_m: f64, y_m: f64| {
        let (x, y) = ((x_m + 3.0) / 0.02, (2.02 - y_m) / 0.02);
        let pixel = y as usize * 300 + x as usize;
        (mask[pixel], map[pixel] > 0)
    };
    for (x_m, y_m) in [(1.4, 0.0), (-1.4, 0.0), (1.0, 1.0), (0.0, -1.4)] {
        assert_eq!(at(x_m, y_m), (255, true), "{x_m} {y_m}");
        assert_eq!(at(1.2 * x_m, 1.2 * y_m), (0, false), "{x_m} {y_m}");
    }
    // 100 px are 0.687 rad from the axis, towards the world's -y, because the image's x is -y.
    let scene = read(&place, "scene-rectified/scene.toml");
    let ground_m = 0.9 * (100.0_f64 / 145.562_250_654_857_8).tan();
    let (u, v) = (3.0 / 0.02 - 0.5, (2.02 + ground_m) / 0.02 - 0.5);
    assert!(
        scene.contains(&format!("pixel_px = [{u:.2}, {v:.2}]")),
        "{scene}"
    );
    assert!(
        !scene.contains("time_offset_s") && !scene.contains("equidistant"),
        "{scene}"
    );
    pardalis(
        &place,
        &[
            "track",
            "scene-rectified/scene.toml",
            "-o",
            "out",
            "--no-plots",
        ],
    )
    .fine();
    assert_eq!(place.rows().len(), 3);
}

#[test]
fn invisible_parts_are_black_and_masked() {
    let place = Workplace::with_frames(1);
    place.write(
        "scene.toml",
        scene_with("fps = 25\n", "fps = 25\nmask_radius_px = 100\n"),
    );
    pardalis(&place, &["rectify", "scene.toml", "-o", "map"]).fine();
    let (size, map) = grey(&place, "map/frames/000000.png");
    let (mask_size, mask) = grey(&place, "map/mask.png");
    assert_eq!(size, mask_size);
    assert!(mask.contains(&0) && mask.contains(&255));
    for (grey, mask) in map.iter().zip(&mask) {
        assert!(*mask == 255 || *grey == 0);
    }
    // The whole circle is in view: the corners of the map are black, the middle of each side shows the floor.
    let (width, height) = (size.0 as usize, size.1 as usize);
    let at = |x: usize, y: usize| mask[y * width + x];
    for (x, y) in [
        (0, 0),
        (width - 1, 0),
        (0, height - 1),
        (width - 1, height - 1),
    ] {
        assert_eq!(at(x, y), 0);
    }
    for (x, y) in [
        (width / 2, 3),
        (width / 2, height - 4),
        (3, height / 2),
        (width - 4, height / 2),
    ] {
        assert_eq!(at(x, y), 255, "{x} {y} of {width} {height}");
    }
}

#[test]
fn one_of_several_cameras_and_single_images_are_rectified() {
    let place = Workplace::with_frames(2);
    place.write("images/times.csv", "frame,time_s\n0,0\n1,0.04\n");
    let pose = SCENE
        .lines()
        .find(|line| line.starts_with("world_from_camera"))
        .unwrap();
    let model = SCENE
        .lines()
        .find(|line| line.starts_with("model"))
        .unwrap();
    let two = scene_with("fps = 25\n", "").replace(
        "[targets.ball]",
        &format!(
            "[cameras.b]\nimages = \"images\"\n{model}\n{}\n[targets.ball]",
            pose.replace("0.9]", "1.1]")
        ),
    );
    place.write("two.toml", &two);
    pardalis(&place, &["rectify", "two.toml"]).refused(&["--camera is needed", "cam1, b"]);
    let run = pardalis(&place, &["rectify", "two.toml", "--camera", "c"]);
    run.refused(&["--camera is c", "cam1, b"]);
    pardalis(
        &place,
        &[
            "rectify", "two.toml", "--camera", "b", "-o", "map", "--frames", "1",
        ],
    )
    .fine();
    let scene = read(&place, "map/scene.toml");
    let images = fs::canonicalize(place.path("images")).unwrap();
    assert!(
        scene.contains(&format!(
            "[cameras.cam1]\nimages = \"{}\"",
            images.display()
        )),
        "{scene}"
    );
    assert!(
        scene.contains("[cameras.b]\nimages = \"frames\"\n"),
        "{scene}"
    );
    let ball = fs::canonicalize(place.path("ball.toml")).unwrap();
    assert!(
        scene.contains(&format!("colors = \"{}\"", ball.display())),
        "{scene}"
    );
    assert_eq!(fs::read_dir(place.path("map/frames")).unwrap().count(), 2);

    place.write("one.toml", scene_with("fps = 25\n", ""));
    let image = place.image(0);
    let run = pardalis(
        &place,
        &[
            "rectify",
            "one.toml",
            image.to_str().unwrap(),
            "-o",
            "stills",
        ],
    )
    .fine();
    assert!(
        run.stdout
            .contains("next: pardalis locate stills/scene.toml"),
        "{}",
        run.stdout
    );
    pardalis(&place, &["locate", "stills/scene.toml", "-o", "out"]).fine();
    assert_eq!(place.rows().len(), 1);
}

#[test]
fn output_is_identical_for_any_thread_count() {
    let place = Workplace::with_frames(4);
    place.write("scene.toml", SCENE);
    for threads in ["1", "3"] {
        let run = ["rectify", "scene.toml", "--threads", threads, "-o", threads];
        pardalis(&place, &run).fine();
    }
    for frame in ["000000.png", "000003.png", "times.csv"] {
        let bytes =
            |folder: &str| fs::read(place.path(&format!("{folder}/frames/{frame}"))).unwrap();
        assert!(bytes("1") == bytes("3"), "{frame}");
    }
    assert_eq!(read(&place, "1/scene.toml"), read(&place, "3/scene.toml"));
}

#[test]
fn invalid_requests_are_rejected_and_nothing_is_written() {
    let place = Workplace::with_frames(1);
    place.write("scene.toml", SCENE);
    let refused = |arguments: &[&str], wanted: &[&str]| {
        let run = pardalis(
            &place,
            &[&["rectify", "scene.toml", "-o", "map"], arguments].concat(),
        );
        assert_eq!(run.code, Some(2), "{}", run.stderr);
        for wanted in wanted {
            assert!(
                run.stderr.contains(wanted),
                "no {wanted:?} in: {}",
                run.stderr
            );
        }
        assert!(!place.path("map").exists());
    };
    refused(&["--area", "1,2,3"], &["--area", "four numbers in metres"]);
    refused(
        &["--area", "2,0,1,1"],
        &["cameras.cam1", "the minimum x and y", "--area"],
    );
    refused(
        &["--step", "0"],
        &["cameras.cam1", "positive number of metres"],
    );
    refused(&["--step", "1e-6"], &["16384 per side"]);
    refused(&["--frames", "0"], &["--frames"]);
    refused(&["nowhere.jpg"], &["nowhere.jpg"]);
    place.write("broken.jpg", "no image");
    refused(&["broken.jpg"], &["broken.jpg"]);
    let pose = SCENE
        .lines()
        .find(|line| line.starts_with("world_from_camera"))
        .unwrap();
    let up = pose.replace(
        "[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9]",
        "[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.9]",
    );
    place.write(
        "scene.toml",
        scene_with(pose, &up).replace("= 185.0", "= 90.0"),
    );
    refused(&[], &["cameras.cam1", "nothing of the plane z = 0"]);
    place.write(
        "scene.toml",
        scene_with(pose, &pose.replace("0.9]", "-0.9]")),
    );
    refused(&[], &["cameras.cam1", "0.9 m below the plane"]);

    place.write(
        "scene.toml",
        scene_with("fps = 25\n", "fps = 25\nmask_radius_px = 100\n"),
    );
    refused(
        &["--area", "9,9,10,10"],
        &["cameras.cam1", "shows nothing of the area"],
    );

    place.write("scene.toml", SCENE);
    pardalis(&place, &["rectify", "scene.toml", "-o", "map"]).fine();
    let run = pardalis(&place, &["rectify", "scene.toml", "-o", "map"]);
    run.refused(&["map: is not empty", "--force"]);
    pardalis(&place, &["rectify", "scene.toml", "-o", "map", "--force"]).fine();
    place.write("map/diary.txt", "dear diary");
    let run = pardalis(&place, &["rectify", "scene.toml", "-o", "map", "--force"]);
    run.refused(&["map: holds diary.txt"]);
    assert_eq!(read(&place, "map/diary.txt"), "dear diary");
}
