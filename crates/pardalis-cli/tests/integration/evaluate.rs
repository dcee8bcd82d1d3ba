//! `pardalis evaluate` on real sequences, with tracks derived from their truth.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// A folder for the files of one test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("evaluate-{name}"));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file and returns its path.
    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        fs::write(&path, content).unwrap();
        path
    }
}

/// Returns a sequence folder of the repository.
fn sequence(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(name)
}

/// One row of a truth.csv.
#[derive(Clone)]
struct TruthRow {
    time_s: f64,
    object: String,
    position_m: [f64; 3],
    velocity_mps: [f64; 3],
}

/// Reads the truth of a sequence with one camera.
fn truth(name: &str) -> Vec<TruthRow> {
    let text = fs::read_to_string(sequence(name).join("truth.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse().unwrap();
        TruthRow {
            time_s: number(1),
            object: cells[2].to_owned(),
            position_m: [4, 5, 6].map(number),
            velocity_mps: [7, 8, 9].map(number),
        }
    };
    text.lines().skip(1).map(row).collect()
}

const HEADER: &str = "frame,time_s,target,state,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,heading_rad,\
                      xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2,ess,confidence\n";

/// Returns a tracks.csv whose estimates are `offset_m` from the truth, with a variance of (0.1 m)² on each axis.
fn tracks(rows: &[TruthRow], offset_m: [f64; 3]) -> String {
    let mut text = HEADER.to_owned();
    for (frame, row) in rows.iter().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|i| row.position_m[i] + offset_m[i]);
        let [vx, vy, vz] = row.velocity_mps;
        let (time_s, target) = (row.time_s, &row.object);
        writeln!(
            text,
            "{frame},{time_s},{target},tracking,{x},{y},{z},{vx},{vy},{vz},,0.01,0,0,0.01,0,0.01,250,0.9"
        )
        .unwrap();
    }
    text
}

fn evaluate(tracks: &Path, truth: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pardalis"))
        .arg("evaluate")
        .args([tracks, truth])
        .args(options)
        .output()
        .unwrap()
}

/// Returns the results as JSON; fails the test if there are none.
fn figures(tracks: &Path, truth: &Path, options: &[&str]) -> Value {
    let output = evaluate(tracks, truth, &[options, &["--json", "-"]].concat());
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Returns the message of a run that ends with exit code 2.
fn error_message(tracks: &Path, truth: &Path, options: &[&str]) -> String {
    let output = evaluate(tracks, truth, options);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty());
    message
}

fn assert_near(found: &Value, expected: f64) {
    let number = found.as_f64().unwrap();
    assert!(
        (number - expected).abs() < 1e-9,
        "{number} is not {expected}"
    );
}

#[test]
fn a_known_offset_is_measured() {
    let folder = Folder::new("offset");
    let file = tracks(&truth("dioptric-jump"), [0.03, -0.04, 0.12]);
    folder.write("tracks.csv", file);
    // Both arguments may be folders.
    let all = figures(&folder.0, &sequence("dioptric-jump"), &[]);
    let target = &all["targets"][0];
    assert_eq!(
        (&target["target"], &target["matched_by"]),
        (&"ball".into(), &"name".into())
    );
    assert_eq!(
        (&target["rows"], &target["rows_without_truth"]),
        (&110.into(), &0.into())
    );
    assert_eq!(
        (&target["coverage"], &target["lost_frames"]),
        (&1.0.into(), &0.into())
    );
    assert_eq!(target["ends_on_target"], true);
    assert_eq!(all["identities"], Value::Null);
    let errors = &target["all"]["errors"];
    for figure in ["mean", "rmse", "median", "p95", "max"] {
        assert_near(&errors["position_m"][figure], 0.13);
    }
    assert_near(&errors["position_m"]["sd"], 0.0);
    for (axis, bias_m) in [0.03, -0.04, 0.12].into_iter().enumerate() {
        assert_near(&errors["bias_m"][axis], bias_m);
    }
    assert_near(&errors["velocity_rmse_mps"], 0.0);
    assert_near(&errors["consistency"]["mean_nees"], 1.69);
    assert_near(&errors["consistency"]["share_within_95"], 1.0);
}

#[test]
fn tracks_of_another_world_are_aligned_on_request() {
    let folder = Folder::new("align");
    // A quarter turn about z, and moved; the last quarter is lost in another place.
    let rows = truth("dioptric-jump");
    let quarter = |[x, y, z]: [f64; 3]| [-y, x, z];
    let turned: Vec<TruthRow> = rows
        .iter()
        .map(|row| TruthRow {
            position_m: quarter(row.position_m),
            velocity_mps: quarter(row.velocity_mps),
            ..row.clone()
        })
        .collect();
    let file = tracks(&turned, [3.0, -1.0, 0.5]);
    let path = folder.write("tracks.csv", &file);
    let sequence = sequence("dioptric-jump");
    let all = figures(&path, &sequence, &["--align"]);
    let errors = &all["targets"][0]["all"]["errors"];
    for figure in [&errors["position_m"]["max"], &errors["velocity_rmse_mps"]] {
        assert!(figure.as_f64().unwrap() < 1e-6, "{figure}");
    }
    assert_near(&all["aligned"]["truth_from_tracks"][1][0], -1.0);
    assert_near(&all["aligned"]["truth_from_tracks"][0][3], 1.0);
    let plain = figures(&path, &sequence, &[]);
    assert_eq!(plain["aligned"], Value::Null);
    let hint = String::from_utf8(evaluate(&path, &sequence, &[]).stderr).unwrap();
    assert!(hint.contains("almost all estimates are lost"), "{hint}");
    assert_eq!(evaluate(&path, &sequence, &["--align"]).stderr, b"");
    assert!(
        plain["targets"][0]["all"]["errors"]["position_m"]["rmse"]
            .as_f64()
            .unwrap()
            > 1.0
    );
    // Lost estimates do not turn the others.
    let lost: Vec<TruthRow> = turned
        .iter()
        .enumerate()
        .map(|(n, row)| {
            let away_m = if n % 4 == 0 { 4.0 } else { 0.0 };
            let [x, y, z] = row.position_m;
            TruthRow {
                position_m: [x + away_m, y, z],
                ..row.clone()
            }
        })
        .collect();
    folder.write("tracks.csv", tracks(&lost, [3.0, -1.0, 0.5]));
    let all = figures(&path, &sequence, &["--align"]);
    let median = &all["targets"][0]["all"]["errors"]["position_m"]["median"];
    assert!(median.as_f64().unwrap() < 1e-6, "{median}");
    let table = evaluate(&path, &sequence, &["--align"]).stdout;
    let table = String::from_utf8(table).unwrap();
    assert!(
        table.contains("\naligned  the tracks were turned by 90.00 degrees and moved by 3.2016 m"),
        "{table}"
    );
    // On a line, nothing says how they are turned.
    let line: Vec<TruthRow> = rows
        .iter()
        .map(|row| TruthRow {
            position_m: [row.time_s, 0.0, 0.0],
            ..row.clone()
        })
        .collect();
    folder.write("tracks.csv", tracks(&line, [0.0; 3]));
    let message = error_message(&path, &sequence, &["--align"]);
    assert!(
        message.contains(
            "--align: needs three or more positions that are not on a line, and there are 110"
        ),
        "{message}"
    );
}

#[test]
fn the_best_particle_is_evaluated_in_addition_to_the_mean() {
    let folder = Folder::new("best");
    let plain = tracks(&truth("dioptric-jump"), [0.03, -0.04, 0.12]);
    folder.write("tracks.csv", &plain);
    let without = figures(&folder.0, &sequence("dioptric-jump"), &[]);
    let errors = |all: &Value| all["targets"][0]["all"]["errors"].clone();
    assert_eq!(errors(&without)["best_position_m"], Value::Null);

    let rows = truth("dioptric-jump");
    let mut lines = plain.lines();
    let mut text = format!("{},best_x_m,best_y_m,best_z_m\n", lines.next().unwrap());
    for (line, row) in lines.zip(&rows) {
        let [x, y, z] = row.position_m;
        writeln!(text, "{line},{x},{},{}", y + 0.3, z - 0.4).unwrap();
    }
    folder.write("tracks.csv", text);
    let with = errors(&figures(&folder.0, &sequence("dioptric-jump"), &[]));
    assert_near(&with["best_position_m"]["rmse"], 0.5);
    assert_near(&with["position_m"]["rmse"], 0.13);
}

#[test]
fn the_table_agrees_with_the_json_file() {
    let folder = Folder::new("table");
    let file = folder.write(
        "tracks.csv",
        tracks(&truth("dioptric-jump"), [0.03, -0.04, 0.12]),
    );
    let json = folder.0.join("figures.json");
    let output = evaluate(
        &file,
        &sequence("dioptric-jump"),
        &["--json", json.to_str().unwrap()],
    );
    assert!(output.status.success());
    let table = String::from_utf8(output.stdout).unwrap();
    let columns_of = |label: &str| -> Vec<&str> {
        let line = table.lines().find(|l| l.trim_start().starts_with(label));
        line.unwrap()
            .rsplit("  ")
            .filter(|c| !c.is_empty())
            .take(2)
            .map(str::trim)
            .collect()
    };
    assert_eq!(columns_of("root mean square"), ["130.0", "130.0"]);
    assert_eq!(columns_of("bias along x, mm"), ["30.0", "30.0"]);
    assert_eq!(columns_of("NEES"), ["1.69 (3.0)", "1.69 (3.0)"]);
    assert!(table.contains("the world's origin"), "{table}");
    let written: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    assert_near(
        &written["targets"][0]["all"]["errors"]["position_m"]["rmse"],
        0.13,
    );
}

#[test]
fn missing_and_extra_rows_are_counted() {
    let folder = Folder::new("gaps");
    let rows = truth("dioptric-jump");
    // 10 frames have no row, 20 have a row without estimate, and 5 rows have no truth.
    let mut text = tracks(&rows[..80], [0.0; 3]);
    for row in &rows[80..100] {
        writeln!(text, "0,{},ball,lost,,,,,,,,,,,,,,9,0.1", row.time_s).unwrap();
    }
    for i in 0..5 {
        writeln!(text, "0,{},ball,tracking,1,1,1,,,,,,,,,,,9,0.9", 10 + i).unwrap();
    }
    let file = folder.write("tracks.csv", text);
    let all = figures(&file, &sequence("dioptric-jump"), &[]);
    let target = &all["targets"][0];
    assert_eq!(
        (&target["rows"], &target["rows_without_truth"]),
        (&105.into(), &5.into())
    );
    assert_near(&target["coverage"], 80.0 / 110.0);
    assert_eq!(
        (&target["lost_frames"], &target["ends_on_target"]),
        (&30.into(), &false.into())
    );
    assert_eq!(target["all"]["estimates"], 80);
}

#[test]
fn occluded_frames_are_evaluated_separately() {
    let folder = Folder::new("hidden");
    let rows = truth("dioptric-occlusion-robot");
    let balls: Vec<_> = rows.into_iter().filter(|r| r.object == "ball").collect();
    let file = folder.write("tracks.csv", tracks(&balls, [0.0, 0.0, 0.1]));
    let truth = sequence("dioptric-occlusion-robot");
    // In frames 43 to 53 and 41 to 55, at most 0.6 and 0.8 of the ball are visible.
    let frames =
        |options| figures(&file, &truth, options)["targets"][0]["visible"]["frames"].clone();
    assert_eq!(frames(&[]), 90 - 11);
    assert_eq!(frames(&["--visible-over", "0.8"]), 90 - 15);
    let lost = |options| figures(&file, &truth, options)["targets"][0]["lost_frames"].clone();
    assert_eq!(lost(&["--lost-beyond-m", "0.09"]), 90 - 11);
    assert_eq!(lost(&["--lost-beyond-m", "0.11"]), 0);
    // Three diameters of the largest target.
    assert_eq!(lost(&[]), 0);
    let limit = || {
        figures(&file, &truth, &[])["lost_beyond_m"]
            .as_f64()
            .unwrap()
    };
    assert!((limit() - 0.66).abs() < 1e-9);
    for (diameters_m, expected_m, expected) in [("0.02", 0.06, 90 - 11), ("0.07", 0.21, 0)] {
        let targets =
            format!(r#"{{"targets": {{"ball": {{"diameter_m": {diameters_m}}}, "cup": {{}}}}}}"#);
        folder.write("summary.json", targets);
        assert!((limit() - expected_m).abs() < 1e-9, "{}", limit());
        assert_eq!(lost(&[]), expected, "{diameters_m}");
    }
    folder.write("summary.json", "{}");
    let all = figures(&file, &truth, &[]);
    assert_eq!(
        all["objects_without_target"],
        serde_json::json!(["occluder_robot"])
    );
}

#[test]
fn spherical_errors_are_relative_to_the_first_camera_or_the_given_point() {
    let folder = Folder::new("around");
    let file = folder.write(
        "tracks.csv",
        tracks(&truth("dioptric-jump"), [0.0, 0.0, 0.1]),
    );
    let around = |options: &[&str]| {
        let all = figures(&file, &sequence("dioptric-jump"), options);
        let errors = all["targets"][0]["all"]["errors"].clone();
        (all["around"].clone(), errors)
    };
    // From a point far below, an offset along z is purely a distance error.
    let (point, errors) = around(&["--around", "-1,2,-1e9"]);
    assert_eq!(point["position_m"], serde_json::json!([-1.0, 2.0, -1e9]));
    assert!((errors["distance_m"]["mean"].as_f64().unwrap() - 0.1).abs() < 1e-6);
    assert_near(&errors["azimuth_rad"]["sd"], 0.0);
    folder.write(
        "summary.json",
        r#"{"frames": 110, "cameras": {"cam1": {"model": "x"}, "cam2": {"position_m": [0, 0, 0.9]}}}"#,
    );
    let (point, _) = around(&[]);
    assert_eq!(point["position_m"], serde_json::json!([0.0, 0.0, 0.9]));
    assert!(point["source"].as_str().unwrap().contains("cam2"));
    for broken in ["{", r#"{"cameras": {"c": {"position_m": [0, 0]}}}"#] {
        folder.write("summary.json", broken);
        let message = error_message(&file, &sequence("dioptric-jump"), &[]);
        assert!(
            message.contains("summary.json") && message.contains("--around"),
            "{message}"
        );
    }
}

/// Returns the truth of two balls with other names for the first and the second.
fn renamed(rows: &[TruthRow], first: &str, second: &str) -> Vec<TruthRow> {
    let rename = |row: &TruthRow| TruthRow {
        object: if row.object == "ball1" { first } else { second }.to_owned(),
        ..row.clone()
    };
    rows.iter().map(rename).collect()
}

#[test]
fn swapped_balls_are_detected_or_mapped_back() {
    let folder = Folder::new("swapped");
    let balls = sequence("dioptric-two-balls");
    let rows = renamed(&truth("dioptric-two-balls"), "ball2", "ball1");
    let file = folder.write("tracks.csv", tracks(&rows, [0.01, 0.0, 0.0]));
    // Names determine the pairs, and the results show that they are wrong.
    let all = figures(&file, &balls, &[]);
    assert_eq!(
        all["identities"],
        serde_json::json!({"switches": 0, "swapped_frames": 80})
    );
    assert!(all["targets"][0]["lost_frames"].as_u64() > Some(40));
    let all = figures(
        &file,
        &balls,
        &["--map", "ball1=ball2", "--map", "ball2=ball1"],
    );
    assert_eq!(
        all["identities"],
        serde_json::json!({"switches": 0, "swapped_frames": 0})
    );
    for target in all["targets"].as_array().unwrap() {
        assert_eq!(target["matched_by"], "map");
        assert_near(&target["all"]["errors"]["bias_m"][0], 0.01);
    }
}

#[test]
fn targets_with_other_names_are_paired_by_position() {
    let folder = Folder::new("names");
    let balls = sequence("dioptric-two-balls");
    let rows = renamed(&truth("dioptric-two-balls"), "right", "left");
    // From frame 60 on, the tracks are swapped.
    let swapped = renamed(&truth("dioptric-two-balls"), "left", "right");
    let late = |row: &&TruthRow| row.time_s > 2.39;
    let mixed: Vec<_> = rows
        .iter()
        .filter(|r| !late(r))
        .chain(swapped.iter().filter(late))
        .cloned()
        .collect();
    let file = folder.write("tracks.csv", tracks(&mixed, [0.0; 3]));
    let all = figures(&file, &balls, &[]);
    for target in all["targets"].as_array().unwrap() {
        assert_eq!(target["matched_by"], "position");
        let object = if target["target"] == "right" {
            "ball1"
        } else {
            "ball2"
        };
        assert_eq!(target["object"], object);
    }
    assert_eq!(
        all["identities"],
        serde_json::json!({"switches": 1, "swapped_frames": 20})
    );
    let table = String::from_utf8(evaluate(&file, &balls, &[]).stdout).unwrap();
    assert!(table.contains("identity assigned by position"), "{table}");
}

#[test]
fn a_single_target_is_paired_with_the_object_that_is_not_an_occluder() {
    let folder = Folder::new("alone");
    let rows = truth("dioptric-occlusion-robot");
    let mut balls: Vec<_> = rows.into_iter().filter(|r| r.object == "ball").collect();
    for row in &mut balls {
        row.object = "orange".to_owned();
    }
    let file = folder.write("tracks.csv", tracks(&balls, [0.0; 3]));
    let all = figures(&file, &sequence("dioptric-occlusion-robot"), &[]);
    let target = &all["targets"][0];
    assert_eq!(
        (&target["object"], &target["matched_by"]),
        (&"ball".into(), &"alone".into())
    );
}

#[test]
fn invalid_tracks_are_rejected_with_file_line_and_column() {
    let folder = Folder::new("bad-tracks");
    let truth = sequence("dioptric-jump");
    let bare = "time_s,target,x_m,y_m,z_m\n";
    for (content, expected) in [
        ("", &["no rows"][..]),
        (bare, &["no rows"]),
        (
            "time_s,target,x_m,y_m\n0,ball,1,2\n",
            &["line 1", "\"z_m\" is missing", "time_s,target,x_m,y_m"],
        ),
        (
            "time_s,target,x_m,y_m,z_m,x_m\n0,ball,1,2,3,4\n",
            &["line 1", "\"x_m\" occurs twice"],
        ),
        (
            &format!("{bare}0,ball,1,NaN,3\n"),
            &["line 2", "column y_m", "\"NaN\"", "finite"],
        ),
        (
            &format!("{bare}0,ball,1,2,3\n0.04,ball,1,2,three\n"),
            &["line 3", "column z_m", "\"three\""],
        ),
        (
            &format!("{bare}inf,ball,1,2,3\n"),
            &["line 2", "column time_s", "\"inf\""],
        ),
        (
            &format!("{bare},ball,1,2,3\n"),
            &["line 2", "column time_s", "is empty"],
        ),
        (
            &format!("{bare}0,,1,2,3\n"),
            &["line 2", "column target", "is empty"],
        ),
        (
            &format!("{bare}0,ball,1,,3\n"),
            &["line 2", "column y_m", "is empty"],
        ),
        (
            &format!("{bare}0,ball,1,2\n"),
            &["line 2", "4 cells", "5 columns"],
        ),
        (
            &format!("{bare}0,ball,1,2,3\n-0.0,ball,1,2,3\n"),
            &["line 3", "line 2", "\"ball\" already"],
        ),
        (
            &format!("{bare}7,ball,1,2,3\n"),
            &["7 to 7 s", "0 to 4.36 s", "within 0.001 s"],
        ),
    ] {
        let file = folder.write("tracks.csv", content);
        let message = error_message(&file, &truth, &[]);
        assert!(message.contains("tracks.csv"), "{message}");
        for part in expected {
            assert!(message.contains(part), "\"{part}\" is not in: {message}");
        }
    }
    let file = folder.write("tracks.csv", b"time_s,target,x_m,y_m,z_m\n0,\xff,1,2,3\n");
    let message = error_message(&file, &truth, &[]);
    assert!(
        message.contains("line 2") && message.contains("UTF-8"),
        "{message}"
    );
    let message = error_message(&folder.0.join("none.csv"), &truth, &[]);
    assert!(message.contains("none.csv"), "{message}");
}

#[test]
fn invalid_truth_is_rejected_with_file_line_and_column() {
    let folder = Folder::new("bad-truth");
    let tracks = folder.write("tracks.csv", "time_s,target,x_m,y_m,z_m\n0,ball,1,2,3\n");
    let bare = "time_s,object,camera,x_m,y_m,z_m,visible_fraction\n";
    for (content, expected) in [
        (
            "time_s,camera\n0,cam1\n".to_owned(),
            &["line 1", "\"object\" is missing"][..],
        ),
        (
            format!("{bare}0,ball,cam1,1,2,,1\n"),
            &["line 2", "column z_m", "is empty"],
        ),
        (
            format!("{bare}0,ball,cam1,1,2,3,1.5\n"),
            &["line 2", "column visible_fraction", "0 to 1"],
        ),
        (
            format!("{bare}0,ball,c,1,2,3,1\n0,ball,c,1,2,3,1\n"),
            &["line 3", "line 2", "camera \"c\""],
        ),
        (
            format!("{bare}0,ball,c,1,2,3,1\n0,ball,d,1,2,4,1\n"),
            &["line 3", "line 2", "must repeat"],
        ),
    ] {
        let message = error_message(&tracks, &folder.write("truth.csv", content), &[]);
        assert!(message.contains("truth.csv"), "{message}");
        for part in expected {
            assert!(message.contains(part), "\"{part}\" is not in: {message}");
        }
    }
    let message = error_message(&tracks, &folder.0.join("none"), &[]);
    assert!(message.contains("none"), "{message}");
}

#[test]
fn only_frames_between_two_times_are_evaluated() {
    let folder = Folder::new("window");
    let rows = truth("dioptric-two-balls");
    let file = folder.write("tracks.csv", tracks(&rows, [0.0, 0.3, 0.4]));
    let options = ["--from", "0.4", "--to", "0.8"];
    let scored = figures(&file, &sequence("dioptric-two-balls"), &options);
    assert_eq!(
        (&scored["from_s"], &scored["to_s"]),
        (&0.4.into(), &0.8.into())
    );
    let ball = &scored["targets"][0];
    // Both ends are included, at 25 frames per second.
    assert_eq!(ball["all"]["frames"], 11);
    assert_eq!(ball["changed_target"], false);
    let errors = &ball["all"]["errors"];
    let near = |found: &serde_json::Value, wanted: f64| {
        let found = found.as_f64().unwrap();
        assert!((found - wanted).abs() < 1e-6, "{found} is not {wanted}");
    };
    near(&errors["planar_m"]["rmse"], 0.3);
    near(&errors["position_m"]["rmse"], 0.5);
}

#[test]
fn invalid_options_are_rejected_with_the_allowed_values() {
    let folder = Folder::new("bad-options");
    let rows = truth("dioptric-two-balls");
    let file = folder.write("tracks.csv", tracks(&rows, [0.0; 3]));
    for (options, expected) in [
        (
            &["--map", "ball=ball1"][..],
            "no target \"ball\"; allowed: ball1, ball2",
        ),
        (
            &["--map", "ball1=ball"],
            "no object \"ball\"; allowed: ball1, ball2",
        ),
        (
            &["--map", "ball1=ball1", "--map", "ball1=ball2"],
            "one object per target",
        ),
        (
            &["--map", "ball1=ball1", "--map", "ball2=ball1"],
            "one target per object",
        ),
        (&["--map", "ball1"], "TARGET=OBJECT"),
        (&["--around", "1,2"], "three numbers"),
        (&["--around", "1,2,NaN"], "three numbers"),
        (&["--visible-over", "1"], "0 up to"),
        (&["--lost-beyond-m", "0"], "more than 0"),
        (&["--lost-beyond-m", "NaN"], "a finite number"),
        (&["--from", "x"], "a finite number"),
        (&["--from", "100"], "no frame of"),
        (&["--json", "/nowhere/at/all.json"], "write permission"),
    ] {
        let message = error_message(&file, &sequence("dioptric-two-balls"), options);
        assert!(
            message.contains(expected),
            "\"{expected}\" is not in: {message}"
        );
    }
    // A target without an object is named; tracks without any object are rejected.
    let hider = folder.write("truth.csv", "time_s,object,x_m,y_m,z_m\n0,occluder,1,2,3\n");
    let message = error_message(&file, &hider, &[]);
    assert!(message.contains("no target (ball1, ball2)"), "{message}");
    let single = folder.write("truth.csv", "time_s,object,x_m,y_m,z_m\n0,ball2,1,2,3\n");
    let all = figures(&file, &single, &[]);
    assert_eq!(all["targets_without_object"], serde_json::json!(["ball1"]));
}

#[test]
fn headings_are_compared_if_both_tables_have_one() {
    let folder = Folder::new("headings");
    let truth = folder.write(
        "truth.csv",
        "time_s,object,x_m,y_m,z_m,heading_rad\n\
         0,robot,0,0,0,3.1\n1,robot,1,0,0,0.5\n2,robot,2,0,0,\n3,robot,3,0,0,-0.2\n",
    );
    // Off by +0.1 across ±π, by -0.05, unknown, and unknown.
    let across = 3.2 - std::f64::consts::TAU;
    let rows = |first: &str| {
        format!(
            "time_s,target,x_m,y_m,z_m,heading_rad\n\
             0,robot,0.3,0.4,0,{first}\n1,robot,1,-0.1,0,0.45\n2,robot,2,0,0,1\n3,robot,3,0,0,\n"
        )
    };
    let tracks = folder.write("tracks.csv", rows(&across.to_string()));
    let scored = figures(&tracks, &truth, &[]);
    let errors = &scored["targets"][0]["all"]["errors"];
    assert_eq!(errors["heading"]["frames"], 2);
    assert_near(&errors["heading"]["error_median_rad"], 0.075);
    assert_near(&errors["heading"]["error_p95_rad"], 0.0975);
    assert_near(&errors["heading"]["bias_rad"], 0.025);
    assert_near(&errors["planar_m"]["mean"], 0.15);
    let output = evaluate(&tracks, &truth, &[]);
    let table = String::from_utf8(output.stdout).unwrap();
    let line = table.lines().find(|l| l.contains("heading error, median"));
    assert!(line.unwrap().ends_with("4.30"), "{table}");
    let north = folder.write("north.csv", rows("north"));
    let message = error_message(&north, &truth, &[]);
    for part in ["north.csv", "line 2", "heading_rad", "north"] {
        assert!(message.contains(part), "{message}");
    }
}

mod circles;
mod confidence;
