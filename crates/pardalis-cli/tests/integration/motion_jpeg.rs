//! Motion JPEG over HTTP, as sent by phones and simple network cameras, with the real program and the real ffmpeg.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use crate::common::{Workplace, scene_with};
use crate::live::with_stream;

const FRAMES: usize = 12;

/// The frame before which the camera pauses, and how long.
const PAUSE: (usize, Duration) = (8, Duration::from_millis(1500));

/// Answers one request with the images of a workplace. The client may close the connection before it has all.
fn send(connection: TcpStream, place: &Workplace) -> std::io::Result<()> {
    let mut request = BufReader::new(connection.try_clone()?);
    let mut line = String::new();
    while line != "\r\n" {
        line.clear();
        request.read_line(&mut line)?;
    }
    let mut connection = connection;
    connection.write_all(
        b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=--frame\r\n\r\n",
    )?;
    for number in 0..FRAMES {
        if number == PAUSE.0 {
            std::thread::sleep(PAUSE.1);
        }
        let image = fs::read(place.image(number))?;
        let head = format!(
            "--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
            image.len()
        );
        connection.write_all(&[head.as_bytes(), &image, b"\r\n"].concat())?;
    }
    Ok(())
}

#[test]
fn images_without_time_stamps_get_the_time_of_their_arrival() {
    let Some(place) = with_stream(FRAMES) else {
        return;
    };
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/video", server.local_addr().unwrap());
    let track = |settings: &str| {
        let lines = format!("video = \"{address}\"\n{settings}");
        let scene = scene_with("images = \"images\"\nfps = 25", &lines);
        std::thread::scope(|scope| {
            scope.spawn(|| send(server.accept().unwrap().0, &place));
            place.track(scene)
        })
    };
    let run = track("input.format = \"mpjpeg\"\ninput.when_behind = \"wait\"\ninput.reopen_s = 0");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let rows = place.rows();
    assert_eq!(rows.len(), FRAMES);
    let times: Vec<f64> = rows.iter().map(|row| row[1].parse().unwrap()).collect();
    assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
    // A rate of 25 per second would give 0.04 s.
    let pause_s = times[PAUSE.0] - times[PAUSE.0 - 1];
    assert!(pause_s > 0.7, "{times:?}");
    // ffmpeg recognises the format, and would invent the times.
    track("").refused(&[
        "line 3: cameras.cam1.video",
        "sends single JPEG images without time stamps; give input.format = \"mpjpeg\"",
    ]);
}
