//! Scenes of other people: whatever they say, no command writes anything but its own results.

use std::fs;
use std::process::Command;

use crate::common::{Run, SCENE, Workplace, frame_file, scene_with};

const CANARY: &str = "do not overwrite me";

/// Runs every command that opens the cameras of a scene. All must refuse the scene with this message and leave the
/// canary, which stands for any file of the user, as it is.
fn assert_refused_by_all(place: &Workplace, scene: &str, wanted: &str) {
    place.write("scene.toml", scene);
    let image = frame_file(0);
    let image = image.to_str().unwrap();
    let before = fs::read_dir(place.path("")).unwrap().count();
    for arguments in [
        &["track", "scene.toml", "-o", "-"][..],
        &["locate", "scene.toml", image],
        &["rectify", "scene.toml", "-o", "out"],
        &["calibrate", "time", "scene.toml", "-o", "out"],
        &["camera", "show", "scene.toml", "-o", "out"],
    ] {
        let run = Run::pardalis(place.path(""), arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
        assert!(run.stderr.contains(wanted), "{arguments:?}: {}", run.stderr);
        let canary = fs::read_to_string(place.path("canary")).unwrap();
        assert_eq!(canary, CANARY, "{arguments:?}");
        let after = fs::read_dir(place.path("")).unwrap().count();
        assert_eq!(after, before, "{arguments:?} wrote a file");
    }
}

#[test]
fn scenes_cannot_pass_options_to_ffmpeg() {
    let place = Workplace::with_frames(1);
    place.write("canary", CANARY);
    for (input, wanted) in [
        (
            "video = \"testsrc,metadata=print:file=canary\"\ninput_options = [\"-f\", \"lavfi\"]",
            "cameras.cam1.input_options: is not a key",
        ),
        (
            "video = \"testsrc,metadata=print:file=canary\"\ninput.format = \"lavfi\"",
            "cameras.cam1.input.format: is the text \"lavfi\"",
        ),
        (
            "video = \"images/000000.jpg\"\ninput.report = true",
            "cameras.cam1.input.report: is not a key",
        ),
        (
            "video = \"/dev/video0\"\ninput.pixel_format = \"-y canary\"",
            "cameras.cam1.input.pixel_format: is the text \"-y canary\"",
        ),
        (
            "video = \"subfile,,start,0,end,9,,:http://127.0.0.1/\"",
            "cameras.cam1.video: has the protocol subfile,,start,0,end,9,,:http",
        ),
    ] {
        let scene = scene_with("images = \"images\"\nfps = 25", input);
        assert_refused_by_all(&place, &scene, wanted);
    }
}

#[test]
fn ffmpeg_writes_no_report() {
    let place = Workplace::with_frames(5);
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-framerate", "25", "-i", "images/%06d.jpg"])
        .args(["-c:v", "copy", "ride.mkv"])
        .status();
    if !encoded.is_ok_and(|status| status.success()) {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    place.write("canary", CANARY);
    let scene = scene_with("images = \"images\"\nfps = 25", "video = \"ride.mkv\"");
    let mut command = place.command(&scene, &["-o", "-"]);
    Run::of(command.env("FFREPORT", "file=canary:level=32")).fine();
    assert_eq!(fs::read_to_string(place.path("canary")).unwrap(), CANARY);
    // The scene itself is fine.
    place.track(SCENE).fine();
}

#[cfg(unix)]
#[test]
fn results_are_not_written_through_links() {
    let place = Workplace::with_frames(1);
    place.write("canary", CANARY);
    place.write("scene.toml", SCENE);
    for folder in ["scene-tracks/annotated", "scene-located", "ball-learnt"] {
        fs::create_dir_all(place.path(folder)).unwrap();
    }
    let track = &["track", "scene.toml", "--no-plots"][..];
    for (arguments, link) in [
        (track, "scene-tracks/summary.json"),
        (track, "scene-tracks/tracks.csv"),
        (
            &["track", "scene.toml", "--annotate"],
            "scene-tracks/annotated/000000.jpg",
        ),
        (&["locate", "scene.toml"], "scene-located/tracks.csv"),
        (
            &[
                "learn",
                "--image",
                "images/000000.jpg",
                "--rect",
                "430,60,60,60",
                "-o",
                "ball.toml",
            ],
            "ball-learnt/mosaic.png",
        ),
    ] {
        std::os::unix::fs::symlink(place.path("canary"), place.path(link)).unwrap();
        let run = Run::pardalis(place.path(""), arguments);
        run.refused(&[&format!("{link}: is a link, through which results")]);
        let canary = fs::read_to_string(place.path("canary")).unwrap();
        assert_eq!(canary, CANARY, "{arguments:?}");
        fs::remove_file(place.path(link)).unwrap();
    }
}
