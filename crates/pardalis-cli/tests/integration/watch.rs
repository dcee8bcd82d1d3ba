//! `track --watch` under attack: a page that is served costs the run nothing.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, Stdio};

use tungstenite::Message;

use crate::common::{SCENE, Workplace};
use crate::send::{assert_is_row, json, place_of};

/// Tracks a scene with a page, into the folder `out`. Returns the program, its messages after the address of the page, and the host and port of that.
fn watched(place: &Workplace, scene: impl AsRef<[u8]>) -> (Child, BufReader<ChildStderr>, String) {
    let mut command = place.command(scene, &["-o", "out", "--watch"]);
    let command = command.stderr(Stdio::piped()).stdout(Stdio::null());
    let mut running = command.spawn().unwrap();
    let mut stderr = BufReader::new(running.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("Open http://") {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "no address");
    }
    let address = line.split("http://").nth(1).unwrap();
    let address = address.split('/').next().unwrap().to_owned();
    (running, stderr, address)
}

#[test]
fn a_thousand_idle_connections_and_nonsense_do_not_disturb_the_run() {
    let place = Workplace::with_frames(40);
    place.track_with(SCENE, &["-o", "alone"]).fine();
    let (mut running, mut stderr, address) = watched(&place, SCENE);
    let address = &*address;
    // The run may be over before the last of them.
    let mut idle: Vec<TcpStream> = (0..1000)
        .filter_map(|_| TcpStream::connect(address).ok())
        .collect();
    for (number, stream) in idle.iter_mut().enumerate().skip(500) {
        let _ = match number % 3 {
            0 => stream.write_all(b"\x00\xff\x16\x03"),
            1 => stream.write_all(format!("GET / HTTP/1.1\r\nHost: {address}\r\n").as_bytes()),
            _ => {
                stream.write_all(b"POST /api/rows HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n")
            }
        };
    }
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert!(running.wait().unwrap().success(), "{rest}");
    let bytes = |folder: &str| std::fs::read(place.path(&format!("{folder}/tracks.csv"))).unwrap();
    assert_eq!(bytes("alone"), bytes("out"));
    drop(idle);
}

#[test]
fn programs_read_the_estimates_over_a_websocket() {
    let Some(place) = crate::live::with_stream(40) else {
        return;
    };
    let scene = crate::live::video("ride.ts").replace(
        "video = \"ride.ts\"",
        "video = \"ride.ts\"\ninput.real_time = true",
    );
    let (mut running, mut stderr, address) = watched(&place, scene);
    let stream = TcpStream::connect(&address).unwrap();
    let request = format!("ws://{address}/lines");
    let (mut reader, _) = tungstenite::client(request, stream).unwrap();
    let mut messages = Vec::new();
    loop {
        match reader.read() {
            Ok(Message::Text(text)) => messages.push(json(&text)),
            Ok(Message::Ping(_)) => {}
            // The run is over, and says so.
            Ok(Message::Close(_)) => break,
            other => panic!("{other:?}"),
        }
    }
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert!(running.wait().unwrap().success(), "{rest}");
    let rows = place.rows();
    assert!(messages.len() > 10, "{}", messages.len());
    for message in &messages {
        assert_is_row(message, &rows);
    }
    let (first, last) = (&messages[0], &messages[messages.len() - 1]);
    let [from, to] = [first, last].map(|message| place_of(message, &rows));
    assert_eq!(to, rows.len() - 1);
    let missed = to - from + 1 - messages.len();
    assert_eq!(last["dropped"], missed);
}

#[test]
fn options_of_the_page_need_the_page() {
    let place = Workplace::with_frames(1);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    place
        .track_with(SCENE, &["-o", "out", "--watch", "--port", &port])
        .refused(&["another program has this port", "choose another --port"]);
    for option in [["--port", "4000"], ["--listen", "127.0.0.1"]] {
        place.track_with(SCENE, &option).refused(&["--watch"]);
    }
    place
        .track_with(SCENE, &["-o", "out", "--watch", "--listen", "203.0.113.1"])
        .refused(&[
            "203.0.113.1:0: the page cannot be served there",
            "--listen takes an address of this computer",
        ]);
}
