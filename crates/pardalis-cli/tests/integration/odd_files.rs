//! Things that are called like images but are none, images that claim to be huge, and names with control characters.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{Run, SCENE, Workplace, frame_file, scene_with};

fn located(place: &Workplace, images: &[&str]) -> Run {
    place.write("scene.toml", SCENE);
    let arguments = ["locate", "scene.toml", "-o", "located"];
    Run::pardalis(place.path(""), &[&arguments, images].concat())
}

#[cfg(unix)]
#[test]
fn links_folders_and_pipes_among_images_are_named() {
    let place = Workplace::with_frames(3);
    std::os::unix::fs::symlink("nowhere.jpg", place.image(3)).unwrap();
    fs::create_dir(place.image(4)).unwrap();
    let made = Command::new("mkfifo").arg(place.image(5)).status();
    assert!(made.unwrap().success());
    let run = place.track(SCENE);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(place.rows().len(), 3);
    let wanted = [
        "images/000003.jpg: is a link to a file that does not exist",
        "images/000004.jpg: is a folder",
        "images/000005.jpg: is a pipe or a device",
    ];
    let start = "warning: cameras.cam1: left out a broken image: ";
    for (line, wanted) in run.stderr.lines().zip(wanted) {
        assert!(line.starts_with(&format!("{start}{wanted}")), "{line}");
    }
    for (image, wanted) in [
        "images/000003.jpg",
        "images/000004.jpg",
        "images/000005.jpg",
    ]
    .into_iter()
    .zip(wanted)
    {
        // A pipe must not keep the program waiting.
        located(&place, &["images/000000.jpg", image]).refused(&[wanted]);
    }
    assert!(!place.path("located").exists());
}

#[cfg(unix)]
#[test]
fn tables_without_an_end_are_refused() {
    let place = Workplace::with_frames(1);
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    command.args(["evaluate", "/dev/zero", "/dev/zero"]);
    Run::of(command.current_dir(place.path(""))).refused(&["/dev/zero: is a device"]);
}

#[test]
fn a_missing_image_is_an_error() {
    let place = Workplace::with_frames(1);
    let whole = frame_file(0);
    located(&place, &[whole.to_str().unwrap(), "missing.jpg"])
        .refused(&["missing.jpg: cannot be read: there is no such file; check the name"]);
}

#[test]
fn a_small_file_with_a_huge_image_is_refused_by_its_header() {
    let place = Workplace::with_frames(0);
    let mut huge = pardalis_images::encode_png(&pardalis_images::RgbImage::new(4, 4)).unwrap();
    huge[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    place.write("images/000000.png", huge);
    place.track(SCENE).refused(&[
        "line 3: cameras.cam1.images",
        "000000.png: the image is 16384 x 16384 pixels; at most 67108864 in all are supported",
    ]);
    let long = fs::File::create(place.path("images/000000.png")).unwrap();
    long.set_len(1 << 40).unwrap();
    place
        .track(SCENE)
        .refused(&["000000.png: has 1099511627776 bytes; allowed for an image: at most"]);
}

#[cfg(unix)]
#[test]
fn control_characters_in_names_do_not_reach_the_terminal() {
    let place = Workplace::with_frames(1);
    for forged in [
        "images = \"none\\nerror: x\"\nfps = 25",
        "images = \"images\"\nfps = 25\n\"k\\nerror: x\" = 1",
    ] {
        let run = place.track(scene_with("images = \"images\"\nfps = 25", forged));
        run.refused(&["\\nerror: x"]);
        assert!(!run.stderr.contains("\nerror: x"), "{}", run.stderr);
    }
    let name = "a\u{1b}[2J\u{202e}b.toml";
    place.write(name, "seed");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let run = Run::of(command.args(["track", name]).current_dir(place.path("")));
    run.refused(&["error: a\\u{1b}[2J\\u{202e}b.toml: a problem in the scene"]);
    assert!(
        run.stderr.chars().all(|c| c == '\n' || !c.is_control()),
        "{:?}",
        run.stderr
    );
    place.write("images/\u{1b}]0;x\u{7}.jpg", "none");
    let run = place.track(SCENE);
    assert!(
        run.stderr.contains("\\u{1b}]0;x\\u{7}.jpg"),
        "{:?}",
        run.stderr
    );
    assert!(
        run.stderr.chars().all(|c| c == '\n' || !c.is_control()),
        "{:?}",
        run.stderr
    );
}

#[cfg(unix)]
#[test]
fn line_ends_in_names_of_files_are_shown() {
    let place = Workplace::with_frames(2);
    place.write("images/a\nerror: forged.jpg", "none");
    fs::create_dir(place.path("odd")).unwrap();
    fs::copy(place.image(0), place.path("odd/a\nerror: forged.jpg")).unwrap();
    place.write("scene.toml", SCENE);
    let forged = "gone\nerror: forged";
    for arguments in [
        &["track", "scene.toml", "-o", "out"][..],
        &["track", "scene.toml", "-o", "out\nerror: forged"],
        &["track", forged],
        &["check", forged],
        &["locate", "scene.toml", forged],
        &["evaluate", forged, "truth.csv"],
        &["init", forged],
        &["init", "images", "-o", "scene\nerror: forged"],
        &["camera", "show", forged],
        &["learn", "odd", "--masks", "_mask.png", "-o", "a.toml"],
        &[
            "learn", "--image", forged, "--rect", "1,2,3,4", "-o", "a.toml",
        ],
        &[
            "calibrate",
            "board",
            "odd",
            "--board",
            "checkerboard:9x6:0.02",
            "--model",
            "pinhole",
        ],
        &[
            "calibrate",
            "board",
            "images",
            "--board",
            "checkerboard:9x6:0.02",
            "--model",
            "pinhole",
        ],
        &["measure", forged],
        &["simulate", forged, "-o", "ring"],
        &["rectify", forged],
    ] {
        let run = Run::pardalis(place.path(""), arguments);
        let printed = run.stdout + &run.stderr;
        let is_forged = |line: &str| line.trim_start().starts_with("error: forged");
        assert!(!printed.lines().any(is_forged), "{arguments:?}: {printed}");
        assert!(
            printed.contains("\\nerror: forged"),
            "{arguments:?}: {printed}"
        );
    }
}

#[test]
fn messages_show_names_of_files_in_one_line() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![source];
    let mut files = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() {
                // Messages of failed tests.
                if !name.ends_with("tests") && name != "fuzzing" {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|ending| ending == "rs")
                && !name.ends_with("tests.rs")
                && name != "output.rs"
            {
                let text = fs::read_to_string(&path).unwrap();
                let (program, _) = text.split_once("#[cfg(test)]").unwrap_or((&text, ""));
                assert!(
                    !program.contains(".display()"),
                    "{}: `shown` of crate::output escapes line ends",
                    path.display()
                );
                files += 1;
            }
        }
    }
    assert!(files > 100, "{files}");
}

#[test]
fn a_small_video_with_huge_frames_is_refused() {
    let place = Workplace::with_frames(0);
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-f", "lavfi", "-i", "color=size=9000x8000"])
        .args(["-frames:v", "1", "-c:v", "png", "huge.mkv"])
        .status();
    if !encoded.is_ok_and(|status| status.success()) {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    let video = |input: &str| {
        let lines = format!("video = \"{input}\"");
        scene_with("images = \"images\"\nfps = 25", &lines)
    };
    place.track(video("huge.mkv")).refused(&[
        "line 3: cameras.cam1.video: huge.mkv: ",
        "more than 67108864 pixels",
    ]);
    let input = fs::File::open(place.path("huge.mkv")).unwrap();
    let mut command = place.command(video("-"), &["-o", "out"]);
    let run = Run::of(command.stdin(input));
    run.refused(&["line 3: cameras.cam1.video: standard input: ", "67108864"]);
}
