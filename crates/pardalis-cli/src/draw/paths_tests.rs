//! Tests of the figures of paths; they are left in `draw-tests` beside the test program.

use nalgebra::{Rotation3, Vector3};
use pardalis_camera::Pose;

use super::*;
use crate::draw::plots::Sample;
use crate::draw::test_folder;
use crate::source::decode::decode_image;

const ROWS: u32 = 60;

fn place_m(i: u32) -> [f64; 3] {
    let share = f64::from(i) / f64::from(ROWS);
    let hop = (9.0 * share).sin().abs();
    [1.0 + 2.0 * share, 1.5 - 2.5 * share, 0.1 + 0.8 * hop]
}

/// A run that oscillates about the path and, if `flies_off` is set, is far away at its end.
fn run(seed: u32, flies_off: bool) -> TrackSeries {
    let rows = (0..ROWS).map(|i| {
        let stray_m = 0.05 * f64::from(seed * 7 + i).sin();
        let away_m = if flies_off && i > 55 {
            f64::from(i)
        } else {
            0.0
        };
        let [x, y, z] = place_m(i);
        Sample {
            time_s: 0.04 * f64::from(i),
            position_m: Some([x + stray_m + away_m, y + stray_m, z - 0.5 * stray_m]),
            covariance_m2: None,
            is_seen: true,
        }
    });
    TrackSeries {
        name: "ball".to_owned(),
        rows: rows.collect(),
    }
}

fn group(name: &str, seeds: std::ops::Range<u32>) -> PathGroup {
    PathGroup {
        name: name.to_owned(),
        tracks: seeds.map(|seed| run(seed, false)).collect(),
    }
}

fn truth() -> [TruthSeries; 1] {
    let rows = (0..ROWS).map(|i| (0.04 * f64::from(i), place_m(i)));
    [TruthSeries {
        rows: rows.collect(),
    }]
}

/// A camera on the robot: a fisheye that looks down, or one that looks up into a mirror.
fn camera(looks_into_mirror: bool) -> CameraSymbol {
    let angle = if looks_into_mirror {
        0.0
    } else {
        std::f64::consts::PI
    };
    let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), angle);
    CameraSymbol {
        name: "cam1".to_owned(),
        world_from_camera: Pose::from_parts([0.0, 0.0, 0.9].into(), rotation),
        looks_into_mirror,
        way_m: Vec::new(),
    }
}

/// Returns the documents from above and in the oblique view, after checking that the PNG beside each can be read.
fn drawn(
    stem: &str,
    groups: &[PathGroup],
    truth: &[TruthSeries],
    cameras: &[CameraSymbol],
) -> [String; 2] {
    let folder = test_folder("paths");
    let files = write_path_figures(&folder, stem, groups, truth, cameras, false).unwrap();
    let names = ["top.svg", "top.png", "3d.svg", "3d.png"];
    assert_eq!(
        files,
        names.map(|name| folder.join(format!("{stem}-{name}")))
    );
    for png in [&files[1], &files[3]] {
        let picture = decode_image(png).unwrap();
        assert!(picture.pixels().any(|p| p[0] < 80));
    }
    [0, 2].map(|i| {
        let svg = std::fs::read_to_string(&files[i]).unwrap();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        svg
    })
}

/// Counts the lines with this number of points.
fn lines_of(svg: &str, points: u32) -> usize {
    let lines = svg.lines().filter(|line| line.contains("<polyline"));
    let counts = lines.filter_map(|line| line.split("points=\"").nth(1)?.split('"').next());
    counts
        .filter(|text| text.split_whitespace().count() == points as usize)
        .count()
}

fn has_line(svg: &str, text: &str) -> bool {
    svg.lines().any(|line| line == text)
}

#[test]
fn every_run_is_drawn_with_its_shadows() {
    let groups = [group("unified", 0..10), group("perspective", 10..20)];
    for (stem, mirror) in [("fisheye", false), ("mirror", true)] {
        let [top, oblique] = drawn(stem, &groups, &truth(), &[camera(mirror)]);
        assert_eq!(lines_of(&top, ROWS), 21);
        assert_eq!(lines_of(&oblique, ROWS), 3 * 21);
        // The rim of the mirror.
        assert_eq!(lines_of(&oblique, 49), usize::from(mirror));
        for entry in ["unified", "perspective", "truth", "start", "end", "cam1"] {
            assert!(
                has_line(&top, entry) && has_line(&oblique, entry),
                "{entry}"
            );
        }
        for svg in [&top, &oblique] {
            assert!(!svg.contains("outside"));
        }
        for axis in ["x (m)", "y (m)", "z (m)"] {
            assert!(has_line(&oblique, axis), "{axis}");
        }
    }
}

#[test]
fn a_run_that_flies_off_is_cut_and_counted_in_a_note() {
    let mut groups = [group("offline", 0..10)];
    groups[0].tracks[3] = run(3, true);
    for (stem, truth) in [("astray", &truth()[..]), ("astray-without-truth", &[])] {
        let [top, oblique] = drawn(stem, &groups, truth, &[camera(false)]);
        for svg in [top, oblique] {
            assert!(has_line(&svg, "4 of 600 estimates are outside"));
            // The axes fit the other runs.
            assert!(!has_line(&svg, "20"));
        }
    }
}

#[test]
fn distant_runs_are_shown_if_requested() {
    let mut astray = group("astray", 0..2);
    for row in astray.tracks.iter_mut().flat_map(|track| &mut track.rows) {
        row.position_m = row.position_m.map(|[x, y, z]| [x, y + 20.0, z]);
    }
    let groups = [group("near", 0..2), astray];
    let folder = test_folder("paths-far");
    for (far, outside) in [(false, true), (true, false)] {
        let files = write_path_figures(&folder, "far", &groups, &truth(), &[], far).unwrap();
        let svg = std::fs::read_to_string(&files[0]).unwrap();
        assert_eq!(svg.contains("120 of 240 estimates are outside"), outside);
    }
}

#[test]
fn degenerate_paths_make_figures_nevertheless() {
    let nan = f64::NAN;
    let mut far = group("far", 0..1);
    far.tracks[0].rows[7].position_m = Some([nan, 0.0, f64::INFINITY]);
    far.tracks[0].rows[8].position_m = Some([-1e300, 0.0, 0.0]);
    let mut still = group("still", 0..3);
    for row in still.tracks.iter_mut().flat_map(|track| &mut track.rows) {
        row.position_m = Some([1.0, 2.0, 0.0]);
    }
    let empty = PathGroup {
        name: String::new(),
        tracks: vec![],
    };
    let mut nowhere = camera(true);
    nowhere.world_from_camera.translation.vector.x = nan;
    let nowhere_true = TruthSeries {
        rows: vec![(nan, [nan; 3])],
    };
    let [_, oblique] = drawn("nothing", &[], &[], &[]);
    assert!(has_line(&oblique, "no estimate"));
    drawn("far", &[far], &[], &[]);
    drawn("still", &[still], &[], &[]);
    drawn("nowhere", &[empty], &[nowhere_true], &[nowhere]);
    let high = TruthSeries {
        rows: vec![(0.0, [0.0, 0.0, 5e4]), (1.0, [1.0, 0.0, 5e4])],
    };
    drawn("high", &[], &[high], &[]);
}
