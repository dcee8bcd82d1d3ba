//! Live sources that end, fall silent and come back, and sessions that Ctrl-C ends.
#![cfg(unix)]

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use crate::common::run::{interrupt, wait_for_lines};
use crate::common::{
    FRONT_LANDMARK, PLANE_ROBOT, REAR_LANDMARK, Run, Workplace, rows_in, scene_with,
};
use crate::live::{video, with_stream};

/// More than ffmpeg examines before it delivers the first.
const FRAMES: usize = 40;

/// Returns a scene with the stream of a server that is opened again, with further settings.
fn stream_of(server: &TcpListener, settings: &str) -> String {
    let address = server.local_addr().unwrap();
    let lines = format!("video = \"tcp://{address}\"\n{settings}");
    scene_with("images = \"images\"\nfps = 25", &lines)
}

/// Tracks the stream of a server while `serve` answers connections.
fn track_while(
    place: &Workplace,
    settings: &str,
    serve: impl FnOnce(&TcpListener, Vec<u8>) + Send + 'static,
) -> Run {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let scene = stream_of(&server, settings);
    let stream = fs::read(place.path("ride.ts")).unwrap();
    let served = std::thread::spawn(move || serve(&server, stream));
    let run = place.track(scene);
    served.join().unwrap();
    run
}

/// Waits until the client closes the connection.
fn wait_until_closed(mut connection: TcpStream) {
    let _ = connection.read_to_end(&mut Vec::new());
}

/// Checks that the stream was tracked twice, at times that increase by a frame's interval but once.
#[track_caller]
fn assert_tracked_twice(place: &Workplace, run: &Run) {
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let times: Vec<f64> = place
        .rows()
        .iter()
        .map(|row| row[1].parse().unwrap())
        .collect();
    assert_eq!(times.len(), 2 * FRAMES, "{}", run.stderr);
    let steps: Vec<f64> = times.array_windows().map(|[a, b]| b - a).collect();
    let is_regular = |step: &&f64| (**step - 0.04).abs() < 1e-6;
    assert_eq!(
        steps.iter().filter(is_regular).count(),
        2 * FRAMES - 2,
        "{steps:?}"
    );
    // The pause before the second attempt.
    assert!(steps[FRAMES - 1] > 0.4, "{steps:?}");
    let summary = fs::read(place.path("out/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["cameras"]["cam1"]["reopened"], 1);
}

#[test]
fn a_stream_that_ends_is_opened_again_and_its_times_go_on() {
    let Some(place) = with_stream(FRAMES) else {
        return;
    };
    let run = track_while(&place, "input.reopen_s = 4", |server, stream| {
        for _ in 0..2 {
            let (mut connection, _) = server.accept().unwrap();
            connection.write_all(&stream).unwrap();
        }
    });
    assert_tracked_twice(&place, &run);
    let lines: Vec<&str> = run.stderr.lines().collect();
    for wanted in [
        "ended; opening it again for 4 s",
        "is back after ",
        "stopped: tcp://127.0.0.1:",
        "did not come back within 4 s",
    ] {
        assert!(
            lines.iter().any(|line| line.contains(wanted)),
            "{wanted}: {}",
            run.stderr
        );
    }
    // Without the key, a stream of TCP ends with its connection.
    let run = track_while(&place, "", |server, stream| {
        let (mut connection, _) = server.accept().unwrap();
        connection.write_all(&stream).unwrap();
    });
    assert_eq!((run.code, &*run.stderr), (Some(0), ""));
    assert_eq!(place.rows().len(), FRAMES);
}

#[test]
fn a_stream_that_falls_silent_is_opened_again() {
    let Some(place) = with_stream(FRAMES) else {
        return;
    };
    let settings = "input.reopen_s = 2\ninput.timeout_s = 6";
    let run = track_while(&place, settings, |server, stream| {
        let (mut silent, _) = server.accept().unwrap();
        silent.write_all(&stream).unwrap();
        wait_until_closed(silent);
        let (mut connection, _) = server.accept().unwrap();
        connection.write_all(&stream).unwrap();
    });
    // Frames that the decoder held back when it was ended are lost.
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(
        run.stderr
            .contains("no frame came for 6 s; opening it again for 2 s"),
        "{}",
        run.stderr
    );
    assert!(run.stderr.contains("is back after "), "{}", run.stderr);
    assert!(place.rows().len() > FRAMES, "{}", place.rows().len());
}

#[test]
fn a_stream_that_comes_back_with_another_size_is_refused() {
    let Some(place) = with_stream(FRAMES) else {
        return;
    };
    let scaled = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-i", "ride.ts", "-vf", "scale=320:240"])
        .args(["-c:v", "libx264", "-preset", "ultrafast", "small.ts"])
        .status();
    assert!(scaled.unwrap().success());
    let small = fs::read(place.path("small.ts")).unwrap();
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let scene = stream_of(&server, "input.reopen_s = 4");
    let stream = fs::read(place.path("ride.ts")).unwrap();
    let is_over = AtomicBool::new(false);
    let run = std::thread::scope(|scope| {
        scope.spawn(|| {
            let (mut connection, _) = server.accept().unwrap();
            connection.write_all(&stream).unwrap();
            drop(connection);
            while !is_over.load(Ordering::SeqCst) {
                let (mut connection, _) = server.accept().unwrap();
                // The program closes the connection when it has seen the size.
                let _ = connection.write_all(&small);
            }
        });
        let run = place.track(scene);
        is_over.store(true, Ordering::SeqCst);
        drop(TcpStream::connect(server.local_addr().unwrap()));
        run
    });
    assert_eq!(place.rows().len(), FRAMES);
    let reason = "came back with 320 x 240 pixels in yuvj420p, and not with 640 x 480 pixels";
    assert!(run.stderr.contains(reason), "{}", run.stderr);
}

#[test]
fn ctrl_c_is_the_normal_end_of_a_live_session() {
    let Some(place) = with_stream(FRAMES) else {
        return;
    };
    let mut command = place.command(video("-"), &["-o", "out"]);
    let command = command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut program = command.stderr(Stdio::piped()).spawn().unwrap();
    // The stream goes on, because the pipe stays open.
    let mut camera = program.stdin.take().unwrap();
    camera
        .write_all(&fs::read(place.path("ride.ts")).unwrap())
        .unwrap();
    let tracks = place.path("out/tracks.csv");
    wait_for_lines(&mut program, &tracks, 5);
    let run = interrupt(program).fine();
    drop(camera);
    let rows = rows_in(&fs::read_to_string(&tracks).unwrap()).len();
    assert!((4..=FRAMES).contains(&rows), "{rows}");
    let summary = format!("processed {rows} frames");
    assert!(run.stdout.starts_with(&summary), "{}", run.stdout);
    assert!(
        run.stdout.contains("\nended on request\n"),
        "{}",
        run.stdout
    );
    // The plots are there as well.
    assert!(place.path("out/above.png").exists());
}

#[test]
fn a_camera_that_a_rectangle_calibrates_is_opened_once() {
    let place = Workplace::with_frames(0);
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    let data = data.canonicalize().unwrap();
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-framerate", "15", "-i"])
        .arg(data.join("plane-robot/frames/%06d.jpg"))
        .args(["-frames:v", "20", "-c:v", "libx264", "-preset", "ultrafast"])
        .args(["-crf", "4", "-pix_fmt", "yuv420p", "ride.ts"])
        .status();
    if !encoded.is_ok_and(|status| status.success()) {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let source = format!("video = \"tcp://{}\"", server.local_addr().unwrap());
    let points = PLANE_ROBOT.find("points = [").unwrap();
    let center = PLANE_ROBOT.find("camera_center_m").unwrap();
    let rectangle = "rectangle.corners_m = [[-0.8452467, -0.2679295], [1.1498814, -0.1284166], \
                     [1.0452467, 1.3679295], [-0.9498814, 1.2284166]]\n";
    let scene = [&PLANE_ROBOT[..points], rectangle, &PLANE_ROBOT[center..]].concat();
    let scene = [&*scene, FRONT_LANDMARK, REAR_LANDMARK]
        .concat()
        .replace("images = \"DATA/plane-robot/frames\"\nfps = 15", &source)
        .replace("DATA", data.to_str().unwrap());
    let stream = fs::read(place.path("ride.ts")).unwrap();
    // A second connection is refused.
    let served = std::thread::spawn(move || {
        let (mut connection, _) = server.accept().unwrap();
        drop(server);
        connection.write_all(&stream).unwrap();
    });
    let run = place.track(scene);
    served.join().unwrap();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    // The frames in which the rectangle was found are tracked as well.
    assert_eq!(place.rows().len(), 20, "{}", run.stderr);
    let summary = fs::read(place.path("out/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    let found = &summary["settings"]["cameras"]["mast"]["found_corners_px"];
    for (corner, wanted) in [
        [184.34, 327.52],
        [448.73, 304.71],
        [402.42, 198.82],
        [195.57, 212.70],
    ]
    .into_iter()
    .enumerate()
    {
        for axis in 0..2 {
            let off_px = found[corner][axis].as_f64().unwrap() - wanted[axis];
            assert!(off_px.abs() < 0.5, "{found}");
        }
    }
}
