//! Cameras on moving platforms: files of poses and odometry, what is reported about them, and their errors.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry2, Point2, Rotation3, UnitQuaternion, Vector2, Vector3};
use serde_json::Value;

use crate::common::{BALL_COLORS, Run, rows_in};

/// The first frames of data/dioptric-moving-robot, with the robot's motion in the file of the given line.
const SCENE: &str = r#"seed = 1
[platforms.robot]
MOTION
[cameras.cam1]
images = "DATA/dioptric-moving-robot/frames"
fps = 25
frame_limit = 30
platform = "robot"
calibration = "DATA/dioptric-moving-robot/camera.json"
[targets.ball]
shape.sphere.radius_m = 0.11
colors = "ball.toml"
"#;

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.write("ball.toml", BALL_COLORS);
        place
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    /// Tracks the sequence with this motion of the platform.
    fn track(&self, motion: &str) -> Run {
        let scene = SCENE.replace("MOTION", motion);
        self.track_scene(&scene)
    }

    fn track_scene(&self, scene: &str) -> Run {
        self.write(
            "scene.toml",
            &scene.replace("DATA", data().to_str().unwrap()),
        );
        Run::pardalis(&self.0, &["track", "scene.toml", "-o", "out", "--no-plots"])
    }

    fn rows(&self) -> Vec<Vec<String>> {
        rows_in(&fs::read_to_string(self.0.path().join("out/tracks.csv")).unwrap())
    }

    fn summary(&self) -> Value {
        let text = fs::read_to_string(self.0.path().join("out/summary.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }
}

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data")
}

/// Returns time, x, y and heading of the robot in each frame.
fn robot_poses() -> Vec<[f64; 4]> {
    let text = fs::read_to_string(data().join("dioptric-moving-robot/poses.csv")).unwrap();
    let numbers =
        |line: &str| -> Vec<f64> { line.split(',').map(|v| v.parse().unwrap()).collect() };
    let rows = text.lines().skip(1);
    rows.map(|line| numbers(line).try_into().unwrap()).collect()
}

/// Returns the largest distance in metres of the ball from its true position, from the tenth frame on.
fn largest_error_m(place: &Place) -> f64 {
    let truth = fs::read_to_string(data().join("dioptric-moving-robot/truth.csv")).unwrap();
    let truth: Vec<Vec<String>> = truth
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let number = |cell: &String| cell.parse::<f64>().unwrap();
    let rows = place.rows();
    assert_eq!(rows.len(), 30);
    let errors_m = rows.iter().zip(&truth).skip(10).map(|(row, truth)| {
        assert_eq!(number(&row[1]), number(&truth[1]));
        let off_m = [0, 1, 2].map(|i| number(&row[4 + i]) - number(&truth[4 + i]));
        Vector3::from(off_m).norm()
    });
    errors_m.fold(0.0, f64::max)
}

#[test]
fn a_ball_is_tracked_in_the_world_by_odometry_and_by_poses() {
    let place = Place::new();
    let motions = [
        ("odometry = \"DATA/dioptric-moving-robot/odometry.csv\"", 99),
        ("poses = \"DATA/dioptric-moving-robot/poses.csv\"", 100),
    ];
    for (motion, rows) in motions {
        let run = place.track(motion);
        assert_eq!((run.code, &*run.stderr), (Some(0), ""), "{motion}");
        // The ball is 2.8 m away.
        let error_m = largest_error_m(&place);
        assert!(error_m < 0.07, "{motion}: {error_m}");
        let summary = place.summary();
        let robot = &summary["platforms"]["robot"];
        // Rows are read as far as the last frame needs them.
        assert!(robot["used"].as_u64().unwrap() < rows, "{robot}");
        assert_eq!(robot["frames_without_pose"], 0);
        let camera = &summary["cameras"]["cam1"];
        assert_eq!(camera["platform"], "robot");
        assert_eq!(camera["position_on_platform_m"][2], 0.9);
    }
}

#[test]
fn quaternions_the_tum_format_and_headings_say_the_same() {
    let place = Place::new();
    let mut csv = "time_s,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
    let mut tum = "# time x y z qx qy qz qw\n".to_owned();
    let mut late = "time_s,x_m,y_m,heading_rad\n".to_owned();
    for [time_s, x_m, y_m, heading_rad] in robot_poses() {
        let rotation = Rotation3::new(Vector3::z() * heading_rad);
        let [qx, qy, qz, qw]: [f64; 4] = UnitQuaternion::from_rotation_matrix(&rotation)
            .coords
            .into();
        let _ = writeln!(csv, "{time_s},{x_m},{y_m},0,{qx},{qy},{qz},{qw}");
        let _ = writeln!(tum, "{time_s} {x_m} {y_m} 0 {qx} {qy} {qz} {qw}");
        let _ = writeln!(late, "{},{x_m},{y_m},{heading_rad}", time_s - 1000.0);
    }
    for (name, text) in [("poses.csv", csv), ("poses.txt", tum), ("late.csv", late)] {
        place.write(name, &text);
    }
    let track = |motion: &str| {
        let run = place.track(motion);
        assert_eq!((run.code, &*run.stderr), (Some(0), ""), "{motion}");
        let rows = place.rows();
        let positions = rows.iter().flat_map(|row| row[4..7].to_vec());
        positions
            .map(|v| v.parse::<f64>().unwrap())
            .collect::<Vec<_>>()
    };
    let wanted = track("poses = \"DATA/dioptric-moving-robot/poses.csv\"");
    for motion in [
        "poses = \"poses.csv\"",
        "poses = \"poses.txt\"",
        "poses = \"late.csv\"\ntime_offset_s = 1000",
    ] {
        let found = track(motion);
        let off = wanted.iter().zip(&found).map(|(a, b)| (a - b).abs());
        let off_m = off.fold(0.0, f64::max);
        // A quaternion rounds differently.
        assert!(off_m < 1e-6 && found.len() == 90, "{motion}: {off_m}");
    }
}

#[test]
fn what_a_log_lacks_is_reported_and_survived() {
    let place = Place::new();
    let text = fs::read_to_string(data().join("dioptric-moving-robot/odometry.csv")).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    lines.swap(20, 21);
    lines.remove(12);
    // 3 m in 40 ms.
    let jump = "15,0.600000,3.000000,0.000000,0,0,0,0";
    lines[14] = jump;
    place.write("log.csv", &(lines.join("\n") + "\n"));
    let run = place.track("odometry = \"log.csv\"");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for part in [
        "warning: platforms.robot: ignored 1 row of log.csv whose times are not later than those before; sort",
        "between the increments of log.csv; the platform was taken to move evenly meanwhile",
        "warning: platforms.robot: 1 jump in log.csv that no motion explains; these increments were ignored; are positions in metres",
    ] {
        assert!(run.stderr.contains(part), "{}", run.stderr);
    }
    let error_m = largest_error_m(&place);
    assert!(error_m < 0.1, "{error_m}");
    let robot = &place.summary()["platforms"]["robot"];
    assert_eq!((&robot["late"], &robot["jumps"]), (&1.into(), &1.into()));
}

#[test]
fn frames_without_a_pose_are_counted() {
    let place = Place::new();
    let mut text = "time_s,x_m,y_m,heading_rad\n".to_owned();
    for [time_s, x_m, y_m, heading_rad] in robot_poses() {
        if time_s < 0.4 {
            let _ = writeln!(text, "{time_s},{x_m},{y_m},{heading_rad}");
        }
    }
    place.write("short.csv", &text);
    let run = place.track("poses = \"short.csv\"");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let warning = "warning: platforms.robot: short.csv has no pose near the times of 14 frames, which were not used; targets were predicted meanwhile";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
    assert_eq!(place.rows()[29][3], "lost");
}

#[test]
fn files_that_do_not_say_where_the_platform_is_are_refused() {
    let place = Place::new();
    for (motion, text, wanted) in [
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0,1,1,0,0\n",
            "file, line 2: the quaternion [1.0, 1.0, 0.0, 0.0] does not have length 1; allowed: qx, qy, qz, qw",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,z_m\n0,0,0,0\n",
            "file, line 1: has neither the columns qx,qy,qz,qw nor heading_rad; needed:",
        ),
        (
            "poses = \"file\"",
            "stamp,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n",
            "file, line 1: needed are the columns time_s,x_m,y_m,z_m,qx,qy,qz,qw or time_s,x_m,y_m,heading_rad,",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,z_m,heading_rad,qx,qy,qz,qw\n0,0,0,0,0,0,0,0,1\n",
            "file, line 1: has heading_rad and quaternions, which may differ; keep one of them",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad,sigma\n0,0,0,0,1\n",
            "file, line 1: column \"sigma\" is unknown; allowed: sigma_m and sigma_rad, or cov_x_x to cov_rz_rz",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad\n0,0,0,0\n40,0,0,0\n80,0,0,0\n",
            "file: its rows are 40 s apart, and more than 1 s say nothing about what is between; times are in seconds: are these milliseconds?",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad\n0.3,0,0,0\n0.2,0,0,0\n0.1,0,0,0\n0,0,0,0\n",
            "file: 3 of 4 rows are not later than those before; sort the file by time",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad\n0,0,nan,0\n",
            "file, line 2, column y_m: holds \"nan\"; allowed: a finite number",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad\n0,0,2e9,0\n",
            "file, line 2: the pose is [0.0, 2000000000.0, 0.0]; allowed:",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad,sigma_m,sigma_rad\n0,0,0,0,-1,0\n",
            "file, line 2: sigma_m is -1; allowed: 0 to 1e6",
        ),
        (
            "poses = \"file\"",
            "0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 1\n",
            "file, line 2: has 7 numbers; needed: time x y z qx qy qz qw",
        ),
        (
            "poses = \"file\"",
            "time_s,x_m,y_m,heading_rad\n1700000000,0,0,0\n",
            "set platforms.robot.time_offset_s if the clocks differ",
        ),
        (
            "odometry = \"file\"",
            "time_s,dx_m,dy_m\n0,0,0\n",
            "file, line 1: column \"dtheta_rad\" is missing; found: time_s,dx_m,dy_m",
        ),
        (
            "odometry = \"file\"",
            "time_s,dx_m,dy_m,dtheta_rad\n0.1,0,0,0\n",
            "file: has one row, and its increment may begin at any time; give more rows, or the column from_time_s",
        ),
        (
            "odometry = \"file\"",
            "time_s,from_time_s,dx_m,dy_m,dtheta_rad\n0.1,0.2,0,0,0\n",
            "file, line 2: from_time_s is 0.2, and time_s is 0.1; allowed: a time before time_s",
        ),
        (
            "odometry = \"nowhere.csv\"",
            "",
            "nowhere.csv: No such file or directory",
        ),
    ] {
        place.write("file", text);
        let run = place.track(motion);
        assert_eq!(run.code, Some(2), "{text}: {}", run.stderr);
        assert!(run.stderr.contains(wanted), "{wanted}: {}", run.stderr);
        // The key and its line.
        assert!(
            run.stderr.contains("line 3: platforms.robot."),
            "{}",
            run.stderr
        );
    }
}

#[test]
fn scenes_whose_platforms_contradict_themselves_are_refused() {
    let place = Place::new();
    let odometry = "odometry = \"DATA/dioptric-moving-robot/odometry.csv\"";
    let scene = SCENE.replace("MOTION", odometry);
    for (from, to, wanted) in [
        (
            "platform = \"robot\"",
            "platform = \"cart\"",
            "cameras.cam1.platform: is the text \"cart\"; allowed: robot",
        ),
        (
            "platform = \"robot\"",
            "platform = \"robot\"\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "cameras.cam1.world_from_camera: cannot be combined with platform, on which the camera moves; give platform_from_camera instead",
        ),
        (
            "platform = \"robot\"",
            "platform_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "cameras.cam1.platform_from_camera: needs platform; add platform = \"NAME\", or give world_from_camera",
        ),
        (
            odometry,
            "",
            "platforms.robot: says nothing about its motion; give poses = \"FILE.csv\" or odometry = \"FILE.csv\"",
        ),
        (
            odometry,
            "odometry = \"a\"\nposes = \"b\"",
            "platforms.robot.odometry: cannot be combined with poses; remove one of them",
        ),
        (
            odometry,
            "poses = \"b\"\nscale_sigma = 0.1",
            "platforms.robot.scale_sigma: applies to odometry only; remove it",
        ),
    ] {
        assert!(scene.contains(from));
        let run = place.track_scene(&scene.replacen(from, to, 1));
        assert_eq!(run.code, Some(2), "{to}: {}", run.stderr);
        assert!(run.stderr.contains(wanted), "{wanted}: {}", run.stderr);
    }
    // A platform without a camera.
    let spare = format!("{scene}[platforms.spare]\n{odometry}\n");
    let run = place.track_scene(&spare);
    run.refused(&["platforms: spare carries no camera; give platform = \"spare\""]);
}

/// A robot that drives past a ball and turns.
const WORLD: &str = r"seed = 2
duration_s = 1.2
training_stills = 3
[platforms.robot]
path.waypoints = { times_s = [-0.5, 0.3, 1, 2], positions_m = [[-0.3, 0, 0], [0, 0, 0], [0.5, 0.1, 0], [0.9, 0.5, 0]] }
[platforms.robot.odometry]
scale_error = 0.03
[cameras.front]
platform = 'robot'
size_px = [160, 120]
model.pinhole = { f_px = [130, 130], center_px = [79.5, 59.5] }
look_from_m = [0.1, 0, 0.4]
look_at_m = [1.5, 0, 0.1]
[image]
samples = 2
read_noise = 2
[ground]
texture.noise = { size_m = 0.4, octaves = 5, colors_srgb = [[95, 115, 95], [135, 145, 125]] }
[objects.ball]
target = true
shape.sphere.radius_m = 0.11
color_srgb = [235, 110, 30]
path.still = { position_m = [1.7, 0.6, 0.11] }
";

/// Returns these columns of a CSV file.
fn planar_rows<const N: usize>(path: &Path, columns: [&str; N]) -> Vec<[f64; N]> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect());
    let header: Vec<&str> = lines.next().unwrap();
    let places = columns.map(|name| header.iter().position(|found| *found == name).unwrap());
    let row = |line: Vec<&str>| places.map(|at| line[at].parse().unwrap());
    lines.map(row).collect()
}

#[test]
fn simulated_robots_write_their_odometry_and_their_poses() {
    let place = Place::new();
    place.write("world.toml", WORLD);
    let run = Run::pardalis(&place.0, &["simulate", "world.toml", "-o", "robot"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let folder = place.0.path().join("robot");
    let scene = fs::read_to_string(folder.join("scene.toml")).unwrap();
    assert!(
        scene.contains("odometry = \"robot.odometry.csv\""),
        "{scene}"
    );
    // With the true poses as well.
    fs::write(folder.join("found.toml"), &scene).unwrap();
    let begin = scene.find("odometry =").unwrap();
    let end = scene.find("[cameras").unwrap();
    let exact = format!(
        "{}poses = \"robot.poses.csv\"\n{}",
        &scene[..begin],
        &scene[end..]
    );
    fs::write(folder.join("exact.toml"), exact).unwrap();
    let mut errors_m = Vec::new();
    for name in ["exact", "found"] {
        let scene = format!("robot/{name}.toml");
        let run = Run::pardalis(&place.0, &["track", &scene, "-o", name, "--no-plots"]);
        assert_eq!((run.code, &*run.stderr), (Some(0), ""));
        let rows = fs::read_to_string(place.0.path().join(name).join("tracks.csv")).unwrap();
        let rows = rows_in(&rows);
        let last = &rows[rows.len() - 1];
        assert_eq!((rows.len(), &*last[3]), (30, "tracking"));
        let place_m = [4, 5, 6].map(|i| last[i].parse::<f64>().unwrap());
        errors_m.push(Vector3::from(place_m) - Vector3::new(1.7, 0.6, 0.11));
    }
    // The odometry says that the robot has driven and turned 3 % farther, and so that the ball is elsewhere.
    let [exact_m, found_m] = errors_m[..] else {
        panic!("two runs");
    };
    assert!(exact_m.norm() < 0.05, "{exact_m}");
    let poses = planar_rows(&folder.join("robot.poses.csv"), ["x_m", "y_m", "qz", "qw"]);
    let pose =
        |[x_m, y_m, qz, qw]: [f64; 4]| Isometry2::new(Vector2::new(x_m, y_m), 2.0 * qz.atan2(qw));
    let increments = planar_rows(
        &folder.join("robot.odometry.csv"),
        ["dx_m", "dy_m", "dtheta_rad"],
    );
    let mut drifted = pose(poses[0]);
    for [x_m, y_m, turn_rad] in increments {
        drifted *= Isometry2::new(Vector2::new(x_m, y_m), turn_rad);
    }
    let ball_m = Point2::new(1.7, 0.6);
    let moved_m = drifted * pose(poses[poses.len() - 1]).inverse_transform_point(&ball_m) - ball_m;
    assert!(moved_m.norm() > 0.03, "{moved_m}");
    // The filter averages over the last frames, during which the odometry drifted.
    let off_m = (found_m - exact_m).xy() - moved_m;
    assert!(off_m.norm() < 0.004, "{off_m}");
    // Simulating again replaces the folder with these files.
    for name in ["found.toml", "exact.toml"] {
        fs::remove_file(folder.join(name)).unwrap();
    }
    let run = Run::pardalis(
        &place.0,
        &["simulate", "world.toml", "-o", "robot", "--force"],
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
}

/// A robot that drives to and fro and turns before a ball and a board, which are at rest.
const MOUNT_WORLD: &str = r"seed = 3
duration_s = 3.0
training_stills = 3
[platforms.robot]
path.harmonic = { center_m = [0, 0, 0], x = [[0.3, 3.1, 0]], y = [[0.15, 2.3, 90]] }
heading_deg = 0
yaw = [[12, 2.1, 0]]
[cameras.front]
platform = 'robot'
size_px = [320, 240]
model.pinhole = { f_px = [260, 260], center_px = [159.5, 119.5] }
look_from_m = [0.12, -0.05, 0.5]
look_at_m = [1.5, 0.05, 0.25]
[timing]
fps = 8
[image]
samples = 2
read_noise = 2
[ground]
texture.noise = { size_m = 0.4, octaves = 5, colors_srgb = [[95, 115, 95], [135, 145, 125]] }
[objects.ball]
target = true
shape.sphere.radius_m = 0.11
color_srgb = [235, 110, 30]
path.still = { position_m = [1.5, -0.3, 0.11] }
[objects.board]
shape.box = { size_m = [0.02, 0.40, 0.30] }
texture.checker = { size_m = 0.05, colors_srgb = [[20, 20, 20], [235, 235, 235]] }
heading_deg = 172
path.still.position_m = [1.5, 0.2, 0.3]
";

#[test]
fn a_camera_on_a_robot_is_calibrated_by_a_ball_or_a_board_at_rest() {
    let place = Place::new();
    place.write("world.toml", MOUNT_WORLD);
    let run = Run::pardalis(&place.0, &["simulate", "world.toml", "-o", "robot"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let folder = place.0.path().join("robot");
    let scene = fs::read_to_string(folder.join("scene.toml")).unwrap();
    let (begin, end) = (
        scene.find("odometry =").unwrap(),
        scene.find("[cameras").unwrap(),
    );
    // The poses are 40 ms late, and the camera is 16 cm and 9 degrees from where the scene has it.
    let guess = "platform_from_camera = [[0.25, -0.24, 0.94, 0.22], [-0.97, 0.0, 0.26, 0.07], [-0.06, -0.97, -0.23, 0.5], [0, 0, 0, 1]]";
    let guess = orthonormal(guess);
    let rough = format!(
        "{}poses = \"robot.poses.csv\"\ntime_offset_s = 0.04\n{}",
        &scene[..begin],
        scene[end..].replace(
            "platform = \"robot\"",
            &format!("platform = \"robot\"\n{guess}")
        )
    );
    fs::write(folder.join("rough.toml"), rough).unwrap();
    for (arguments, most_mm) in [
        (&["--target", "ball"][..], 8.0),
        (&["--board", "checkerboard:7x5:0.05"][..], 3.0),
    ] {
        let command = [
            &["calibrate", "mount", "robot/rough.toml", "-o", "mount"],
            arguments,
        ]
        .concat();
        let run = Run::pardalis(&place.0, &command);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!(run.stdout.contains("is kept: measure it"), "{}", run.stdout);
        // The clock is as it was.
        let offset = run.stdout.split("time_offset_s = ").nth(1).unwrap();
        let offset_s: f64 = offset.split_whitespace().next().unwrap().parse().unwrap();
        assert!(offset_s.abs() < 3e-3, "{offset_s}");
        let text = fs::read_to_string(place.0.path().join("mount/camera.toml")).unwrap();
        let table: toml::Table = text.parse().unwrap();
        let pose = &table["cameras"]["front"]["world_from_camera"];
        let at = |row: usize, column: usize| pose[row][column].as_float().unwrap();
        for (row, true_m) in [0.12, -0.05, 0.5].into_iter().enumerate() {
            let off_mm = 1e3 * (at(row, 3) - true_m);
            assert!(off_mm.abs() < most_mm, "{arguments:?} {row}: {off_mm}");
        }
        // The direction in which it looks.
        let looks = Vector3::new(at(0, 2), at(1, 2), at(2, 2));
        let expected = Vector3::new(1.38, 0.1, -0.25).normalize();
        let off_deg = looks.angle(&expected).to_degrees();
        assert!(off_deg < 0.3, "{arguments:?}: {off_deg}");
    }
}

/// Returns the setting with rows of a rotation that are as they should be.
fn orthonormal(setting: &str) -> String {
    let (key, rows) = setting.split_once(" = ").unwrap();
    let table: toml::Table = format!("m = {rows}").parse().unwrap();
    let number = |value: &toml::Value| {
        value
            .as_float()
            .or(value.as_integer().map(|v| v as f64))
            .unwrap()
    };
    let matrix = nalgebra::Matrix3::from_fn(|i, j| number(&table["m"][i][j]));
    let svd = matrix.svd(true, true);
    let rotation = svd.u.unwrap() * svd.v_t.unwrap();
    let row = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|j| rotation[(i, j)]);
        format!("[{a:?}, {b:?}, {c:?}, {:?}]", number(&table["m"][i][3]))
    };
    format!("{key} = [{}, {}, {}, [0, 0, 0, 1]]", row(0), row(1), row(2))
}

#[test]
fn cameras_that_cannot_be_calibrated_on_a_platform_are_refused() {
    let place = Place::new();
    let poses = "poses = \"DATA/dioptric-moving-robot/poses.csv\"";
    let calibrate = |scene: &str, arguments: &[&str]| {
        place.write(
            "scene.toml",
            &scene.replace("DATA", data().to_str().unwrap()),
        );
        let command = [
            &["calibrate", "mount", "scene.toml", "-o", "mount"],
            arguments,
        ]
        .concat();
        Run::pardalis(&place.0, &command)
    };
    let scene = SCENE.replace("MOTION", poses);
    // The ball is kicked: no offset of the clocks explains that.
    let run = calibrate(&scene.replace("frame_limit = 30\n", ""), &[]);
    run.refused(&["cameras.cam1: ", "check that the target was at rest"]);
    // The ball rolls.
    let run = calibrate(&scene, &[]);
    run.refused(&[
        "cameras.cam1: only 0 of 30 points are seen where a target at rest would be",
        "check that the target was at rest",
    ]);
    let run = calibrate(&scene, &["--board", "checkerboard:7x5:0.05"]);
    run.refused(&["the target was seen in 0 views, which are too few"]);
    let run = calibrate(&scene, &["--camera", "cam2"]);
    run.refused(&[
        "no camera cam2: the cameras on platforms are cam1; choose one with --camera NAME",
    ]);
    let run = Run::pardalis(&place.0, &["calibrate", "time", "scene.toml"]);
    run.refused(&["cameras.cam1.platform: the camera moves"]);
    let platform = format!("[platforms.robot]\n{poses}\n");
    let at_rest = scene
        .replace(&platform, "")
        .replace("platform = \"robot\"\n", "");
    let run = calibrate(&at_rest, &[]);
    assert_eq!(run.code, Some(2));
    assert!(
        run.stderr
            .contains("no camera is on a platform; describe the platform"),
        "{}",
        run.stderr
    );
}
