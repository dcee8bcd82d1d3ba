//! Cameras that fail or end while others continue.

use std::fs;

use serde_json::json;

use super::place::{FRAMES, Rig};

#[test]
fn broken_images_are_skipped() {
    let rig = Rig::new();
    for place in [10, 11, 50, 51, 52] {
        let path = rig.image("cam2", place);
        let whole = fs::read(&path).unwrap();
        fs::write(path, &whole[..whole.len() / 2]).unwrap();
    }
    fs::write(rig.image("cam2", 80), "no image").unwrap();
    let small = pardalis_images::RgbImage::new(32, 24);
    fs::write(
        rig.image("cam2", 81),
        pardalis_images::encode_png(&small).unwrap(),
    )
    .unwrap();
    let run = rig.track("");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    rig.assert_followed();
    let frames = rig.frames("cam2");
    assert_eq!(
        (&frames["broken"], &frames["used"]),
        (&7.into(), &113.into())
    );
    // Only the first few are named.
    let lines: Vec<&str> = run.stderr.lines().collect();
    assert_eq!(lines.len(), 4, "{}", run.stderr);
    for (line, place) in lines.iter().zip([10, 11, 50]) {
        let start = "warning: cameras.cam2: left out a broken image: ";
        assert!(
            line.starts_with(start) && line.contains(&format!("{place:06}.jpg")),
            "{line}"
        );
    }
    assert!(lines[3].ends_with("further broken images are counted, but not named"));
}

#[test]
fn cameras_with_only_broken_images_stop() {
    let rig = Rig::new();
    // A complete header without image data.
    let no_image = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\x01\x40\0\0\0\xf0\x08\x02\0\0\0\0\0\0\0\0\0\0\0IEND\xae\x42\x60\x82";
    for place in 0..FRAMES {
        fs::write(rig.image("cam4", place), no_image).unwrap();
    }
    let run = rig.track("");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    rig.assert_followed();
    assert_eq!(rig.frames("cam4")["broken"], FRAMES);
    let stopped = &rig.summary()["cameras"]["cam4"]["stopped"];
    assert_eq!(
        (&stopped["time_s"], &stopped["reason"]),
        (&json!(null), &json!("it gave no frame"))
    );

    for place in 0..FRAMES {
        fs::write(rig.image("cam4", place), "no image").unwrap();
    }
    rig.track("").refused(&[
        "line 11: cameras.cam4.images: cam4/000000.jpg: this is not a JPEG or PNG image",
    ]);
}

#[test]
fn a_camera_that_ends_early_does_not_stop_the_others() {
    let rig = Rig::new();
    rig.remove("cam3", 60..FRAMES);
    let run = rig.track("");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let message =
        "warning: cameras.cam3: stopped at 2.360 s: its frames end before those of others\n";
    assert_eq!(run.stderr, message);
    rig.assert_followed();
    let stopped = &rig.summary()["cameras"]["cam3"]["stopped"];
    assert_eq!(stopped["time_s"], 2.36);
    assert_eq!(stopped["reason"], "its frames end before those of others");
}

#[cfg(unix)]
mod with_ffmpeg {
    use std::os::unix::fs::PermissionsExt;
    use std::process::Command;

    use super::*;
    use crate::common::run::{Run, rows_in};

    /// A rig whose second camera is a video that is decoded by the shell script, in which FFMPEG stands for the
    /// installed ffmpeg; `None` if ffmpeg is not installed.
    fn rig_with_video(settings: &str, script: &str) -> Option<Rig> {
        let found = std::env::split_paths(&std::env::var_os("PATH")?)
            .map(|folder| folder.join("ffmpeg"))
            .find(|path| path.is_file());
        let Some(ffmpeg) = found else {
            println!("skipped: ffmpeg is not installed");
            return None;
        };
        let rig = Rig::new();
        for camera in ["cam1", "cam2"] {
            let input = rig.path(&format!("{camera}/%06d.jpg"));
            let encoded = Command::new(&ffmpeg)
                .args(["-v", "error", "-framerate", "25", "-i"])
                .arg(input)
                .args(["-c:v", "copy"])
                .arg(rig.path(&format!("{camera}.mkv")))
                .status();
            assert!(encoded.unwrap().success());
        }
        let table = |camera: &str| {
            format!("video = \"{camera}.mkv\"\n{settings}\ncalibration = \"cameras.json\"\n")
        };
        rig.replace("cam2", &table("cam2"));
        if !settings.is_empty() {
            rig.replace("cam1", &table("cam1"));
            rig.leave_out("cam3");
            rig.leave_out("cam4");
        }
        let ffmpeg = ffmpeg.display().to_string();
        let text = format!(
            "#!/bin/sh\ncase \"$*\" in *'-h long'*) exec {ffmpeg} \"$@\";; *cam1*) exec {ffmpeg} \"$@\";; esac\n{}\n",
            script.replace("FFMPEG", &ffmpeg)
        );
        fs::create_dir(rig.path("bin")).unwrap();
        fs::write(rig.path("bin/ffmpeg"), text).unwrap();
        let runnable = fs::Permissions::from_mode(0o755);
        fs::set_permissions(rig.path("bin/ffmpeg"), runnable).unwrap();
        Some(rig)
    }

    fn track(rig: &Rig) -> Run {
        let path = std::env::var("PATH").unwrap();
        let bin = rig.path("bin");
        let mut command = rig.command(&rig.scene(""), &["-o", "out", "--no-plots"]);
        Run::of(command.env("PATH", format!("{}:{path}", bin.display())))
    }

    #[test]
    fn a_camera_whose_ffmpeg_fails_does_not_stop_the_others() {
        let script = "FFMPEG \"$@\" | head -c 4000000; echo '[fatal] unplugged' >&2; exit 9";
        let Some(rig) = rig_with_video("", script) else {
            return;
        };
        let run = track(&rig);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let message = "warning: cameras.cam2: stopped: cam2.mkv: ffmpeg failed (exit status: 9)";
        assert!(run.stderr.starts_with(message), "{}", run.stderr);
        assert!(run.stderr.contains("[fatal] unplugged"), "{}", run.stderr);
        rig.assert_followed();
        let stopped = &rig.summary()["cameras"]["cam2"]["stopped"];
        let time_s = stopped["time_s"].as_f64().unwrap();
        assert!((0.5..4.0).contains(&time_s), "{stopped}");
        assert!(
            stopped["reason"]
                .as_str()
                .unwrap()
                .contains("exit status: 9")
        );
    }

    #[test]
    fn the_decoding_speed_of_a_recording_changes_nothing() {
        let tracks = |script: &str| {
            let rig = rig_with_video("", script)?;
            track(&rig).fine();
            rig.assert_followed();
            Some(rig.tracks())
        };
        let at_once = tracks("exec FFMPEG \"$@\"");
        let slowly = "FFMPEG \"$@\" | { head -c 4000000; sleep 1; cat; }";
        assert!(tracks(slowly) == at_once);
    }

    /// Live: read at the rate of the recording. The second camera delivers some frames, then neither frames nor an end.
    #[test]
    fn a_silent_live_camera_does_not_stop_the_other() {
        let script = "FFMPEG \"$@\" | head -c 4000000; exec sleep 1000";
        let settings = "input.real_time = true\ninput.when_behind = \"wait\"";
        let Some(rig) = rig_with_video(settings, script) else {
            return;
        };
        let mut child = {
            let path = std::env::var("PATH").unwrap();
            let bin = rig.path("bin");
            // Each counts from its own start, and the second one starts later.
            let scene = rig.scene("[timing]\nmax_delay_s = 3\n");
            let mut command = rig.command(&scene, &["-o", "out", "--no-plots"]);
            command.env("PATH", format!("{}:{path}", bin.display()));
            command.spawn().unwrap()
        };
        // The first one has delivered all frames once its last row exists.
        let has_ended = || {
            let tracks = fs::read_to_string(rig.path("out/tracks.csv")).unwrap_or_default();
            tracks.contains(",4.76,ball")
        };
        for _ in 0..600 {
            if has_ended() {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        let all_came = has_ended();
        let stop = format!("kill -INT {}", child.id());
        assert!(
            Command::new("/bin/sh")
                .args(["-c", &stop])
                .status()
                .unwrap()
                .success()
        );
        assert_eq!(child.wait().unwrap().code(), Some(0));
        assert!(all_came, "the silent camera stopped the other");
        let rows = rows_in(&rig.tracks());
        assert!(rows.len() >= FRAMES, "{}", rows.len());
        let (first, second) = (rig.frames("cam1"), rig.frames("cam2"));
        assert!(first["used"].as_u64().unwrap() > 100, "{first}");
        let used = second["used"].as_u64().unwrap();
        assert!((5..60).contains(&used), "{second}");
    }
}
