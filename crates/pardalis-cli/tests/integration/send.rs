//! `track --send`: estimates for other programs while tracking.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::{TcpListener, UdpSocket};
use std::time::Duration;

use serde_json::Value;

use crate::common::{SCENE, Workplace};

/// Frames of the sequence.
const FRAMES: u64 = 12;

pub(crate) fn json(line: &str) -> Value {
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"))
}

/// Returns the place of the row of a message's frame.
pub(crate) fn place_of(message: &Value, rows: &[Vec<String>]) -> usize {
    let frame = message["frame"].to_string();
    let place = rows.iter().position(|row| row[0] == frame);
    place.unwrap_or_else(|| panic!("no row for {message}"))
}

/// Checks that a message says of its frame what the row of the frame says.
pub(crate) fn assert_is_row(message: &Value, rows: &[Vec<String>]) {
    let row = &rows[place_of(message, rows)];
    let [target] = &message["targets"].as_array().unwrap()[..] else {
        panic!("{message}")
    };
    assert_eq!(target["name"], row[2]);
    assert_eq!(target["state"], row[3]);
    assert_eq!(
        message["time_s"].as_f64().unwrap(),
        row[1].parse::<f64>().unwrap()
    );
    for axis in 0..3 {
        let position_m: f64 = row[4 + axis].parse().unwrap();
        let sent_m = target["position_m"][axis].as_f64().unwrap();
        // This reader of JSON may round otherwise in the last bit.
        assert!((sent_m - position_m).abs() < 1e-12, "{message} {row:?}");
    }
    for (entry, cell) in row[25..31].iter().enumerate() {
        let variance_m2ps2: f64 = cell.parse().unwrap();
        let sent_m2ps2 = target["velocity_covariance_m2ps2"][entry].as_f64().unwrap();
        assert!(
            (sent_m2ps2 - variance_m2ps2).abs() < 1e-12,
            "{message} {row:?}"
        );
    }
}

#[test]
fn datagrams_carry_the_rows_and_what_was_dropped_is_counted() {
    let place = Workplace::with_frames(FRAMES as usize);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(5)))
        .unwrap();
    let to = format!("udp://{}", socket.local_addr().unwrap());
    let alone = place.track_with(SCENE, &["-o", "alone"]).fine();
    let run = place
        .track_with(SCENE, &["-o", "out", "--send", &to])
        .fine();
    assert!(!alone.stdout.contains("estimates"), "{}", alone.stdout);
    let rows = place.rows();
    let mut messages = Vec::new();
    while messages
        .last()
        .is_none_or(|last: &Value| last["frame"] != FRAMES - 1)
    {
        let mut bytes = [0; 8192];
        let length = socket.recv(&mut bytes).unwrap();
        messages.push(json(std::str::from_utf8(&bytes[..length]).unwrap()));
    }
    for message in &messages {
        assert_is_row(message, &rows);
    }
    // Each is newer than those before, and the last knows how many are missing.
    let frames: Vec<u64> = messages
        .iter()
        .map(|m| m["frame"].as_u64().unwrap())
        .collect();
    assert!(frames.is_sorted_by(|a, b| a < b), "{frames:?}");
    let dropped = messages.last().unwrap()["dropped"].as_u64().unwrap();
    assert_eq!(messages.len() as u64 + dropped, FRAMES);
    let counts = format!("{to}: sent {} estimates, dropped {dropped}", messages.len());
    assert!(run.stdout.contains(&counts), "{}", run.stdout);
    // Seconds since 1970, later from line to line.
    // A recording was captured at another time.
    assert!(messages.iter().all(|m| m["captured_unix_s"].is_null()));
    let sent_s: Vec<f64> = messages
        .iter()
        .map(|m| m["sent_unix_s"].as_f64().unwrap())
        .collect();
    assert!(sent_s[0] > 1.7e9 && sent_s.is_sorted(), "{sent_s:?}");
    let bytes = |folder: &str| std::fs::read(place.path(&format!("{folder}/tracks.csv"))).unwrap();
    assert_eq!(bytes("alone"), bytes("out"));
}

#[test]
fn a_receiver_that_hangs_up_gets_whole_lines_when_it_returns() {
    let place = Workplace::with_frames(FRAMES as usize);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let to = format!("tcp://{}", listener.local_addr().unwrap());
    let receiver = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        let mut first = String::new();
        BufReader::new(stream).read_line(&mut first).unwrap();
        // The connection is closed, perhaps in the middle of a line.
        let mut second = String::new();
        listener.set_nonblocking(true).unwrap();
        for _ in 0..1000 {
            if let Ok((mut stream, _)) = listener.accept() {
                stream.set_nonblocking(false).unwrap();
                stream.read_to_string(&mut second).unwrap();
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        (first, second)
    });
    // At the rate of a camera, so that it goes on for a while.
    let clip = "images/%06d.jpg";
    let encoded = std::process::Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args([
            "-v",
            "error",
            "-stream_loop",
            "9",
            "-framerate",
            "25",
            "-i",
            clip,
        ])
        .args([
            "-c:v",
            "libx264",
            "-preset",
            "ultrafast",
            "-pix_fmt",
            "yuvj420p",
            "ride.mkv",
        ])
        .status();
    let scene = if encoded.is_ok_and(|status| status.success()) {
        let live = "video = \"ride.mkv\"\ninput.real_time = true";
        crate::common::scene_with("images = \"images\"\nfps = 25", live)
    } else {
        println!("skipped: ffmpeg is not installed");
        return;
    };
    let run = place
        .track_with(scene, &["-o", "out", "--send", &to])
        .fine();
    let rows = place.rows();
    assert!(run.stdout.contains("latency: median "), "{}", run.stdout);
    let (first, second) = receiver.join().unwrap();
    assert_is_row(&json(&first), &rows);
    assert!(second.ends_with('\n'), "{second}");
    assert!(second.lines().count() > 10, "{second}");
    for line in second.lines() {
        assert_is_row(&json(line), &rows);
    }
    for line in second.lines() {
        let line = json(line);
        let times = ["captured_unix_s", "sent_unix_s"].map(|key| line[key].as_f64().unwrap());
        // Captured before it was sent, and not long ago.
        assert!(times[0] <= times[1] && times[1] - times[0] < 60.0, "{line}");
    }
    let summary = std::fs::read_to_string(place.path("out/summary.json")).unwrap();
    let latency = &json(&summary)["time"]["latency"];
    let [median_s, p99_s, max_s] =
        ["median_s", "p99_s", "max_s"].map(|key| latency[key].as_f64().unwrap());
    assert!(
        0.0 < median_s && median_s <= p99_s && p99_s <= max_s,
        "{latency}"
    );
    let last = json(second.lines().last().unwrap());
    assert_eq!(place_of(&last, &rows), rows.len() - 1);
    assert!(last["dropped"].as_u64().unwrap() > 0);
}

#[test]
fn a_receiver_that_is_not_there_costs_nothing() {
    let place = Workplace::with_frames(FRAMES as usize);
    // A port that is closed again.
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let to = format!("tcp://{port}");
    let run = place
        .track_with(SCENE, &["-o", "out", "--send", &to])
        .fine();
    assert_eq!(place.rows().len() as u64, FRAMES);
    let counts = format!("{to}: sent 0 estimates, dropped {FRAMES} (Connection refused");
    let remedy = "; start the receiver, or check address and port)";
    assert!(run.stdout.contains(remedy), "{}", run.stdout);
    assert!(run.stdout.contains(&counts), "{}", run.stdout);
}

#[test]
fn addresses_that_cannot_be_right_are_refused() {
    let place = Workplace::with_frames(1);
    for to in ["udp://127.0.0.1", "http://127.0.0.1:80", "udp://:9"] {
        place
            .track_with(SCENE, &["-o", "out", "--send", to])
            .refused(&["allowed: udp://HOST:PORT or tcp://HOST:PORT"]);
    }
    place
        .track_with(SCENE, &["-o", "out", "--send", "ws://127.0.0.1:80"])
        .refused(&["a WebSocket is served with --watch"]);
    place
        .track_with(
            SCENE,
            &["-o", "out", "--send", "udp://no-such-host.invalid:9"],
        )
        .refused(&["the host is not known", "check its name"]);
}
