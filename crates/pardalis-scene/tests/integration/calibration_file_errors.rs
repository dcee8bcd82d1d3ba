//! Damaged, unsupported and contradictory calibration files yield errors with a line and a name, never a panic or a
//! wrong camera.

use pardalis_camera::formats::{Lens, MAX_TEXT_BYTES};
use pardalis_scene::calibration::read;
use rayon::prelude::*;

use crate::samples::{SAMPLES, sample};

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

/// Checks that reading returns cameras or an error with a line of the text; reports whether it returned cameras.
fn check(text: &str, lens: Option<Lens>) -> bool {
    match read(text, lens) {
        Ok(cameras) => {
            assert!(!cameras.is_empty());
            true
        }
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with("line "), "{message}");
            let line: usize = message[5..].split(':').next().unwrap().parse().unwrap();
            // In YAML, a lone carriage return also ends a line.
            let last = text.matches(['\n', '\r']).count() + 1;
            assert!((1..=last).contains(&line), "{message}");
            false
        }
    }
}

/// Returns the sample with a few bits flipped, or bytes removed, duplicated, swapped or replaced, depending on the
/// seed.
fn mutated(text: &str, seed: u64) -> String {
    // The generator of Numerical Recipes; any other would do.
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut below = |bound: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % bound
    };
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=below(4) {
        if bytes.is_empty() {
            break;
        }
        let at = below(bytes.len());
        match below(6) {
            0..3 => bytes[at] ^= 1 << below(8),
            3 => {
                let end = (at + 1 + below(20)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let end = (at + 1 + below(20)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = below(bytes.len());
                bytes.splice(to..to, piece);
            }
            _ => bytes[at] = b"0123456789-+.eE:[]{}<>/\"'#&*!,\n \t"[below(33)],
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Reads every truncation of the sample and a number of mutations; returns how many mutations were read as cameras.
fn damage(name: &str, lens: Option<Lens>, mutations: u64) -> usize {
    let text = sample(name);
    (0..text.len()).into_par_iter().for_each(|end| {
        if let Some(start) = text.get(..end) {
            check(start, lens);
        }
    });
    (0..mutations)
        .into_par_iter()
        .filter(|&seed| check(&mutated(&text, seed), lens))
        .count()
}

/// Reads a thousand mutations of each sample. `MUTATIONS=1000000 cargo test --release -p pardalis-scene --test
/// integration mutated -- --nocapture` reads more and prints the counts.
#[test]
fn truncated_and_mutated_samples_are_read_or_rejected() {
    let count = std::env::var("MUTATIONS").map_or(1000, |v| v.parse().unwrap());
    for (name, lens) in SAMPLES {
        let fine = damage(name, lens, count);
        let truncations = sample(name).len();
        println!("{name}: {truncations} truncations, {count} mutations, {fine} of them read");
        // Some mutations change only ignored text or digits, others do not.
        assert!(fine > 0 && (fine as u64) < count, "{name}: {fine}");
    }
}
