//! `pardalis track` on hostile input: every error in the user's input ends with exit code 2 and a message that names
//! the file, the key or line, the problem and the allowed values; rows written before stay complete.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::common::run::{interrupt, wait_for_lines};
use crate::common::{Run, SCENE, Workplace, frame_file, rows_in, scene_with};

use pardalis_images::{GrayImage, JpegSampling, RgbImage, encode_jpeg, encode_png};

/// A PNG file that consists only of its header and its end.
fn png_of_size(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
    bytes.extend(width.to_be_bytes());
    bytes.extend(height.to_be_bytes());
    bytes.extend(b"\x08\x02\0\0\0\0\0\0\0\0\0\0\0IEND\xae\x42\x60\x82");
    bytes
}

/// A frame whose header states another size.
fn jpeg_of_size(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = fs::read(frame_file(0)).unwrap();
    let marker = bytes.windows(2).position(|b| b == [0xFF, 0xC0]).unwrap();
    bytes[marker + 5..marker + 7].copy_from_slice(&height.to_be_bytes());
    bytes[marker + 7..marker + 9].copy_from_slice(&width.to_be_bytes());
    bytes
}

fn grey_png(place: &Workplace, name: &str, width: u32, height: u32, grey: u8) {
    let image = GrayImage::from_pixel(width, height, [grey]);
    fs::write(place.path(name), encode_png(&image).unwrap()).unwrap();
}

#[test]
fn a_broken_image_is_skipped_and_reported() {
    let whole = fs::read(frame_file(3)).unwrap();
    let small = encode_jpeg(&RgbImage::new(320, 240), 75, JpegSampling::Automatic).unwrap();
    let cases: [(&str, Vec<u8>, &str); 9] = [
        ("cut off", whole[..whole.len() / 2].to_vec(), "cut off"),
        ("cut header", whole[..100].to_vec(), "cut off"),
        ("one byte", vec![0xFF], "not a JPEG or PNG"),
        ("empty", Vec::new(), "0 bytes"),
        ("no pixels", jpeg_of_size(0, 0), "no pixels (0 x 0)"),
        ("another size", small, "320 x 240"),
        ("text", b"hello".to_vec(), "not a JPEG or PNG"),
        ("huge JPEG", jpeg_of_size(60_000, 60_000), "at most 16384"),
        ("huge PNG", png_of_size(60_000, 60_000), "at most 16384"),
    ];
    for (name, bytes, wanted) in cases {
        let place = Workplace::with_frames(5);
        fs::write(place.image(3), bytes).unwrap();
        let run = place.track(SCENE);
        assert_eq!(run.code, Some(0), "{name}: {}", run.stderr);
        let start = "warning: cameras.cam1: left out a broken image: ";
        assert!(run.stderr.starts_with(start), "{}", run.stderr);
        for wanted in ["000003.jpg", wanted] {
            assert!(run.stderr.contains(wanted), "{name}: {}", run.stderr);
        }
        let numbers: Vec<String> = place.rows().iter().map(|row| row[0].clone()).collect();
        assert_eq!(numbers, ["0", "1", "2", "4"], "{name}");
        let summary = fs::read_to_string(place.path("out/summary.json")).unwrap();
        assert!(summary.contains("\"broken\": 1"), "{summary}");
    }
    // The first image with a valid header determines the size.
    let place = Workplace::with_frames(3);
    fs::write(place.image(0), png_of_size(60_000, 60_000)).unwrap();
    let run = place.track(SCENE);
    assert_eq!((run.code, place.rows().len()), (Some(0), 2));
    assert!(run.stderr.contains("60000 x 60000"), "{}", run.stderr);
    // Without any valid header nothing runs; without any decodable image nothing is tracked.
    for number in 1..3 {
        fs::write(place.image(number), "no image").unwrap();
    }
    place
        .track(SCENE)
        .refused(&["scene.toml", "line 3", "000000.jpg", "60000 x 60000"]);
    for number in 0..3 {
        fs::write(place.image(number), png_of_size(640, 480)).unwrap();
    }
    place.track(SCENE).refused(&[
        "no frame came from any camera",
        "000000.jpg",
        "000001.jpg",
        "000002.jpg",
    ]);
}

#[test]
fn invalid_masks_are_rejected() {
    let place = Workplace::with_frames(2);
    grey_png(&place, "small.png", 64, 48, 255);
    grey_png(&place, "black.png", 640, 480, 127);
    grey_png(&place, "white.png", 640, 480, 255);
    place.write("text.png", "no image");
    for (mask, wanted) in [
        ("mask = \"small.png\"", &["64 x 48", "640 x 480"][..]),
        (
            "mask = \"black.png\"",
            &["black.png", "white (128 or more)"],
        ),
        ("mask = \"none.png\"", &["none.png", "cannot be read"]),
        ("mask = \"text.png\"", &["text.png", "not a JPEG or PNG"]),
        ("mask = \".\"", &["is a folder"]),
        ("mask_radius_px = 0.1", &["mask_radius_px", "larger radius"]),
        ("mask_radius_px = 0", &["is 0; allowed: above 0"]),
        ("mask_radius_px = nan", &["is nan; allowed: a finite"]),
        (
            "mask_radius_px = 9\nmask_center_px = [1e308, 0]\nmask = \"white.png\"",
            &["mask_radius_px", "mask_center_px"],
        ),
        ("mask_center_px = [1, 2]", &["needs mask_radius_px"]),
        ("size_px = [320, 240]", &["320 x 240", "640 x 480"]),
    ] {
        let scene = scene_with("fps = 25", &format!("fps = 25\n{mask}"));
        let run = place.track(scene);
        run.refused(&["scene.toml", "line 5: cameras.cam1."]);
        run.refused(wanted);
    }
}

#[test]
fn invalid_times_are_rejected() {
    let place = Workplace::with_frames(3);
    let scene = scene_with("fps = 25\n", "");
    let refused_times = |text: &str, wanted: &[&str]| {
        place.write("images/times.csv", text);
        let run = place.track(&scene);
        run.refused(&["scene.toml", "line 3: cameras.cam1.images: ", "times.csv"]);
        run.refused(wanted);
    };
    for time in ["nan", "inf", "-inf", "1e308", "1e400", "", "soon", "1,5"] {
        let text = format!("frame,time_s\n0,0\n1,{time}\n2,0.08\n");
        refused_times(
            &text,
            &[
                "line 3",
                if time == "1,5" {
                    "decimal points, not commas"
                } else {
                    "number of seconds"
                },
            ],
        );
    }
    refused_times(
        "frame,time_s,arrival_s\n0,0,0\n1,0.04,late\n2,0.08,0.08\n",
        &[
            "line 3",
            "arrival_s is \"late\"; it must be a number of seconds",
        ],
    );
    refused_times(
        "frame,time_s\n0,0\n1,0.04\n1,0.08\n2,0.1\n",
        &["line 4", "frame 1 occurs twice"],
    );
    refused_times(
        "frame,time_s\n0,0\n2,0.04\n1,0.08\n",
        &["line 4", "frames must ascend"],
    );
    refused_times(
        "frame,time_s\n0,0\n-1,0.04\n",
        &["line 3", "whole number from 0"],
    );
    refused_times(
        "frame,time_s\n0,0\n99999999999999999999,0.04\n",
        &["line 3", "whole number from 0"],
    );
    refused_times(
        "frame,time_s\n0,0\n2,0.04\n",
        &["no row for frame 1 (000001.jpg)"],
    );
    refused_times("", &["line 1", "no column frame"]);
    refused_times("time_s,number\n0,0\n", &["line 1", "no column frame"]);
    refused_times("frame,time_s\n0,0\n\u{0}\u{1}\n", &["line 3"]);

    let run = place.track(SCENE);
    run.refused(&[
        "line 3: cameras.cam1.images",
        "times.csv",
        "gives fps; keep one",
    ]);
    fs::remove_file(place.path("images/times.csv")).unwrap();
    place
        .track(&scene)
        .refused(&["line 3: cameras.cam1.images", "give fps"]);

    // A gap in the numbers that is too long for time stamps.
    fs::copy(frame_file(3), place.path("images/9223372036854775807.jpg")).unwrap();
    place.track(SCENE).refused(&[
        "line 3: cameras.cam1.images",
        "9223372036854775807.jpg",
        "its time_s is",
        "at most 1e12",
    ]);
}

#[test]
fn unwritable_outputs_are_reported() {
    let place = Workplace::with_frames(2);
    place.write("file", "mine");
    place
        .track_with(SCENE, &["-o", "file"])
        .refused(&["-o file: this is a file; give a folder"]);
    place
        .track_with(SCENE, &["-o", "file/below"])
        .refused(&["file/below: cannot be written", "choose an existing folder"]);
    assert_eq!(fs::read(place.path("file")).unwrap(), b"mine");
    fs::create_dir_all(place.path("out/tracks.csv")).unwrap();
    place
        .track(SCENE)
        .refused(&["out/tracks.csv: cannot be written"]);
    if cfg!(target_os = "linux") {
        let full = fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let run = Run::of(place.command(SCENE, &["-o", "-"]).stdout(full));
        assert_eq!(run.code, Some(1));
        assert!(
            run.stderr
                .starts_with("error: standard output: cannot be written: the disk is full"),
            "{}",
            run.stderr
        );
    }
}

#[test]
fn a_closed_pipe_ends_the_run_quietly() {
    let place = Workplace::with_frames(12);
    for lines in [0, 1, 3] {
        let mut child = place
            .command(SCENE, &["-o", "-"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut reader = BufReader::new(child.stdout.take().unwrap());
        for _ in 0..lines {
            reader.read_line(&mut String::new()).unwrap();
        }
        drop(reader);
        let output = child.wait_with_output().unwrap();
        assert_eq!(
            (output.status.code(), &output.stderr[..]),
            (Some(0), &b""[..]),
            "{lines} lines"
        );
    }
    // The final report needs no reader either.
    let mut child = place
        .command(SCENE, &["-o", "out", "--no-plots"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(
        (output.status.code(), &output.stderr[..]),
        (Some(0), &b""[..])
    );
    assert_eq!(place.rows().len(), 12);
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_the_rows_and_is_reported() {
    let place = Workplace::with_frames(1);
    // Hard links to one image: a long sequence that needs little space.
    for number in 1..500 {
        fs::hard_link(place.image(0), place.image(number)).unwrap();
    }
    let scene = scene_with("particles = 100", "particles = 20000");
    let mut child = place
        .command(scene, &["-o", "out", "--no-plots"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let tracks = place.path("out/tracks.csv");
    wait_for_lines(&mut child, &tracks, 4);
    let run = interrupt(child);
    let rows = place.rows().len();
    assert!((3..500).contains(&rows), "{rows}");
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        run.stderr
            .starts_with(&format!("error: interrupted after {rows} frames")),
        "{}",
        run.stderr
    );
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("out/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["interrupted"], true);
    assert_eq!(summary["frame_sets"], rows);
}

#[test]
fn results_of_an_earlier_run_are_replaced_completely() {
    let place = Workplace::with_frames(6);
    place.track(SCENE).fine();
    assert_eq!(place.rows().len(), 6);
    place
        .track(scene_with("fps = 25", "fps = 25\nframe_limit = 2"))
        .fine();
    assert_eq!(place.rows().len(), 2);
    // A scene that is rejected leaves them unchanged.
    place.track("seed = 0").refused(&["cameras"]);
    assert_eq!(place.rows().len(), 2);
    place.write("out/tracks.csv", "x".repeat(100_000));
    place.track(SCENE).fine();
    assert_eq!(place.rows().len(), 6);
}

#[test]
fn videos_without_ffmpeg_or_truncated_are_reported() {
    let place = Workplace::with_frames(10);
    let video = scene_with("images = \"images\"\nfps = 25", "video = \"cut.mkv\"");
    let without = Run::of(place.command(&video, &["-o", "-"]).env("PATH", ""));
    without.refused(&[
        "scene.toml",
        "line 3: cameras.cam1.video: ",
        "ffmpeg",
        "install the ffmpeg package",
    ]);

    let installed = Command::new("ffmpeg")
        .arg("-version")
        .output()
        .is_ok_and(|o| o.status.success());
    if !installed {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    place
        .track(&video)
        .refused(&["line 3: cameras.cam1.video: cut.mkv", "ffprobe"]);
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args([
            "-v",
            "error",
            "-framerate",
            "25",
            "-i",
            "images/%06d.jpg",
            "-c:v",
            "copy",
            "whole.mkv",
        ])
        .status()
        .unwrap();
    assert!(encoded.success());
    let whole = fs::read(place.path("whole.mkv")).unwrap();
    for share in [0, 10] {
        place.write("cut.mkv", &whole[..whole.len() * share / 1000]);
        place
            .track(&video)
            .refused(&["cut.mkv: ff", "check the", "messages:"]);
    }
    // Truncated between frames: the earlier frames are tracked, and ffmpeg's messages are passed on.
    place.write("cut.mkv", &whole[..whole.len() * 7 / 10]);
    let run = place.track(&video);
    let rows = place.rows().len();
    assert!((5..10).contains(&rows), "{rows} rows, {}", run.stderr);
    assert_eq!(run.code, Some(0));
    let warning = "warning: cameras.cam1: ffmpeg reported 1 errors in cut.mkv";
    assert!(run.stderr.starts_with(warning), "{}", run.stderr);
    place.write("cut.mkv", &whole);
    let run = place.track_with(&video, &["-o", "-"]).fine();
    assert_eq!(rows_in(&run.stdout).len(), 10);
    // A container that says first how many frames there are.
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-i", "whole.mkv", "-c", "copy"])
        .args(["-movflags", "+faststart", "whole.mp4"])
        .status();
    assert!(encoded.unwrap().success());
    let whole = fs::read(place.path("whole.mp4")).unwrap();
    place.write("cut.mp4", &whole[..whole.len() * 7 / 10]);
    let run = place.track(video.replace("cut.mkv", "cut.mp4"));
    let warning = "warning: cameras.cam1: 10 frames were announced, and ";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
}
