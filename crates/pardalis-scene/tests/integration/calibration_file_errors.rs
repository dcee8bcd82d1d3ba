//! Unsupported and contradictory calibration files yield errors with a line and a name, never a panic or a wrong camera.
//! Damaged ones are tried in `pardalis-cli`, with those of all other readers.

use pardalis_camera::formats::{Lens, MAX_TEXT_BYTES};
use pardalis_scene::calibration::read;

use crate::samples::sample;

/// Checks each line of refusals.txt: a sample with pieces of it replaced, and parts of the expected message.
#[test]
fn unsupported_and_contradictory_files_are_rejected_by_name() {
    let mut count = 0;
    for case in sample("refusals.txt").lines().skip(1) {
        let fields: Vec<String> = case.split(" | ").map(|f| f.replace("\\n", "\n")).collect();
        let [name, edits @ .., wanted] = &fields[..] else {
            panic!("{case}");
        };
        let mut text = sample(name);
        for edit in edits {
            let (piece, other) = edit.split_once(" =>").unwrap();
            assert!(text.contains(piece), "{name} has no {piece}");
            text = text.replacen(piece, other.strip_prefix(' ').unwrap_or(other), 1);
        }
        let Err(error) = read(&text, None) else {
            panic!("not rejected: {case}");
        };
        let message = error.to_string();
        assert!(message.starts_with("line "), "{message}");
        for part in wanted.split(" ... ") {
            assert!(message.contains(part), "no {part:?} in: {message}");
        }
        count += 1;
    }
    assert!(count > 60, "{count}");
    let contradiction = read(&sample("opencv-fisheye.yml"), Some(Lens::Pinhole)).unwrap_err();
    let wanted = "belongs to a fisheye camera according to the file";
    assert!(contradiction.to_string().contains(wanted));
}

#[test]
fn texts_that_are_not_calibrations_or_too_large_are_rejected() {
    let bomb: Vec<String> = (1..40)
        .map(|i| format!("a{i}: &a{i} [*a{0}, *a{0}]\n", i - 1))
        .collect();
    let bomb = format!("a0: &a0 [x, x]\n{}", bomb.concat());
    let entities = "<?xml version=\"1.0\"?><!DOCTYPE x [<!ENTITY a \"aa\"><!ENTITY b \"&a;&a;\">]><opencv_storage>&b;</opencv_storage>";
    let camera = "  camera_model: pinhole\n  intrinsics: [1, 1, 0, 0]\n  distortion_model: none\n  distortion_coeffs: []\n  \
                  T_cam_imu: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n";
    let cameras: Vec<String> = (0..70).map(|i| format!("cam{i}:\n{camera}")).collect();
    let cases: [(String, &str); 13] = [
        (String::new(), "the calibration format is not recognised"),
        (
            "# a comment\n".to_owned(),
            "the calibration format is not recognised",
        ),
        (
            "- 1\n- 2\n".to_owned(),
            "the calibration format is not recognised",
        ),
        ("[".repeat(100_000), "line 1"),
        (
            format!("a: {}{}", "{b: ".repeat(5_000), "}".repeat(5_000)),
            "line 1",
        ),
        (
            format!("<opencv_storage>{}", "<a>".repeat(100_000)),
            "line 1",
        ),
        (
            format!(
                "<opencv_storage>{}{}</opencv_storage>",
                "<a>".repeat(5_000),
                "</a>".repeat(5_000)
            ),
            "elements are nested too deeply",
        ),
        (entities.to_owned(), "XML"),
        (bomb, "line "),
        (format!("K: [{}]", "1,".repeat(1_000_000)), "line 1"),
        ("x".repeat(MAX_TEXT_BYTES + 1), "bytes; allowed: at most"),
        (cameras.concat(), "contains 70 cameras; allowed: at most 64"),
        (
            "[cameras.a]\nmodel.pinhole = { f_px = [1, 1] }\nsize_px = [0, 4]\n".to_owned(),
            "line 2: cameras.a.model.pinhole.center_px: is missing",
        ),
    ];
    for (text, wanted) in cases {
        let message = read(&text, None).unwrap_err().to_string();
        let start: String = text.chars().take(60).collect();
        assert!(message.contains(wanted), "{start}: {message}");
        assert!(message.len() < 2000, "{start}: {message}");
    }
}
