//! Platforms whose poses come from another program while their live camera is tracked.
#![expect(
    clippy::disallowed_methods,
    reason = "cameras and robots have the clock of this computer"
)]

use std::fs::{self, File};
use std::io::Write as _;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use pardalis_images::decode;
use serde_json::{Value, json};

use super::camera::{SIZE_PX, Stream, stand_in, with_stand_in, write_frame};
use crate::common::{Run, Workplace};

/// The robot of data/dioptric-moving-robot with a live camera. MOTION stands for the line about its motion.
const SCENE: &str = r#"seed = 1
[platforms.robot]
MOTION
[cameras.cam1]
video = "udp://lab:5000/cam1"
input.when_behind = "wait"
platform = "robot"
calibration = "DATA/camera.json"
[targets.ball]
shape.sphere.radius_m = 0.11
colors = "ball.toml"
"#;

/// Seconds between images, and between poses.
const INTERVAL_S: f64 = 0.04;

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/dioptric-moving-robot")
}

/// Returns the numbers of a table's columns, up to the first that is none.
fn numbers(name: &str) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(data().join(name)).unwrap();
    let row = |line: &str| {
        line.split(',')
            .map_while(|cell| cell.parse().ok())
            .collect()
    };
    text.lines().skip(1).map(row).collect()
}

fn unix_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.unwrap().as_secs_f64()
}

/// A robot: the images of its camera, and where it says it is.
struct Robot {
    place: Workplace,
    address: String,
}

impl Robot {
    fn new() -> Self {
        let place = Workplace::with_frames(0);
        stand_in(&place, "exec cat \"$camera.pipe\"");
        let made = Command::new("mkfifo").arg(place.path("cam1.pipe")).status();
        assert!(made.unwrap().success());
        // Free again when this returns.
        let free = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = free.local_addr().unwrap().to_string();
        Self { place, address }
    }

    fn scene(&self, motion: &str) -> String {
        let motion = motion.replace("ADDRESS", &format!("udp://{}", self.address));
        SCENE
            .replace("MOTION", &motion)
            .replace("DATA", data().to_str().unwrap())
    }

    /// Returns the command that tracks this many images.
    fn command(&self, motion: &str, count: usize) -> Command {
        let count_text = count.to_string();
        let arguments = ["-o", "out", "--no-plots", "--frames", &count_text];
        let command = self.place.command(self.scene(motion), &arguments);
        let mut command = with_stand_in(&self.place, command);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Tracks this many images, which come as they would from the robot. `datagrams` returns what the robot sends with its pose of a number, (time, x, y, heading),
    /// that of the beginning in seconds since 1970 and the time since then.
    fn drive(
        &self,
        motion: &str,
        count: usize,
        datagrams: impl Fn(usize, &[f64], f64) -> Vec<String> + Sync,
    ) -> Run {
        let program = self.command(motion, count).spawn().unwrap();
        let images: Vec<Vec<u8>> = (0..count)
            .map(|number| {
                let file = data().join(format!("frames/{number:06}.jpg"));
                decode(&fs::read(file).unwrap()).unwrap().into_raw()
            })
            .collect();
        // Waits for the program.
        let mut pipe = File::create(self.place.path("cam1.pipe")).unwrap();
        pipe.write_all(&Stream::of(SIZE_PX).bytes).unwrap();
        let (begin, begin_unix_s) = (Instant::now(), unix_s());
        let wait_until = |time_s: f64| {
            thread::sleep(Duration::from_secs_f64(time_s).saturating_sub(begin.elapsed()));
        };
        thread::scope(|scope| {
            scope.spawn(|| {
                let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
                for (number, pose) in numbers("poses.csv").iter().take(count).enumerate() {
                    wait_until(pose[0]);
                    for datagram in datagrams(number, pose, begin_unix_s) {
                        socket.send_to(datagram.as_bytes(), &self.address).unwrap();
                    }
                }
            });
            for (number, image) in images.iter().enumerate() {
                let time_s = INTERVAL_S * number as f64;
                wait_until(time_s);
                let mut bytes = Vec::new();
                write_frame(&mut bytes, 1e6 + time_s, image);
                // The program may have ended with an error.
                if pipe.write_all(&bytes).is_err() {
                    break;
                }
            }
        });
        Run::from(program.wait_with_output().unwrap())
    }

    fn summary(&self) -> Value {
        let text = fs::read(self.place.path("out/summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&text).unwrap();
        summary["platforms"]["robot"].clone()
    }
}

/// Returns a pose as the robot sends it.
fn pose(pose: &[f64], begin_unix_s: f64) -> String {
    let [time_s, x_m, y_m, heading_rad] = pose[..] else {
        panic!("{pose:?}")
    };
    json!({ "time_unix_s": begin_unix_s + time_s, "x_m": x_m, "y_m": y_m, "heading_rad": heading_rad }).to_string()
}

#[test]
fn a_live_camera_on_a_robot_is_where_the_robot_says() {
    const COUNT: usize = 50;
    let truth = numbers("truth.csv");
    // The frame, the time, and the object's name end the numbers: its position follows.
    let text = fs::read_to_string(data().join("truth.csv")).unwrap();
    let position = |number: usize| -> Vec<f64> {
        let cells = text.lines().nth(1 + number).unwrap().split(',');
        cells
            .skip(4)
            .take(3)
            .map(|cell| cell.parse().unwrap())
            .collect()
    };
    assert!((truth[COUNT - 1][1] - INTERVAL_S * (COUNT - 1) as f64).abs() < 1e-9);
    let robot = Robot::new();
    for motion in ["poses = \"ADDRESS\"", "odometry = \"ADDRESS\""] {
        let run = robot.drive(motion, COUNT, |number, row, begin_unix_s| {
            let mut sent = vec![pose(row, begin_unix_s)];
            match number {
                10 => sent.push("x=1 y=2".to_owned()),
                // A clock that was not set.
                20 => sent.push(pose(row, 0.0)),
                30 => sent.push(json!({ "x_m": 1, "y_m": 2 }).to_string()),
                _ => {}
            }
            sent
        });
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let rows = robot.place.rows();
        assert_eq!(rows.len(), COUNT);
        for (number, row) in rows.iter().enumerate().skip(20) {
            assert_eq!(row[3], "tracking", "{motion}: {row:?}");
            let off_m =
                (0..3).map(|axis| row[4 + axis].parse::<f64>().unwrap() - position(number)[axis]);
            let error_m = off_m.map(|off_m| off_m * off_m).sum::<f64>().sqrt();
            // In the frame of the robot, it is more than a metre elsewhere at the end.
            assert!(error_m < 0.2, "{motion}: frame {number}: {error_m}");
        }
        let found = robot.summary();
        // The last may come after the last image.
        let received = found["received"].as_u64().unwrap();
        assert!(
            (COUNT as u64..=COUNT as u64 + 3).contains(&received),
            "{found}"
        );
        assert_eq!(found["unusable"], 3, "{found}");
        assert!(
            found["frames_without_pose"].as_u64().unwrap() < 5,
            "{found}"
        );
        let place = format!("udp://{}", robot.address);
        for text in [
            format!(
                "warning: platforms.robot: left out a datagram, and will count others like it: {place}: is not one object in JSON"
            ),
            format!(
                "warning: platforms.robot: left out 3 of {received} datagrams that came to {place}"
            ),
        ] {
            assert!(run.stderr.contains(&text), "{}", run.stderr);
        }
    }
}

#[test]
fn poses_are_taken_while_the_camera_is_being_opened() {
    let robot = Robot::new();
    let mut command = robot.command("poses = \"ADDRESS\"", 3);
    let program = command.spawn().unwrap();
    // Waits until the program waits for the first image.
    let mut pipe = File::create(robot.place.path("cam1.pipe")).unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for row in numbers("poses.csv").iter().take(30) {
        let datagram = pose(row, unix_s() - row[0]);
        socket.send_to(datagram.as_bytes(), &robot.address).unwrap();
        thread::sleep(Duration::from_millis(10));
    }
    let mut bytes = Stream::of(SIZE_PX).bytes;
    for number in 0..3 {
        let image = vec![0; 3 * SIZE_PX.0 * SIZE_PX.1];
        write_frame(&mut bytes, 1e6 + INTERVAL_S * f64::from(number), &image);
    }
    pipe.write_all(&bytes).unwrap();
    drop(pipe);
    let run = Run::from(program.wait_with_output().unwrap());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let found = robot.summary();
    // The last may come when the run is over.
    assert!(found["received"].as_u64().unwrap() >= 20, "{found}");
}

#[test]
fn a_robot_that_keeps_silent_is_reported() {
    let robot = Robot::new();
    let run = robot.drive("poses = \"ADDRESS\"", 60, |_, _, _| Vec::new());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let place = format!("udp://{}", robot.address);
    for text in [
        format!(
            "warning: platforms.robot: no pose has come to {place} yet, and images are not used without"
        ),
        format!("warning: platforms.robot: nothing came to {place}; let the other program"),
        "no pose near the times of 60 frames, which were not used: none came".to_owned(),
    ] {
        assert!(run.stderr.contains(&text), "{}", run.stderr);
    }
    assert!(robot.place.rows().iter().all(|row| row[3] == "searching"));
}

#[test]
fn a_robot_that_stops_sending_and_returns_is_reported() {
    let robot = Robot::new();
    let run = robot.drive("poses = \"ADDRESS\"", 100, |number, row, begin_unix_s| {
        let sends = !(10..88).contains(&number);
        sends.then(|| pose(row, begin_unix_s)).into_iter().collect()
    });
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let place = format!("udp://{}", robot.address);
    let stopped = format!(
        "platforms.robot: no pose has come to {place} for 2 s, and images are not used without"
    );
    let returned = format!("platforms.robot: poses come to {place} again");
    let [stopped, returned] = [stopped, returned].map(|text| run.stderr.find(&text));
    assert!(stopped.is_some() && stopped < returned, "{}", run.stderr);
}

#[test]
fn a_clock_that_is_seconds_off_is_reported() {
    let robot = Robot::new();
    let run = robot.drive("poses = \"ADDRESS\"", 30, |_, row, begin_unix_s| {
        vec![pose(row, begin_unix_s + 3.0)]
    });
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let place = format!("udp://{}", robot.address);
    for text in [
        format!("the times of all poses that came to {place} are "),
        " s or more ahead of this computer's clock; set both clocks".to_owned(),
        ": none came, or their times are not those of the images".to_owned(),
    ] {
        assert!(run.stderr.contains(&text), "{}", run.stderr);
    }
}

#[test]
fn addresses_that_cannot_be_are_refused_with_their_line() {
    let robot = Robot::new();
    let refused = |scene: String, parts: &[&str]| {
        let command = robot.place.command(scene, &["-o", "out", "--no-plots"]);
        Run::of(&mut with_stand_in(&robot.place, command)).refused(parts);
    };
    let line = "line 3: platforms.robot.poses: ";
    let images = format!("images = \"{}/frames\"\nfps = 25", data().display());
    let recorded = robot.scene("poses = \"ADDRESS\"");
    let recorded = recorded.replace(
        "video = \"udp://lab:5000/cam1\"\ninput.when_behind = \"wait\"",
        &images,
    );
    refused(
        recorded.clone(),
        &[
            line,
            "comes in while tracking, and the cameras on the platform are recordings; give a file",
        ],
    );
    // What is wrong with the address is found before any image is needed.
    for address in [
        "udp://localhost:7001",
        "udp://127.0.0.1",
        "udp://127.0.0.1:0",
        "tcp://127.0.0.1:7001",
        "udp://224.0.0.1:7001",
    ] {
        let scene = recorded.replace(&format!("udp://{}", robot.address), address);
        let check = scene.replace(&images, "video = \"udp://lab:5000/cam1\"");
        let fifo = robot.place.path("cam1.pipe");
        let writer = thread::spawn(move || {
            let mut pipe = File::create(fifo).unwrap();
            let image = vec![0; 3 * SIZE_PX.0 * SIZE_PX.1];
            let mut bytes = Stream::of(SIZE_PX).bytes;
            write_frame(&mut bytes, 1e6, &image);
            // The program may have ended.
            let _ = pipe.write_all(&bytes);
            pipe
        });
        refused(
            check,
            &[
                line,
                address,
                "allowed: udp://ADDRESS:PORT, an address of this computer in numbers",
            ],
        );
        writer.join().unwrap();
    }
}
