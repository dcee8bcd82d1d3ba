use nalgebra::{Rotation3, Vector3};
use pardalis_camera::Pose;

use super::*;
use crate::draw::test_folder;
use crate::source::decode::decode_image;

fn helix(name: &str, phase: f64) -> TrackSeries {
    let row = |i: u32| {
        let time_s = f64::from(i) * 0.04;
        let sigma_m = 0.02 + 0.05 * (3.0 * time_s).sin().abs();
        Sample {
            time_s,
            position_m: (!(30..40).contains(&i)).then(|| {
                [
                    (time_s + phase).cos() * 1.5,
                    (time_s + phase).sin(),
                    0.5 + 0.3 * (5.0 * time_s).sin().abs(),
                ]
            }),
            covariance_m2: Some([sigma_m * sigma_m, 0.0, 0.0, sigma_m * sigma_m, 0.0, 1e-4]),
            is_seen: true,
        }
    };
    TrackSeries {
        name: name.to_owned(),
        rows: (0..110).map(row).collect(),
    }
}

/// A camera that looks down.
fn camera(name: &str, position_m: [f64; 3]) -> CameraSymbol {
    let down = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    CameraSymbol {
        name: name.to_owned(),
        world_from_camera: Pose::from_parts(position_m.into(), down),
        looks_into_mirror: false,
        way_m: Vec::new(),
    }
}

fn one_row(position_m: Option<[f64; 3]>, covariance_m2: Option<[f64; 6]>) -> TrackSeries {
    let row = Sample {
        time_s: 0.0,
        position_m,
        covariance_m2,
        is_seen: true,
    };
    TrackSeries {
        name: "ball".to_owned(),
        rows: vec![row],
    }
}

/// Checks one file per figure and format, and that each PNG is decodable and not blank.
fn check_files(paths: &[PathBuf]) {
    assert_eq!(paths.len(), 8);
    for path in paths {
        if path.extension().is_some_and(|e| e == "svg") {
            let svg = std::fs::read_to_string(path).unwrap();
            roxmltree::Document::parse(&svg).unwrap();
            assert!(
                !svg.contains("NaN") && !svg.contains("inf"),
                "{}",
                path.display()
            );
        } else {
            let picture = decode_image(path).unwrap();
            assert!(picture.pixels().any(|p| p == [255; 3]));
            assert!(picture.pixels().any(|p| p[0] < 80));
        }
    }
}

#[test]
fn tracks_truth_and_cameras_are_drawn_in_their_colours() {
    let folder = test_folder("plots");
    let series = [helix("ball", 0.0), helix("ball", 0.1), helix("robot", 2.0)];
    let truth = TruthSeries {
        rows: series[0]
            .rows
            .iter()
            .map(|row| (row.time_s, [0.0, row.time_s, 0.5]))
            .collect(),
    };
    let cameras = [
        camera("left", [1.0, 1.0, 1.0]),
        camera("right", [1.02, 1.0, 1.0]),
        camera("top", [-1.0, 0.0, 2.0]),
    ];
    let paths = write_track_plots(&folder, &series, &[truth], &cameras).unwrap();
    check_files(&paths);
    for png in paths
        .iter()
        .filter(|p| p.extension().is_some_and(|e| e == "png"))
    {
        let picture = decode_image(png).unwrap();
        for color in &PALETTE[..2] {
            assert!(picture.pixels().any(|p| p == *color), "{}", png.display());
        }
        assert!(
            !picture.pixels().any(|p| p == PALETTE[2]),
            "one colour per target"
        );
    }
    let above = std::fs::read_to_string(&paths[0]).unwrap();
    let entries = |text: &str| above.lines().filter(|l| *l == text).count();
    assert_eq!(
        (entries("ball"), entries("robot"), entries("truth")),
        (1, 1, 1)
    );
    assert_eq!(
        (entries("left"), entries("right"), entries("top")),
        (1, 1, 1)
    );
}

#[test]
fn degenerate_tracks_make_plots_nevertheless() {
    let nan = f64::NAN;
    let cases: Vec<Vec<TrackSeries>> = vec![
        vec![],
        vec![one_row(None, None)],
        vec![one_row(Some([1.0, 2.0, 3.0]), None)],
        vec![one_row(
            Some([1.0, 2.0, 3.0]),
            Some([1e30, 0.0, 0.0, -1.0, 0.0, nan]),
        )],
        vec![one_row(Some([nan, f64::INFINITY, 3.0]), None)],
        vec![
            one_row(Some([1e300, -1e300, 0.0]), None),
            helix("ball", 0.0),
        ],
        vec![
            one_row(Some([1e5, 0.0, 0.0]), None),
            one_row(Some([-1e5, 1e-9, 0.0]), None),
        ],
        vec![TrackSeries {
            name: "<\u{1}&".repeat(40),
            rows: (0..5)
                .map(|i| Sample {
                    time_s: 1.7e9 + f64::from(i) * 1e-7,
                    position_m: Some([5.0, 5.0 + f64::from(i) * 1e-12, -0.0]),
                    covariance_m2: Some([0.0; 6]),
                    is_seen: true,
                })
                .collect(),
        }],
    ];
    for (i, series) in cases.into_iter().enumerate() {
        let folder = test_folder(&format!("plots-degenerate-{i}"));
        check_files(&write_track_plots(&folder, &series, &[], &[]).unwrap());
    }
    let folder = test_folder("plots-nowhere");
    let nowhere = [camera("c", [nan; 3])];
    let truth = [TruthSeries {
        rows: vec![(nan, [0.0; 3])],
    }];
    check_files(&write_track_plots(&folder, &[], &truth, &nowhere).unwrap());
}

#[test]
fn many_targets_fit_the_legend() {
    let folder = test_folder("plots-many");
    let series: Vec<_> = (0..60)
        .map(|i| helix(&format!("ball {i}"), 0.1 * f64::from(i)))
        .collect();
    check_files(&write_track_plots(&folder, &series, &[], &[]).unwrap());
}

#[test]
fn a_circle_is_as_wide_as_high() {
    let rows = (0..=90).map(|i| {
        let angle_rad = f64::from(i) * std::f64::consts::TAU / 90.0;
        (
            f64::from(i),
            [100.0 + 2.0 * angle_rad.cos(), 2.0 * angle_rad.sin(), 0.0],
        )
    });
    let truth = [TruthSeries {
        rows: rows.collect(),
    }];
    let folder = test_folder("plots-circle");
    let paths = write_track_plots(&folder, &[], &truth, &[]).unwrap();
    let svg = std::fs::read_to_string(&paths[0]).unwrap();
    let points = svg
        .lines()
        .filter(|line| line.contains("polyline"))
        .filter_map(|line| line.split("points=\"").nth(1)?.split('"').next())
        .map(|text| text.split_whitespace().collect::<Vec<_>>())
        .max_by_key(Vec::len)
        .unwrap();
    assert_eq!(points.len(), 91);
    let side = |axis: usize| {
        let values = points
            .iter()
            .map(|p| p.split(',').nth(axis).unwrap().parse::<f64>().unwrap());
        let extent = extent(values).unwrap();
        extent.end() - extent.start()
    };
    assert!(side(0) > 1000.0);
    assert!(
        (side(0) - side(1)).abs() < 0.005 * side(0),
        "{} {}",
        side(0),
        side(1)
    );
}

#[test]
fn the_true_path_of_a_thrown_ball_is_drawn() {
    // It bounces twice.
    let rows: Vec<(f64, [f64; 3])> = (0..110)
        .map(|i| {
            let time_s = 0.04 * f64::from(i);
            let since_bounce_s = time_s % 1.5;
            let z_m = 0.11 + since_bounce_s * (7.4 - 4.9 * since_bounce_s);
            (time_s, [1.35 - 0.4 * time_s, -1.25 + 0.6 * time_s, z_m])
        })
        .collect();
    let series = TrackSeries {
        name: "ball".to_owned(),
        rows: rows
            .iter()
            .map(|&(time_s, [x, y, z])| Sample {
                time_s,
                position_m: Some([
                    x + 0.02 * (7.0 * time_s).sin(),
                    y,
                    z + 0.02 * (9.0 * time_s).cos(),
                ]),
                covariance_m2: Some([4e-4, 0.0, 0.0, 9e-4, 0.0, 4e-4]),
                is_seen: true,
            })
            .collect(),
    };
    let cameras = [camera("cam1", [0.0, 0.0, 0.9])];
    let folder = test_folder("plots-jump");
    check_files(&write_track_plots(&folder, &[series], &[TruthSeries { rows }], &cameras).unwrap());
}

#[test]
fn far_cameras_do_not_flatten_the_plots() {
    let plots = |folder: &str, cameras: &[CameraSymbol]| {
        let folder = test_folder(folder);
        let paths = write_track_plots(&folder, &[helix("ball", 0.0)], &[], cameras).unwrap();
        let svgs = paths.iter().step_by(2);
        let svgs: Vec<String> = svgs
            .map(|path| std::fs::read_to_string(path).unwrap())
            .collect();
        svgs.try_into().unwrap()
    };
    let alone: [String; 4] = plots("plots-alone", &[]);
    let far = || camera("far", [100.0, 60.0, 30.0]);
    let one: [String; 4] = plots("plots-far", &[far()]);
    let two: [String; 4] = plots("plots-far-two", &[far(), camera("too", [0.0, 0.0, 80.0])]);
    let near: [String; 4] = plots(
        "plots-far-and-near",
        &[far(), camera("near", [1.0, 1.0, 1.0])],
    );
    let path = |svg: &str| {
        let path = svg
            .lines()
            .find(|line| line.contains("<polyline") && line.contains("stroke-width=\"25\""));
        path.map(str::to_owned)
    };
    for map in 0..3 {
        assert!(one[map].contains("far is 120.2 m away"), "{}", one[map]);
        assert!(
            two[map].contains("2 cameras are 79.4 m away or farther"),
            "{}",
            two[map]
        );
        assert!(
            near[map].contains("far is") && near[map].contains("near"),
            "{}",
            near[map]
        );
        assert_eq!(path(&one[map]), path(&alone[map]));
    }
    for others in [&one, &two, &near] {
        assert_eq!(others[3], alone[3]);
    }
}

#[test]
fn a_target_that_stands_still_is_drawn_over_time() {
    let mut track = helix("ball", 0.0);
    for row in &mut track.rows {
        row.position_m = Some([1.0, 2.0, 0.5]);
        row.time_s = 3.0;
    }
    let folder = test_folder("plots-still");
    let paths = write_track_plots(&folder, &[track], &[], &[]).unwrap();
    let picture = decode_image(&paths[7]).unwrap();
    // Without the legend.
    let plots = picture.crop(0, 0, 1560, picture.height());
    assert!(plots.pixels().any(|p| p == PALETTE[0]));
}

#[test]
fn bands_need_variances() {
    let band = |covariance_m2| {
        point(&one_row(Some([0.0; 3]), covariance_m2).rows[0])
            .unwrap()
            .two_sigma_m
    };
    assert_eq!(band(None), None);
    assert_eq!(
        band(Some([4.0, 9.0, 9.0, 1.0, 9.0, -1e-18])),
        Some([4.0, 2.0, 0.0])
    );
    assert_eq!(band(Some([4.0, 0.0, 0.0, 1.0, 0.0, f64::NAN])), None);
}

#[test]
fn positions_of_occluded_targets_are_pale() {
    let mut track = helix("ball", 0.0);
    let svgs = |track: &TrackSeries, folder: &str| {
        let folder = test_folder(folder);
        let paths = write_track_plots(&folder, std::slice::from_ref(track), &[], &[]).unwrap();
        let paths = paths
            .iter()
            .filter(|path| path.extension() == Some("svg".as_ref()));
        paths
            .map(|path| std::fs::read_to_string(path).unwrap())
            .collect::<Vec<_>>()
    };
    for svg in svgs(&track, "plots-seen") {
        assert!(
            !svg.contains("occluded") && !svg.contains("opacity=\"0.35\""),
            "{svg}"
        );
    }
    for row in &mut track.rows[50..60] {
        row.is_seen = false;
    }
    for svg in svgs(&track, "plots-occluded") {
        assert!(
            svg.contains("occluded") && svg.contains("opacity=\"0.35\""),
            "{svg}"
        );
    }
}

/// Returns points a second apart.
fn points(are_seen: &[bool]) -> Vec<Point> {
    let point = |(time, &is_seen): (usize, &bool)| Point {
        time_s: time as f64,
        position_m: [0.0; 3],
        two_sigma_m: None,
        is_seen,
    };
    are_seen.iter().enumerate().map(point).collect()
}

#[test]
fn tracks_end_where_the_target_was_seen_last() {
    for (are_seen, expected) in [
        (&[true, false, true, false, false][..], Some(2.0)),
        (&[true, true], Some(1.0)),
        (&[false, false], Some(1.0)),
        (&[], None),
    ] {
        let trace = Trace {
            color: PALETTE[0],
            runs: vec![points(are_seen)],
        };
        let (first, last) = trace.ends();
        let start = (!are_seen.is_empty()).then_some(0.0);
        let times = [first, last].map(|point| point.map(|point| point.time_s));
        assert_eq!(times, [start, expected], "{are_seen:?}");
    }
}

#[test]
fn stretches_share_their_ends() {
    let run = points(&[true, true, false, true, true, true]);
    let times = |run: &[Point]| -> Vec<(Vec<f64>, bool)> {
        let stretches = Trace::stretches(run).into_iter();
        let times =
            stretches.map(|(points, seen)| (points.iter().map(|p| p.time_s).collect(), seen));
        times.collect()
    };
    assert_eq!(
        times(&run),
        [
            (vec![0.0, 1.0], true),
            (vec![1.0, 2.0, 3.0], false),
            (vec![3.0, 4.0, 5.0], true)
        ]
    );
    assert_eq!(times(&run[2..3]), [(vec![2.0], false)]);
    assert_eq!(times(&[]), []);
}
