//! Targets that another program detects, on the first frames of data/dioptric-jump: boxes around the true ball, as a detector with misses, clutter and noise gives them.

use std::fmt::Write as _;
use std::fs;

use pardalis::camera::{Camera, Equidistant};
use pardalis::shape::{Shape, Sphere, SphereOutline, Stance};

use crate::common::{Run, Workplace, data, scene_with};

const FRAMES: usize = 40;

/// A scene without colours.
fn scene() -> String {
    let all = scene_with(
        "images = \"images\"",
        "images = \"images\"\ndetections = \"boxes.csv\"",
    );
    let end = all.find("colors = ").unwrap();
    all[..end].to_owned() + "detector = {}\n"
}

/// The true positions, metres.
fn truth_m() -> Vec<[f64; 3]> {
    let text = fs::read_to_string(data().join("truth.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        [4, 5, 6].map(|column| cells[column].parse().unwrap())
    };
    text.lines().skip(1).take(FRAMES).map(row).collect()
}

/// The boxes of the ball: left, top, right and bottom.
fn boxes() -> Vec<[f64; 4]> {
    let camera = Equidistant::new(145.562_250_654_857_8, [319.5, 239.5], 1.6).unwrap();
    let ball = Shape::Sphere(Sphere::new(0.11, SphereOutline::Tangent).unwrap());
    let down = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0,
    ));
    let pose = pardalis::camera::Pose::from_parts(nalgebra::Translation3::new(0.0, 0.0, 0.9), down);
    let of = |place_m: [f64; 3]| {
        let pixels = ball.outline_px(
            &Camera::from(camera),
            &pose.inverse(),
            place_m,
            Stance::default(),
            500,
        );
        let mut sides = [
            f64::INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NEG_INFINITY,
        ];
        for [u, v] in pixels.into_iter().map(Option::unwrap) {
            sides = [
                sides[0].min(u),
                sides[1].min(v),
                sides[2].max(u),
                sides[3].max(v),
            ];
        }
        sides
    };
    truth_m().into_iter().map(of).collect()
}

/// The file of a detector that misses every seventh ball, and reports a lamp in every image.
fn file() -> String {
    let mut text = "frame,class,left_px,top_px,right_px,bottom_px,score\n".to_owned();
    for (frame, [u0, v0, u1, v1]) in boxes().into_iter().enumerate() {
        let off = 0.4 * (1.7 * frame as f64).sin();
        if frame % 7 != 5 {
            let _ = writeln!(text, "{frame},ball,{},{v0},{u1},{},0.8", u0 + off, v1 - off);
        }
        let _ = writeln!(text, "{frame},lamp,10,20,60,50,0.9");
    }
    text
}

#[test]
fn boxes_of_a_file_are_tracked() {
    let place = Workplace::with_frames(FRAMES);
    place.write("boxes.csv", file());
    let run = place
        .track_with(scene(), &["-o", "out", "--no-plots", "--annotate"])
        .fine();
    assert!(
        run.stdout.contains("ball: 40 frames tracked"),
        "{}",
        run.stdout
    );
    for (row, truth_m) in place.rows().iter().zip(truth_m()) {
        let position = [4, 5, 6].map(|column| row[column].parse::<f64>().unwrap());
        let off_m: f64 = (0..3)
            .map(|i| (position[i] - truth_m[i]).powi(2))
            .sum::<f64>()
            .sqrt();
        assert!(off_m < 0.2 && row[3] == "tracking", "{row:?} {truth_m:?}");
    }
    // Its class has another name than the target, or there are none.
    place.write("boxes.csv", file().replace("ball", "sports ball"));
    let named = scene().replace("detector = {}", "detector.class = \"sports ball\"");
    place.track(named).fine();
    let rows = place.rows();
    let lines = file().replace(",class", "").replace(",ball", "");
    let without: Vec<&str> = lines
        .lines()
        .filter(|line| !line.contains("lamp"))
        .collect();
    place.write("boxes.csv", without.join("\n") + "\n");
    place.track(scene()).fine();
    assert_eq!(place.rows(), rows);
    place.write("boxes.csv", file());
    // The same with another number of threads.
    let rows = |threads: &str| {
        place
            .track_with(scene(), &["-o", "out", "--no-plots", "--threads", threads])
            .fine();
        place.rows()
    };
    assert_eq!(rows("1"), rows("3"));
}

#[test]
fn files_of_coco_are_tracked() {
    let place = Workplace::with_frames(FRAMES);
    let mut csv = "frame,left_px,top_px,right_px,bottom_px\n".to_owned();
    for (frame, [u0, v0, u1, v1]) in boxes().into_iter().enumerate() {
        let _ = writeln!(csv, "{frame},{u0},{v0},{u1},{v1}");
    }
    place.write("boxes.csv", csv);
    place.track(scene()).fine();
    let wanted = place.rows();
    // Sides count from the image's border.
    let annotations = boxes().into_iter().enumerate();
    let annotations = annotations.map(|(frame, [u0, v0, u1, v1])| {
        let bbox = [u0 + 0.5, v0 + 0.5, u1 - u0, v1 - v0];
        serde_json::json!({ "image_id": frame, "category_id": 37, "bbox": bbox })
    });
    let annotations: Vec<_> = annotations.collect();
    let images = (0..FRAMES).map(
        |frame| serde_json::json!({ "id": frame, "file_name": format!("images/{frame:06}.jpg") }),
    );
    let set = serde_json::json!({
        "images": images.collect::<Vec<_>>(),
        "annotations": annotations,
        "categories": [{ "id": 37, "name": "ball" }],
    });
    let results = serde_json::Value::Array(annotations).to_string();
    for (text, class) in [(set.to_string(), "ball"), (results, "37")] {
        place.write("boxes.json", text);
        let named = scene()
            .replace("boxes.csv", "boxes.json")
            .replace("detector = {}", &format!("detector.class = {class:?}"));
        place.track(named).fine();
        let rows = place.rows();
        assert_eq!(rows.len(), wanted.len());
        for (row, wanted) in rows.iter().zip(&wanted) {
            for column in [4, 5, 6] {
                let [a, b] = [row, wanted].map(|row| row[column].parse::<f64>().unwrap());
                assert!((a - b).abs() < 1e-6, "{row:?} {wanted:?}");
            }
        }
    }
    place.write("boxes.json", r#"[{"image_id":99,"bbox":[1,2,3,4]}]"#);
    let run = place.track(scene().replace("boxes.csv", "boxes.json"));
    let problem = "boxes.json, entry 1: image_id is 99, and no image of the camera";
    assert!(
        run.code == Some(2) && run.stderr.contains(problem),
        "{}",
        run.stderr
    );
}

#[test]
fn detections_are_those_of_the_frames_that_are_read() {
    let place = Workplace::with_frames(FRAMES);
    place.write("boxes.csv", file());
    let some = scene().replace("fps = 25", "fps = 25\nfirst_frame = 11\nframe_step = 2");
    let run = place.track(some).fine();
    assert!(
        run.stdout.contains("ball: 15 frames tracked"),
        "{}",
        run.stdout
    );
    for (row, truth_m) in place
        .rows()
        .iter()
        .zip(truth_m().iter().skip(11).step_by(2))
    {
        let x_m: f64 = row[4].parse().unwrap();
        assert!((x_m - truth_m[0]).abs() < 0.2, "{row:?} {truth_m:?}");
    }
}

#[test]
fn images_at_which_the_detector_did_not_look_say_nothing() {
    let place = Workplace::with_frames(FRAMES);
    let all = file();
    let (header, rows) = all.split_once('\n').unwrap();
    // It looks at every third image.
    let frame = |row: &str| row.split(',').next().unwrap().parse::<usize>().unwrap();
    let some: Vec<&str> = rows.lines().filter(|row| frame(row) % 3 == 0).collect();
    place.write("boxes.csv", format!("{header}\n{}\n", some.join("\n")));
    let tracked = || {
        let rows = place.rows();
        let tracking = rows.iter().filter(|row| row[3] == "tracking");
        tracking.count()
    };
    let remedy = "cameras.cam1.detections: boxes.csv: has boxes of 14 of 40 images, and says of the others that the detector found nothing; if it did not look at them, give detections_complete = false";
    let run = place.track(scene());
    assert!(run.stderr.contains(remedy), "{}", run.stderr);
    let run = Run::pardalis(place.path(""), &["check", "scene.toml"]);
    assert!(run.stderr.contains(remedy), "{}", run.stderr);
    let as_complete = tracked();
    let partial = scene().replace("boxes.csv\"", "boxes.csv\"\ndetections_complete = false");
    place.track(&partial).fine();
    assert!(
        tracked() > 30 && tracked() > 2 * as_complete,
        "{} {as_complete}",
        tracked()
    );
    // A row without a box says that it found nothing.
    let columns = header.split(',').count();
    let empty = |frame: usize| format!("{frame}{}\n", ",".repeat(columns - 1));
    let misses: String = (20..FRAMES).map(empty).collect();
    let seen: Vec<&str> = rows.lines().filter(|row| frame(row) < 20).collect();
    place.write(
        "boxes.csv",
        format!("{header}\n{}\n{misses}", seen.join("\n")),
    );
    place.track(&partial).fine();
    assert_ne!(place.rows().last().unwrap()[3], "tracking");
    place
        .track(scene().replace("boxes.csv\"", "boxes.csv\"\ndetections_complete = 1"))
        .refused(&["detections_complete"]);
}

#[test]
fn boxes_of_images_of_half_the_size_are_doubted() {
    let place = Workplace::with_frames(FRAMES);
    let halves = boxes().into_iter().enumerate().map(|(frame, sides)| {
        let [u0, v0, u1, v1] = sides.map(|side| 0.25 * side);
        format!("{frame},{u0},{v0},{u1},{v1}\n")
    });
    place.write(
        "boxes.csv",
        "frame,left_px,top_px,right_px,bottom_px\n".to_owned() + &halves.collect::<String>(),
    );
    let run = place.track(scene());
    let doubt = "all boxes lie in the upper left quarter of the images";
    assert!(run.stderr.contains(doubt), "{}", run.stderr);
    place.write("boxes.csv", file());
    place.track(scene()).fine();
}

#[test]
fn a_check_and_a_smoothed_track_know_boxes() {
    let place = Workplace::with_frames(FRAMES);
    place.write("boxes.csv", file());
    place
        .track_with(scene(), &["-o", "out", "--no-plots", "--smooth"])
        .fine();
    let squares = |name: &str| -> f64 {
        let text = fs::read_to_string(place.path(&format!("out/{name}"))).unwrap();
        let rows = crate::common::rows_in(&text).into_iter().zip(truth_m());
        let off = |(row, truth_m): (Vec<String>, [f64; 3])| {
            let position = [4, 5, 6].map(|column| row[column].parse::<f64>().unwrap());
            (0..3)
                .map(|i| (position[i] - truth_m[i]).powi(2))
                .sum::<f64>()
        };
        rows.map(off).sum()
    };
    assert!(squares("tracks.csv") < squares("filtered.csv"));
    let run = Run::pardalis(place.path(""), &["check", "scene.toml"]).fine();
    assert!(
        run.stdout.contains("found in the first frames"),
        "{}",
        run.stdout
    );
    let run = Run::pardalis(place.path(""), &["locate", "scene.toml", "-o", "out"]).fine();
    assert!(run.stdout.contains("frame 0: ball"), "{}", run.stdout);
}

#[test]
fn boxes_are_explained() {
    let place = Workplace::with_frames(FRAMES);
    // Three times as wide as a ball is.
    let wide = boxes()
        .into_iter()
        .enumerate()
        .map(|(frame, [u0, v0, u1, v1])| {
            format!("{frame},{},{v0},{},{v1}\n", 2.0 * u0 - u1, 2.0 * u1 - u0)
        });
    let text = "frame,left_px,top_px,right_px,bottom_px\n".to_owned() + &wide.collect::<String>();
    place.write("boxes.csv", text);
    let arguments = ["-o", "out", "--no-plots", "--explain", "--annotate"];
    let run = place.track_with(scene(), &arguments);
    let wanted =
        "in 40 of these 40 frames, the box has another outline (other-outline): check the shape";
    assert!(run.stderr.contains(wanted), "{}", run.stderr);
    let rows = fs::read_to_string(place.path("out/candidates.csv")).unwrap();
    let row = rows.lines().nth(1).unwrap();
    assert!(
        row.starts_with("0,0,ball,,box,cam1,") && row.ends_with(",other-outline"),
        "{row}"
    );
    place.write("boxes.csv", file());
    place.track_with(scene(), &arguments).fine();
    let rows = fs::read_to_string(place.path("out/candidates.csv")).unwrap();
    let count = |verdict: &str| rows.lines().filter(|row| row.ends_with(verdict)).count();
    assert_eq!(
        (count(",target"), count(",other-outline")),
        (35, 0),
        "{rows}"
    );
}

#[test]
fn boxes_beside_colours_leave_the_place_to_the_edges() {
    let place = Workplace::with_frames(FRAMES);
    place.write("boxes.csv", file());
    let colors = "colors = \"ball.toml\"\n";
    let beside = scene() + colors;
    let alone = beside
        .replace("detections = \"boxes.csv\"\n", "")
        .replace("detector = {}\n", "");
    assert!(!alone.contains("detect"), "{alone}");
    let off_m = |scene: &str| {
        place
            .track_with(scene, &["-o", "out", "--no-plots", "--explain"])
            .fine();
        let rows = place.rows();
        let off_m = rows.iter().zip(truth_m()).map(|(row, truth_m)| {
            assert_eq!(row[3], "tracking", "{row:?}");
            let off_m = [4, 5, 6].map(|at| row[at].parse::<f64>().unwrap() - truth_m[at - 4]);
            off_m.iter().map(|off| off * off).sum::<f64>()
        });
        let sum: f64 = off_m.sum();
        (sum / rows.len() as f64).sqrt()
    };
    let [alone_m, beside_m] = [off_m(&alone), off_m(&beside)];
    assert!(beside_m < 1.02 * alone_m, "{alone_m} {beside_m}");
    // A detector that never sees the ball is believed, from the second image on.
    let text = file().replace(",ball,", ",lamp,") + "0,ball,600,400,630,430,0.2\n";
    place.write("boxes.csv", text);
    let run = place.track_with(beside, &["-o", "out", "--no-plots", "--explain"]);
    let states: Vec<_> = place.rows().iter().map(|row| row[3].clone()).collect();
    assert!(
        states[1..].iter().all(|state| state == "lost"),
        "{states:?}"
    );
    let wanted = "the detector has no box there (no-box): check detector.class";
    assert!(run.stdout.contains(wanted), "{}", run.stdout);
}

#[test]
fn a_simulated_detector_is_tracked() {
    let place = tempfile::tempdir().unwrap();
    let world = "seed = 2\nduration_s = 1.2\n[detector]\nfalse_per_image = 1\n[timing]\nfps = 25\n\
        [cameras.cam1]\nsize_px = [160, 120]\nlook_from_m = [0, -6, 2]\nlook_at_m = [0, 0, 0.8]\n\
        model.pinhole = { f_px = [150, 150], center_px = [79.5, 59.5] }\n\
        [objects.person]\ntarget = true\nshape.cylinder = { radius_m = 0.25, height_m = 1.75 }\ncolor_srgb = [90, 90, 95]\n\
        path.line = { position_m = [-1, 0, 0], velocity_mps = [1, 0.3, 0] }\n";
    fs::write(place.path().join("world.toml"), world).unwrap();
    Run::pardalis(&place, &["simulate", "world.toml", "-o", "made"]).fine();
    let boxes = fs::read_to_string(place.path().join("made/detections/cam1.csv")).unwrap();
    assert!(boxes.lines().count() > 30, "{boxes}");
    Run::pardalis(
        &place,
        &["track", "made/scene.toml", "-o", "out", "--no-plots"],
    )
    .fine();
    let run = Run::pardalis(&place, &["evaluate", "out", "made", "--json", "-"]).fine();
    let figures: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    let person = &figures["targets"][0];
    assert!(person["coverage"].as_f64().unwrap() > 0.8, "{person}");
    let rmse_m = person["all"]["errors"]["position_m"]["rmse"]
        .as_f64()
        .unwrap();
    assert!(rmse_m < 0.4, "{person}");
    // The same seed gives the same boxes.
    Run::pardalis(&place, &["simulate", "world.toml", "-o", "again"]).fine();
    let again = fs::read_to_string(place.path().join("again/detections/cam1.csv")).unwrap();
    assert_eq!(again, boxes);
}

#[test]
fn annotated_frames_show_the_boxes() {
    let place = Workplace::with_frames(2);
    let header = "frame,left_px,top_px,right_px,bottom_px\n";
    // The picture at the middle of the right side of the second box; the target's colour is blue.
    let blue = |boxes: &str| {
        place.write("boxes.csv", format!("{header}{boxes}"));
        place.track_with(scene(), &["-o", "out", "--no-plots", "--annotate"]);
        let drawn = fs::read(place.path("out/annotated/000001.jpg")).unwrap();
        let image = pardalis_images::decode(&drawn).unwrap();
        let (width, height) = image.size_px();
        assert!(height >= 480, "{width} x {height}");
        // A title may be above the image.
        let pixel = |row: usize| &image.as_raw()[3 * (row * width + 260)..][..3];
        (height - 480 + 310..height - 480 + 350)
            .filter(|&row| i32::from(pixel(row)[2]) > i32::from(pixel(row)[0]) + 60)
            .count()
    };
    assert_eq!(blue("0,200,300,260,360\n"), 0);
    assert!(blue("1,200,300,260,360\n") > 35);
}

#[test]
fn files_that_do_not_suit_are_refused() {
    let place = Workplace::with_frames(3);
    let header = "frame,class,left_px,top_px,right_px,bottom_px\n";
    for (text, wanted) in [
        (
            format!("{header}0,cup,1,2,3,4\n"),
            "boxes.csv: no box is of the class ball; found: cup; give detector.class",
        ),
        (
            format!("{header}5,ball,1,2,3,4\n"),
            "boxes.csv, line 2: frame 5, but the camera has 3 images",
        ),
        (
            format!("{header}0,ball,1,2,nan,4\n"),
            "boxes.csv, line 2, column right_px: holds \"nan\"",
        ),
        (header.to_owned(), "boxes.csv: has no rows"),
        (
            format!("{header}0,ball,1000,900,1040,940\n"),
            "boxes.csv: 1 of 1 boxes are outside of the images, which are 640 x 480 pixels; are they in pixels of resized images?",
        ),
        (
            format!("{header}0,ball,0.1,0.2,0.3,1.05\n"),
            "boxes.csv: all sides of its boxes are between 0 and 1, as shares of the width and height are; multiply these by 640 and 480",
        ),
        (format!("{header}0,ball,,,,\n"), "boxes.csv: has no boxes"),
    ] {
        place.write("boxes.csv", text);
        place
            .track(scene())
            .refused(&["cameras.cam1.detections: ", wanted]);
    }
    fs::remove_file(place.path("boxes.csv")).unwrap();
    place
        .track(scene())
        .refused(&["cameras.cam1.detections: ", "boxes.csv"]);
    place.write("boxes.csv", format!("{header}0,ball,1,2,3,4\n"));
    place.write("scene.toml", scene());
    let other = Run::pardalis(
        place.path(""),
        &["locate", "scene.toml", "images/000000.jpg"],
    );
    other.refused(&["cameras.cam1.detections: is of the scene's images"]);
}
