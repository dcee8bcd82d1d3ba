//! Why a target was not found: `pardalis track --explain`, the summary, `--require-found` and `pardalis locate`.

use std::collections::BTreeSet;
use std::fs;

use crate::common::{Run, Workplace, data, frame_file, scene_with};
use pardalis::tracker::Verdict;
use pardalis_images::{RgbImage, decode, encode_png};
use serde_json::Value;

/// The header of candidates.csv.
const HEADER: &str = "frame,time_s,target,landmark,origin,camera,u_px,v_px,area_px,x_m,y_m,z_m,\
                      outline_nats,color_nats,visible_share,verdict";

/// Returns the scene with a detected ball in the colours of a bundled file.
fn detected(colors: &str) -> String {
    let (scene, _) = crate::common::SCENE.split_once("contour").unwrap();
    let colors = data().join("../colors").join(colors);
    scene.replace("ball.toml", colors.to_str().unwrap())
}

/// Returns the fields of the rows of a candidates.csv after checking that header and rows are complete.
fn candidates(place: &Workplace, folder: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(place.path(folder).join("candidates.csv")).unwrap();
    assert!(text.ends_with('\n'), "{text}");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(HEADER));
    let row = |line: &str| {
        let fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        assert_eq!(fields.len(), 16, "{line}");
        fields
    };
    lines.map(row).collect()
}

/// Returns the verdicts of the rows.
fn verdicts(rows: &[Vec<String>]) -> BTreeSet<&str> {
    rows.iter().map(|row| &*row[15]).collect()
}

/// Returns what the summary says about the ball.
fn ball(place: &Workplace) -> Value {
    let text = fs::read(place.path("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&text).unwrap();
    summary["targets"]["ball"].clone()
}

fn missed(place: &Workplace) -> Value {
    ball(place)["missed"].clone()
}

/// Runs the program on a scene with explanations in the folder `out`.
fn explained(place: &Workplace, scene: &str, more: &[&str]) -> Run {
    let arguments = [&["-o", "out", "--no-plots", "--explain"], more].concat();
    place.track_with(scene, &arguments)
}

/// The ball of the sequence flies from right to left.
#[test]
fn the_run_says_where_a_target_left_the_image() {
    const CUT_PX: usize = 300;
    let place = Workplace::with_frames(0);
    for number in 20..60 {
        let image = decode(&fs::read(frame_file(number)).unwrap()).unwrap();
        let width = image.width() as usize;
        let rows = image.as_raw().chunks_exact(3 * width);
        let cut: Vec<u8> = rows.flat_map(|row| &row[3 * CUT_PX..]).copied().collect();
        let cut = RgbImage::from_raw((width - CUT_PX) as u32, image.height(), cut).unwrap();
        place.write(
            &format!("images/{number:06}.png"),
            encode_png(&cut).unwrap(),
        );
    }
    let scene = detected("orange-ball.hsi.colors.toml").replace("319.5", "19.5");
    let run = place.track(scene);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let rows = place.rows();
    let is_seen = |row: &&Vec<String>| row[3] == "tracking";
    let last = rows.iter().rev().find(is_seen).unwrap()[0]
        .parse::<usize>()
        .unwrap();
    assert!((15..35).contains(&last), "{last}");
    let wanted = format!("after frame {last} its predicted path left the image (left)");
    let report = run.stdout + &run.stderr;
    assert!(
        report.contains(&format!("  {wanted}\n")),
        "{wanted} in {report}"
    );
    let sentences = ball(&place)["not_found"].clone();
    assert_eq!(
        (&sentences[1], &sentences[2]),
        (&Value::from(wanted), &Value::Null)
    );
    // Nothing else needs an explanation.
    assert!(!report.contains("frames, "), "{report}");
    assert!(!report.contains("next: run"), "{report}");
}

#[test]
fn without_its_colours_a_target_is_never_found_and_the_run_says_why() {
    let place = Workplace::with_frames(6);
    let scene = detected("pink-ball.hsi.colors.toml");
    let run = explained(&place, &scene, &[]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for part in [
        "warning: targets.ball: was not found in any of the 6 frames\n",
        "ball was not found in frames 0 to 5; where it is out of view or hidden, nothing needs mending\n",
        "in 6 of these 6 frames, nothing in the image has its colours (no-colors): learn the colours",
        "docs/not-found.md",
    ] {
        assert!(run.stderr.contains(part), "{part:?} in {}", run.stderr);
    }
    let sentences = ball(&place)["not_found"].clone();
    let sentences: Vec<&str> = sentences
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one.as_str().unwrap())
        .collect();
    assert_eq!(sentences.len(), 2);
    for sentence in sentences {
        assert!(
            run.stderr.contains(&format!("{sentence}\n")),
            "{sentence} in {}",
            run.stderr
        );
    }
    let unexplained = place.track(&scene);
    let next = "next: run `pardalis track scene.toml --explain --annotate`, look";
    assert!(unexplained.stderr.contains(next), "{}", unexplained.stderr);
    explained(&place, &scene, &[]);
    let states = "ball: 0 frames tracked, 0 occluded, 0 lost, 6 searching\n";
    assert!(run.stdout.contains(states), "{}", run.stdout);
    let rows = candidates(&place, "out");
    assert_eq!(rows.len(), 6);
    for (frame, row) in rows.iter().enumerate() {
        assert_eq!((&*row[0], &*row[2]), (&*frame.to_string(), "ball"));
        assert_eq!((&*row[5], &*row[15]), ("cam1", "no-colors"));
        // No part of the image, or one too small for a blob.
        let area_px = row[8].parse().unwrap_or(0.0);
        assert!(
            area_px < 9.0 && (row[4] == "image") == row[8].is_empty(),
            "{row:?}"
        );
    }
    assert_eq!(missed(&place), serde_json::json!({ "no-colors": 6 }));

    let required = explained(&place, &scene, &["--require-found"]);
    assert_eq!(required.code, Some(1), "{}", required.stderr);
    assert!(
        required
            .stderr
            .ends_with("error: --require-found: not found in any frame: ball\n")
    );
    assert_eq!(place.rows().len(), 6, "the rows are written nevertheless");

    // Without --explain nothing is left of the earlier run's candidates.
    let run = place.track(&scene);
    assert!(
        run.stderr.contains("--explain --annotate"),
        "{}",
        run.stderr
    );
    assert!(!place.path("out/candidates.csv").exists());
}

#[test]
fn a_wrong_scale_makes_the_ball_too_far() {
    let place = Workplace::with_frames(4);
    let scene = detected("orange-ball.hsi.colors.toml").replace("145.5622506548578", "5000");
    let run = explained(&place, &scene, &[]);
    let message = "in 4 of these 4 frames, the area in its colours is so small that the target would be too far away (too-far)";
    assert!(run.stderr.contains(message), "{}", run.stderr);
    // The ball of data/dioptric-jump, at (460, 88), has no position because none has its size.
    let rows = candidates(&place, "out");
    let near = |field: &str, px: f64| {
        field
            .parse()
            .is_ok_and(|found: f64| (found - px).abs() < 3.0)
    };
    let ball: Vec<_> = rows
        .iter()
        .filter(|row| near(&row[6], 460.0) && near(&row[7], 88.0))
        .collect();
    assert_eq!(ball.len(), 4);
    for row in ball {
        assert_eq!((&*row[4], &*row[9], &*row[15]), ("blob", "", "too-far"));
    }
}

#[test]
fn frames_in_which_a_ball_is_hidden_are_named_with_what_is_seen_there() {
    let place = tempfile::tempdir().unwrap();
    let fisheye = data().join("../../experiments/edge/fisheye.toml");
    let folder = fisheye.parent().unwrap().to_str().unwrap();
    let scene = fs::read_to_string(&fisheye).unwrap();
    let scene = scene.replace("\"../../", &format!("\"{folder}/../../"));
    let scene = scene.replace(
        "data/dioptric-jump/frames",
        "data/dioptric-occlusion-bar/frames",
    );
    fs::write(place.path().join("bar.toml"), scene).unwrap();
    let run = Run::pardalis(&place, &["track", "bar.toml", "-o", "out"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let named = "  ball is in view and counts as occluded in frames ";
    let mut lines = run
        .stdout
        .lines()
        .skip_while(|line| !line.starts_with(named));
    assert!(lines.next().is_some(), "{}", run.stdout);
    let reason = lines.next().unwrap();
    assert!(reason.contains(" of these frames, "), "{reason}");
}

#[test]
fn a_ball_that_is_found_is_the_target_among_the_candidates() {
    let place = Workplace::with_frames(6);
    let scene = detected("orange-ball.hsi.colors.toml");
    let run = explained(&place, &scene, &["--annotate", "--require-found"]).fine();
    assert!(
        run.stdout
            .contains("6 frames tracked, 0 occluded, 0 lost, 0 searching")
    );
    assert!(run.stdout.contains("out/candidates.csv\n"));
    let rows = candidates(&place, "out");
    let targets: Vec<_> = rows.iter().filter(|row| row[15] == "target").collect();
    assert_eq!(targets.len(), 6, "one in each frame");
    for row in &targets {
        let outline_nats: f64 = row[12].parse().unwrap();
        let visible_share: f64 = row[14].parse().unwrap();
        assert!(outline_nats > 5.0 && visible_share > 0.8, "{row:?}");
    }
    // The robot that carries the camera has the ball's colours, but another outline.
    assert!(verdicts(&rows).contains("other-outline"), "{rows:?}");
    assert_eq!(missed(&place), serde_json::json!({}));
    assert_eq!(ball(&place)["doubts"], serde_json::json!([]));
    // Candidates change nothing in rows, and are drawn: the cross is on the ball.
    let picture = |folder: &str| {
        let file = fs::read(place.path(folder).join("annotated/000003.jpg")).unwrap();
        decode(&file).unwrap()
    };
    let explained_rows = fs::read(place.path("out/tracks.csv")).unwrap();
    let drawn = picture("out");
    place
        .track_with(&scene, &["-o", "plain", "--no-plots", "--annotate"])
        .fine();
    assert!(fs::read(place.path("plain/tracks.csv")).unwrap() == explained_rows);
    let plain = picture("plain");
    let differing = drawn.enumerate_pixels().filter(|&(x, y, pixel)| {
        let near = x.abs_diff(490) < 40 && y.abs_diff(88) < 12;
        near && pixel[0].abs_diff(plain.get_pixel(x, y)[0]) > 60
    });
    assert!(
        differing.count() > 100,
        "the verdict stands beside the ball"
    );
}

/// A ball that comes into view after half a second, and a book in its colours.
const BOOK: &str = r"seed = 1
duration_s = 1.0
training_stills = 6
[cameras.cam1]
size_px = [320, 240]
model.pinhole = { f_px = [330, 330], center_px = [159.5, 119.5] }
look_from_m = [0, -1.0, 0.5]
look_at_m = [0, 0, 0.1]
[image]
instants = 1
blur_px = 0.6
read_noise = 2.0
[ground]
texture.noise = { size_m = 0.2, octaves = 4, colors_srgb = [[120, 95, 70], [175, 150, 115]] }
[objects.ball]
target = true
shape.sphere.radius_m = 0.05
color_srgb = [225, 70, 130]
path.waypoints = { times_s = [0.0, 0.5, 0.6, 1.0], positions_m = [[-3, 0, 0.1], [-3, 0, 0.1], [-0.2, 0, 0.1], [-0.1, 0, 0.1]] }
[objects.book]
shape.box.size_m = [0.3, 0.02, 0.16]
color_srgb = [225, 70, 130]
path.still.position_m = [0.22, 0.1, 0]
";

#[test]
fn a_book_in_the_balls_colours_is_ruled_out_by_its_form() {
    let place = Workplace::with_frames(0);
    place.write("world.toml", BOOK);
    Run::pardalis(place.path(""), &["simulate", "world.toml", "-o", "world"]).fine();
    let scene = r#"seed = 1
[cameras.cam1]
images = "world/frames"
calibration = "world/cameras.toml"
frame_limit = 12
[targets.ball]
shape.sphere.radius_m = 0.05
colors = "world/ball.colors.toml"
"#;
    let run = explained(&place, scene, &[]);
    let message = "warning: targets.ball: was not found in any of the 12 frames";
    assert!(run.stderr.contains(message), "{}", run.stderr);
    // A circle around it is empty above and below; one within it does not have its corners.
    let forms = BTreeSet::from(["covered", "other-outline", "same-place"]);
    let rows = candidates(&place, "out");
    assert!(verdicts(&rows).is_subset(&forms), "{:?}", verdicts(&rows));
    assert!(rows.len() >= 12);

    // Single images say the same; the ball has a confidence.
    place.write(
        "scene.toml",
        scene.replace("frame_limit = 12", "frame_limit = 25"),
    );
    let run = Run::pardalis(place.path(""), &["locate", "scene.toml", "-o", "located"]).fine();
    let lines: Vec<&str> = run.stdout.lines().collect();
    let reason = lines[3].strip_prefix("frame 3: ball not found: ").unwrap();
    assert!(
        forms
            .iter()
            .any(|form| reason.ends_with(&format!("({form})"))),
        "{reason}"
    );
    let (place, confidence) = lines[24].split_once(" mm, confidence ").unwrap();
    let (confidence, _) = confidence.split_once("; seen at ").unwrap();
    // Truly at -0.082.
    assert!(place.starts_with("frame 24: ball at -0.08"), "{place}");
    assert!(confidence.parse::<f64>().unwrap() > 0.5, "{confidence}");
}

#[test]
fn two_equal_balls_are_rivals_for_one_target() {
    let place = Workplace::with_frames(0);
    let frames = data().join("../dioptric-two-balls/frames");
    let scene = detected("orange-ball.hsi.colors.toml").replace(
        "\"images\"",
        &format!("{:?}\nframe_limit = 3", frames.to_str().unwrap()),
    );
    let run = explained(&place, &scene, &[]);
    let message = "in 3 of these 3 frames, several candidates look like it (rival)";
    assert!(run.stderr.contains(message), "{}", run.stderr);

    // Once one of them is followed, the other is still there.
    let run = explained(&place, &scene.replace("frame_limit = 3", ""), &[]).fine();
    let doubts = ball(&place)["doubts"].clone();
    let doubt = doubts[0].as_str().unwrap();
    assert!(
        doubt.contains("something else looked as much like it (rival)"),
        "{doubts}"
    );
    assert!(
        run.stdout.contains(&format!("  {doubt}\n")),
        "{}",
        run.stdout
    );
}

#[test]
fn at_a_click_the_reason_is_that_of_what_is_there() {
    let place = Workplace::with_frames(1);
    let scene = detected("orange-ball.hsi.colors.toml").replace("145.5622506548578", "5000");
    place.write("scene.toml", scene);
    let located = |at: &str| {
        let run = Run::pardalis(place.path(""), &["locate", "scene.toml", "--at", at]).fine();
        run.stdout.lines().next().unwrap().to_owned()
    };
    // On the ball of data/dioptric-jump, and beside everything orange.
    let reason = located("460,88");
    assert!(
        reason.starts_with(
            "frame 0: ball not found: at the click, the area in its colours is so small"
        ),
        "{reason}"
    );
    let reason = located("320,150");
    assert_eq!(
        reason,
        "frame 0: ball not found: nothing at the click has its colours (no-colors)"
    );
}

#[test]
fn explanations_need_a_folder() {
    let place = Workplace::with_frames(1);
    let scene = detected("orange-ball.hsi.colors.toml");
    let run = place.track_with(&scene, &["-o", "-", "--explain"]);
    run.refused(&["--explain: writes candidates.csv into the output folder; give -o a folder"]);
    // An initialised target is not searched for: it has no candidates.
    let scene = scene_with("[1.35, -1.25, 0.62]", "[1.35, -1.25, 50]");
    let run = explained(&place, &scene, &[]);
    assert_eq!(run.code, Some(0));
    assert!(
        run.stderr.contains("followed from its start"),
        "{}",
        run.stderr
    );
    assert_eq!(candidates(&place, "out").len(), 0);
}

#[test]
fn the_guide_has_a_section_for_each_verdict_in_their_order() {
    let page = data().join("../../docs/not-found.md");
    let page = fs::read_to_string(page).unwrap();
    let sections: Vec<&str> = page
        .lines()
        .filter_map(|line| line.strip_prefix("## "))
        .collect();
    let verdicts = Verdict::ALL.map(Verdict::name);
    assert_eq!(sections[..verdicts.len()], verdicts);
}

#[test]
fn a_ball_is_no_rival_of_itself() {
    let place = Workplace::with_frames(0);
    let frames = data().join("../dioptric-jump/frames");
    let scene = detected("orange-ball.hsi.colors.toml")
        .replace("\"images\"", &format!("{:?}", frames.to_str().unwrap()));
    explained(&place, &scene, &[]).fine();
    // In some frames its outline is fitted at two distances.
    let rows = candidates(&place, "out");
    let count = |verdict: &str| rows.iter().filter(|row| row[15] == verdict).count();
    assert!(count("target") > 80 && count("same-place") > 0);
    let rival = rows.iter().find(|row| row[15] == "rival");
    assert_eq!(rival, None);
}
