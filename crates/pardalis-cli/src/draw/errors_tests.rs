//! Tests of the figures of errors; they are left in `draw-tests` beside the test program.

use super::*;
use crate::draw::test_folder;
use crate::source::decode::decode_image;

/// Errors with a bias that grows with distance.
fn group(name: &str, bias_m: f64) -> ErrorGroup {
    let errors = (0..40).map(|i| {
        let distance_m = 0.5 + 0.08 * f64::from(i);
        let noise = (37.0 * f64::from(i)).sin();
        SphericalError {
            distance_m,
            distance_error_m: bias_m * distance_m + 0.05 * noise,
            elevation_error_rad: 0.01 * noise + 0.03 / distance_m,
            azimuth_error_rad: 0.008 * (53.0 * f64::from(i)).cos() / distance_m,
        }
    });
    ErrorGroup {
        name: name.to_owned(),
        errors: errors.collect(),
    }
}

fn drawn(stem: &str, groups: &[ErrorGroup]) -> String {
    let folder = test_folder("errors");
    let files = write_error_figures(&folder, stem, groups).unwrap();
    let names = ["svg", "png"].map(|format| folder.join(format!("{stem}-errors.{format}")));
    assert_eq!(files, names);
    assert!(decode_image(&files[1]).is_ok());
    let svg = std::fs::read_to_string(&files[0]).unwrap();
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    svg
}

fn count(svg: &str, color: &str) -> usize {
    let lines = svg.lines().filter(|line| line.contains("<polyline"));
    lines.filter(|line| line.contains(color)).count()
}

#[test]
fn each_error_has_a_mark_in_each_panel() {
    let groups = [group("on the floor", 0.02), group("0.34 m above it", -0.03)];
    let svg = drawn("static", &groups);
    // Three panels with 40 marks and a mean each, and the legend's mark.
    assert_eq!(count(&svg, "#0072B2"), 3 * 41 + 1);
    assert_eq!(count(&svg, "#D55E00"), 3 * 41 + 1);
    for text in [
        "on the floor",
        "0.34 m above it",
        "distance error (mm)",
        "elevation error (mrad)",
        "azimuth error (mrad)",
    ] {
        assert!(svg.lines().any(|line| line == text), "{text}");
    }
    assert!(!svg.contains("outside"));
}

#[test]
fn wild_errors_are_left_out_and_counted_in_a_note() {
    let mut groups = [group("floor", 0.02), group("air", 0.0), group("far", 0.01)];
    groups[0].errors[3].distance_error_m = 40.0;
    groups[1].errors[3].azimuth_error_rad = f64::NAN;
    let svg = drawn("wild", &groups);
    assert_eq!(svg.matches("1 of 119 estimates are outside").count(), 1);
}

#[test]
fn empty_and_single_groups_are_drawn() {
    assert!(drawn("nothing", &[]).contains("no estimate"));
    let mut one = group("one", 0.0);
    one.errors.truncate(1);
    drawn("one", &[one]);
}

#[test]
fn means_cover_equal_parts_of_the_distance() {
    let points: Vec<[f64; 2]> = (0..8).map(|i| [f64::from(i), f64::from(i * i)]).collect();
    assert_eq!(means(&points), [[1.5, 3.5], [5.5, 31.5]]);
    assert_eq!(means(&[[2.0, 1.0]]), [[2.0, 1.0]]);
    assert!(means(&[]).is_empty());
}
