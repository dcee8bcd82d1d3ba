//! Tests of the figures of sweeps; they are left in `draw-tests` beside the test program.

use super::*;
use crate::draw::test_folder;
use crate::source::decode::decode_image;

fn series(name: &str, factor: f64, numbered: bool) -> SweepSeries {
    let counts = [100.0, 300.0, 1000.0, 3000.0, 10_000.0];
    let points = counts.map(|count: f64| {
        let median_m = factor * (0.1 + 4.0 / count.sqrt());
        SweepPoint {
            label: format!("{count} particles"),
            value: numbered.then_some(count),
            ms_a_frame: Some(0.01 * factor * count),
            median_m,
            lowest_m: 0.8 * median_m,
            highest_m: 1.6 * median_m,
        }
    });
    SweepSeries {
        name: name.to_owned(),
        points: points.into(),
    }
}

fn drawn(stem: &str, series: &[SweepSeries]) -> String {
    let folder = test_folder("sweep");
    let files = write_sweep_figures(&folder, stem, "number of particles", series).unwrap();
    let names = ["svg", "png"].map(|format| folder.join(format!("{stem}-sweep.{format}")));
    assert_eq!(files, names);
    assert!(decode_image(&files[1]).is_ok());
    let svg = std::fs::read_to_string(&files[0]).unwrap();
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    svg
}

fn lines(svg: &str, text: &str) -> usize {
    svg.lines().filter(|line| *line == text).count()
}

#[test]
fn numbers_make_a_numeric_axis_and_times_a_second_panel() {
    let svg = drawn(
        "numbers",
        &[
            series("3D sampling", 1.0, true),
            series("B-spline", 1.3, true),
        ],
    );
    assert_eq!(lines(&svg, "number of particles"), 1);
    assert_eq!(lines(&svg, "time per frame (ms)"), 1);
    assert_eq!(lines(&svg, "error (mm)"), 2);
    // Logarithmic: at 1000 on one axis and beside a point of each series.
    assert!(lines(&svg, "10000") >= 1 && lines(&svg, "100") >= 1);
    assert_eq!(lines(&svg, "1000 particles"), 2);
    assert_eq!(
        (lines(&svg, "3D sampling"), lines(&svg, "B-spline")),
        (1, 1)
    );
}

#[test]
fn names_make_an_axis_of_names() {
    let mut one = series("jump", 1.0, false);
    for point in &mut one.points {
        point.ms_a_frame = None;
    }
    let svg = drawn("names", &[one]);
    assert_eq!(lines(&svg, "100 particles"), 1);
    assert_eq!(lines(&svg, "time per frame (ms)"), 0);
}

#[test]
fn degenerate_sweeps_are_drawn() {
    assert!(drawn("nothing", &[]).contains("nothing was measured"));
    let mut odd = series("odd", 1.0, true);
    odd.points[0].median_m = f64::NAN;
    odd.points[1].value = Some(f64::INFINITY);
    odd.points[2].lowest_m = 0.0;
    odd.points[3].ms_a_frame = Some(-1.0);
    drawn("odd", &[odd]);
    let mut one = series("one", 0.0, true);
    one.points.truncate(1);
    drawn("one", &[one]);
}
