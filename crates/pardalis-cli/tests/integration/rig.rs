//! `pardalis track` on the four cameras of data/webcams-four, one of which fails: the target is not lost, and the
//! summary states the failure.

mod disagreement;
mod faults;
mod place;
mod refusals;

use crate::common::run::rows_in;
use place::{FPS, FRAMES, Rig};
use serde_json::json;

#[test]
fn four_working_cameras() {
    let rig = Rig::new();
    let run = rig.track("").fine();
    rig.assert_followed();
    let summary = rig.summary();
    assert_eq!(
        (&summary["frame_sets"], &summary["max_delay_s"]),
        (&FRAMES.into(), &0.1.into())
    );
    for camera in Rig::CAMERAS {
        let frames = rig.frames(camera);
        assert_eq!(
            (&frames["delivered"], &frames["used"]),
            (&120.into(), &120.into())
        );
        assert_eq!(
            (&frames["first_time_s"], &frames["last_time_s"]),
            (&0.0.into(), &4.76.into())
        );
        assert_eq!(summary["cameras"][camera]["stopped"], json!(null));
        let contribution = &summary["targets"]["ball"]["cameras"][camera];
        let visible = contribution["visible_frames"].as_u64().unwrap();
        assert!(
            contribution["used_frames"] == 120 && (50..=120).contains(&visible),
            "{contribution}"
        );
        assert!(
            contribution["mean_log_likelihood_ratio"].as_f64().unwrap() > 0.0,
            "{contribution}"
        );
        assert!(
            run.stdout
                .contains(&format!("{camera}                  120      120 ")),
            "{}",
            run.stdout
        );
    }
    // With fps instead of time stamps the result is the same, for any delay and number of threads.
    let tracks = rig.tracks();
    for (scene, threads) in [
        ("[timing]\nmax_delay_s = 0\n", "1"),
        ("[timing]\nmax_delay_s = 1\n", "3"),
    ] {
        let run = rig
            .track_with(scene, &["-o", "-", "--threads", threads])
            .fine();
        assert!(run.stdout == tracks, "{scene} {threads}");
    }
    rig.by_fps();
    rig.track("").fine();
    assert!(rig.tracks() == tracks);
}

#[test]
fn one_camera_frozen() {
    // The ball's radius is 35 mm. Without the first camera, often only two cameras see the ball.
    for (from, to, bound_m) in [(50, 75, 0.012), (1, FRAMES, 0.020)] {
        let rig = Rig::new();
        rig.freeze("cam1", from..to);
        let run = rig.track("");
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let message = "warning: cameras.cam1: only 1 of its 120 frames were used";
        assert_eq!(run.stderr.starts_with(message), from == 1, "{}", run.stderr);
        rig.assert_followed_within(bound_m);
        let frames = rig.frames("cam1");
        assert_eq!(
            (&frames["frozen"], &frames["used"]),
            (&(to - from).into(), &(FRAMES - to + from).into())
        );
        assert_eq!(rows_in(&rig.tracks()).len(), FRAMES);
    }
}

/// Without new images the state is only predicted, and its uncertainty grows.
#[test]
fn all_cameras_frozen() {
    let rig = Rig::new();
    for camera in Rig::CAMERAS {
        rig.freeze(camera, 20..40);
    }
    rig.track("").fine();
    let rows = rows_in(&rig.tracks());
    assert_eq!(rows.len(), FRAMES);
    let variance_m2 = |row: usize| rows[row][11].parse::<f64>().unwrap();
    assert!(
        variance_m2(39) > 3.0 * variance_m2(19),
        "{} {}",
        variance_m2(39),
        variance_m2(19)
    );
    assert_eq!(rows[39][3], "occluded");
}

#[test]
fn one_camera_without_frames_for_a_second() {
    let rig = Rig::new();
    rig.remove("cam3", 40..65);
    rig.track("").fine();
    rig.assert_followed();
    let frames = rig.frames("cam3");
    assert_eq!(
        (&frames["used"], &frames["delivered"]),
        (&95.into(), &95.into())
    );
    let gap_s = frames["longest_gap_s"].as_f64().unwrap();
    assert!((gap_s - 26.0 / FPS).abs() < 1e-9, "{gap_s}");
}

#[test]
fn one_camera_arrives_late() {
    let sound = Rig::new();
    sound.track("").fine();
    let rig = Rig::new();
    rig.times("cam2", true, |frame| {
        (frame as f64 / FPS, (frame + 1) as f64 / FPS)
    });
    rig.track("").fine();
    assert!(
        rig.tracks() == sound.tracks(),
        "nothing is lost, and nothing changed"
    );
    let frames = rig.frames("cam2");
    assert_eq!(
        (&frames["sorted_in_late"], &frames["dropped_late"]),
        (&120.into(), &0.into())
    );

    let run = rig.track("[timing]\nmax_delay_s = 0\n");
    assert_eq!(run.code, Some(0));
    let message = "warning: cameras.cam2: 120 of its frames arrived too late and were dropped; timing.max_delay_s, the longest wait for late frames, is 0 s";
    assert!(run.stderr.starts_with(message), "{}", run.stderr);
    rig.assert_followed();
    let frames = rig.frames("cam2");
    assert_eq!(
        (&frames["sorted_in_late"], &frames["dropped_late"]),
        (&0.into(), &120.into())
    );
    assert_eq!(rig.frames("cam1")["used"], 120);
    assert_eq!(rig.summary()["cameras"]["cam2"]["stopped"], json!(null));
}

#[test]
fn one_camera_shuffled() {
    let sound = Rig::new();
    sound.track("").fine();
    let rig = Rig::new();
    // Of every three frames, the last is delivered first.
    rig.deliver("cam4", |place| place / 3 * 3 + 2 - place % 3);
    rig.track("").fine();
    assert!(
        rig.tracks() == sound.tracks(),
        "sorted, they are as they were"
    );
    let frames = rig.frames("cam4");
    assert_eq!(
        (&frames["used"], &frames["sorted_in_late"]),
        (&120.into(), &80.into())
    );
    // Too short a delay drops some frames but does not lose the target.
    let run = rig.track("[timing]\nmax_delay_s = 0.05\n");
    assert_eq!(run.code, Some(0));
    rig.assert_followed();
    let frames = rig.frames("cam4");
    assert_eq!(
        (&frames["sorted_in_late"], &frames["dropped_late"]),
        (&40.into(), &40.into())
    );
}

#[test]
fn one_camera_with_a_wrong_clock() {
    let rig = Rig::new();
    rig.times("cam2", false, |frame| ((frame + 1) as f64 / FPS, 0.0));
    rig.edit("cam2", "time_offset_s = -0.04\n");
    rig.track("").fine();
    rig.assert_followed();
    assert_eq!(rig.summary()["frame_sets"], FRAMES);
}

#[test]
fn a_wrong_radius_is_corrected_with_a_warning_and_an_unknown_one_is_found() {
    let rig = Rig::new();
    let in_mm = |field: &String| 1000.0 * field.parse::<f64>().unwrap();
    for (radius, is_told) in [("0.028", true), ("0.035", false), ("\"unknown\"", false)] {
        let run = rig.track_ball(&format!(
            "shape.sphere.radius_m = {radius}\ncolors = \"ball.toml\"\n"
        ));
        let told = run.stderr.contains(
            "targets.ball.shape.sphere.radius_m: the scene says 28 mm, the cameras say 35.",
        );
        assert_eq!(told, is_told, "{radius}: {}", run.stderr);
        assert!(
            run.stdout.contains("targets.ball: radius 35."),
            "{}",
            run.stdout
        );
        let rows = rows_in(&rig.tracks());
        let [radius_m, sigma_m] = [22, 23].map(|at| &rows[FRAMES - 1][at]);
        assert!((in_mm(radius_m) - 35.0).abs() < 0.3, "{radius}: {radius_m}");
        assert!(
            (0.05..0.35).contains(&in_mm(sigma_m)),
            "{radius}: {sigma_m}"
        );
        let entry = &rig.summary()["targets"]["ball"]["estimated_radii"]["targets.ball"];
        assert_eq!(entry["radius_m"].as_f64().unwrap().to_string(), *radius_m);
    }
}
