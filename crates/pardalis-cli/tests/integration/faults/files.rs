//! Empty and huge files wherever a file is read.

use std::fs;
use std::process::Command;

use super::camera::{stand_in, with_stand_in};
use crate::common::{Run, SCENE, Workplace, data, scene_with};
use crate::live::video;

/// Runs a command in the folder, where 2 GB of memory are allowed.
fn run(place: &Workplace, arguments: &[&str]) -> Run {
    let mut command = Command::new("/bin/sh");
    command.args([
        "-c",
        "ulimit -v 2000000; exec \"$0\" \"$@\"",
        env!("CARGO_BIN_EXE_pardalis"),
    ]);
    Run::of(command.args(arguments).current_dir(place.path("")))
}

/// Puts a file in every place where one is read, and checks that each is refused with the name of the file and these words.
#[track_caller]
fn assert_refused_everywhere(place: &Workplace, file: &str, words: [&str; 3]) {
    let [text, image, table] = words;
    let truth = data().join("truth.csv");
    let truth = truth.to_str().unwrap();
    place.write("colors.toml", scene_with("ball.toml", file));
    place.write(
        "mask.toml",
        scene_with("fps = 25", &format!("fps = 25\nmask = \"{file}\"")),
    );
    let calibration = SCENE
        .lines()
        .filter(|line| !line.starts_with("model."))
        .collect::<Vec<_>>()
        .join("\n");
    let calibration =
        calibration.replace("fps = 25", &format!("fps = 25\ncalibration = \"{file}\""));
    place.write("calibration.toml", calibration);
    place.track(SCENE).fine();
    fs::create_dir(place.path("bad")).unwrap();
    fs::copy(place.path("out/tracks.csv"), place.path("bad/tracks.csv")).unwrap();
    std::os::unix::fs::symlink(place.path(file), place.path("bad/summary.json")).unwrap();
    fs::create_dir(place.path("timed")).unwrap();
    fs::copy(place.image(0), place.path("timed/000000.jpg")).unwrap();
    let timed = scene_with("fps = 25\n", "").replace("\"images\"", "\"timed\"");
    place.write("times.toml", timed);
    std::os::unix::fs::symlink(place.path(file), place.path("timed/times.csv")).unwrap();
    for (arguments, wanted) in [
        (&["track", file][..], text),
        (&["track", "colors.toml"], text),
        (&["track", "mask.toml"], image),
        (&["track", "calibration.toml"], text),
        (&["track", "times.toml"], table),
        (&["check", file], text),
        (&["locate", "scene.toml", file], image),
        (&["simulate", file], text),
        (&["measure", file], text),
        (
            &[
                "learn",
                "--image",
                "images/000000.jpg",
                "--mask",
                file,
                "-o",
                "new.toml",
            ],
            image,
        ),
        (
            &[
                "learn", "--image", file, "--rect", "1,1,5,5", "-o", "new.toml",
            ],
            image,
        ),
        (
            &["init", "images", "--camera", file, "-o", "new.toml"],
            image,
        ),
        (
            &[
                "camera",
                "convert",
                file,
                "--to",
                "opencv-yaml",
                "-o",
                "new.yml",
            ],
            text,
        ),
        (&["evaluate", file, truth], table),
        (&["evaluate", "out", file], table),
        (&["evaluate", "bad", truth], text),
    ] {
        let run = run(place, arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
        let name = match arguments[1] {
            "times.toml" => "timed/times.csv",
            "bad" => "bad/summary.json",
            _ => file,
        };
        for wanted in [name, wanted] {
            assert!(
                run.stderr.contains(wanted),
                "{arguments:?}, no {wanted:?}: {}",
                run.stderr
            );
        }
    }
}

#[test]
fn huge_files_are_refused_before_they_fill_the_memory() {
    let place = Workplace::with_frames(1);
    place.write("scene.toml", SCENE);
    let huge = fs::File::create(place.path("huge.jpg")).unwrap();
    // Takes no space.
    huge.set_len(1 << 40).unwrap();
    let text = "has 1099511627776 bytes; allowed: at most 4194304";
    let image = "has 1099511627776 bytes; allowed for an image: at most 268435456";
    let table = "a line has more than 1048576 bytes, so it is not a table";
    assert_refused_everywhere(&place, "huge.jpg", [text, image, table]);
}

#[test]
fn empty_files_are_refused_by_name() {
    let place = Workplace::with_frames(1);
    place.write("scene.toml", SCENE);
    place.write("empty.jpg", "");
    assert_refused_everywhere(&place, "empty.jpg", ["", "", ""]);
    // An empty folder, and an empty video.
    fs::create_dir(place.path("folder")).unwrap();
    let scene = scene_with("images = \"images\"", "images = \"folder\"");
    place
        .track(scene)
        .refused(&["line 3: cameras.cam1.images: folder", "no "]);
    stand_in(&place, "exit 1");
    place.write(
        "probe",
        "echo 'Invalid data found when processing input' >&2; exit 1",
    );
    place.write("empty.mp4", "");
    let command = place.command(video("empty.mp4"), &["-o", "out"]);
    let run = Run::of(&mut with_stand_in(&place, command));
    run.refused(&["line 3: cameras.cam1.video: empty.mp4: ffprobe cannot open it"]);
}
