//! Files, pipes and servers: what is opened, what is refused, and how a source ends.

use std::thread::JoinHandle;

use super::*;
use pardalis_scene::{Protocol, VideoFormat};

#[test]
fn unreadable_inputs_are_named_in_errors() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let text = path_in(&folder, "text.mp4");
    std::fs::write(&text, "no video").expect("written");
    let sound = path_in(&folder, "sound.mp4");
    ffmpeg(&["-f", "lavfi", "-i", "sine=duration=0.1", &sound]);
    let whole = clip(
        &folder,
        "whole.mp4",
        &["-c:v", "libx264", "-pix_fmt", "yuv420p"],
    );
    let half = path_in(&folder, "half.mp4");
    let bytes = std::fs::read(&whole).expect("read");
    std::fs::write(&half, &bytes[..bytes.len() / 2]).expect("written");
    for (input, expected) in [
        ("/nonexistent/a.mp4", "No such file"),
        (&text, "cannot open it"),
        (&sound, "no video stream"),
        (&half, "moov atom not found"),
        ("", "cannot open it"),
    ] {
        let error = Source::open(&config(input))
            .err()
            .expect(expected)
            .to_string();
        assert!(
            error.starts_with(input) && error.contains(expected),
            "{error}"
        );
    }
}

#[test]
fn files_that_name_other_files_are_refused_whatever_they_are_called() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let codec = ["-c:v", "libx264", "-pix_fmt", "yuv420p"];
    let secret = clip(&folder, "secret.mp4", &codec);
    let stream = clip(&folder, "secret.ts", &codec);
    let playlist =
        format!("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{stream}\n#EXT-X-ENDLIST\n");
    let session = "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\n\
                   m=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n";
    for (name, text) in [
        ("concat", "ffconcat version 1.0\nfile 'secret.mp4'\n"),
        ("hls", &playlist),
        ("session", session),
    ] {
        for extension in ["mp4", "m3u8", "txt"] {
            let path = path_in(&folder, &format!("{name}.{extension}"));
            std::fs::write(&path, text).expect("written");
            let error = error_of(&config(&path));
            assert!(error.contains("its content names other files"), "{error}");
        }
    }
    let manifest = "<?xml version=\"1.0\"?>\n<MPD xmlns=\"urn:mpeg:dash:schema:mpd:2011\" type=\"static\"><Period>\
                    <AdaptationSet><Representation id=\"1\" mimeType=\"video/mp4\"><BaseURL>secret.mp4</BaseURL>\
                    </Representation></AdaptationSet></Period></MPD>";
    let graph = "testsrc=size=320x240:rate=25,metadata=print:file=written.txt";
    for (name, text) in [("dash.mpd", manifest), ("graph.lavfi", graph)] {
        let path = path_in(&folder, name);
        std::fs::write(&path, text).expect("written");
        error_of(&config(&path));
    }
    // Protocols of ffmpeg that wrap others are parts of file names.
    for name in [
        format!("concat:{secret}"),
        format!("subfile,,start,0,end,0,,:{secret}"),
        format!("crypto:{secret}"),
        format!("async:file:{secret}"),
        format!("cache:file:{secret}"),
        format!("file:{secret}"),
        "data:video/mp4;base64,AAAA".to_owned(),
        "pipe:0".to_owned(),
    ] {
        let error = error_of(&config(&name));
        assert!(error.contains("No such file"), "{error}");
    }
    assert_eq!(read(&config(&secret)).1.len(), 6);
}

/// A web server on this machine: answers every request for a path that ends in the name with the text.
fn server(answers: Vec<(&'static str, String)>) -> String {
    use std::io::{BufRead, BufReader, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://{}", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.expect("a connection");
            let mut lines = BufReader::new(stream.try_clone().expect("a copy")).lines();
            let request = lines.next().and_then(Result::ok).unwrap_or_default();
            // Until the empty line.
            lines.find(|line| line.as_ref().map_or(true, String::is_empty));
            let path = request.split(' ').nth(1).unwrap_or_default();
            let answer = answers.iter().find(|(name, _)| path.ends_with(name));
            let answer = answer.map_or("HTTP/1.0 404 None\r\n\r\n", |(_, answer)| answer);
            // ffmpeg may hang up before it has read everything.
            let _ = stream.write_all(answer.as_bytes());
        }
    });
    address
}

#[test]
fn servers_cannot_make_ffmpeg_open_files() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let secret = clip(
        &folder,
        "secret.ts",
        &["-c:v", "libx264", "-pix_fmt", "yuv420p"],
    );
    let found = "HTTP/1.0 200 OK\r\n\r\n";
    let address = server(vec![
        (
            "moved",
            format!("HTTP/1.0 302 Found\r\nLocation: file://{secret}\r\n\r\n"),
        ),
        (
            "list",
            format!("{found}ffconcat version 1.0\nfile '{secret}'\n"),
        ),
        (
            "live.m3u8",
            format!(
                "{found}#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{secret}\n#EXT-X-ENDLIST\n"
            ),
        ),
    ]);
    for name in ["moved", "list", "live.m3u8"] {
        let url = format!("{address}/{name}");
        let source = SourceConfig {
            kind: SourceKind::Video {
                video: VideoInput {
                    place: VideoPlace::Address(Protocol::Http, url.clone()),
                    settings: VideoSettings::default(),
                },
                encoding: None,
            },
            ..config("")
        };
        let error = error_of(&source);
        assert!(error.starts_with(&url), "{error}");
    }
}

#[test]
fn a_source_dropped_early_ends_ffmpeg() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let long = path_in(&folder, "long.nut");
    let clip = "testsrc=size=320x240:rate=25:duration=60";
    ffmpeg(&["-f", "lavfi", "-i", clip, "-c:v", "mjpeg", &long]);
    let settings = VideoSettings {
        real_time: true,
        ..VideoSettings::default()
    };
    let mut source = Source::open(&opened(&long, settings)).expect("opens");
    assert_eq!((source.size(), source.frame_count()), ((320, 240), None));
    assert!(source.next().is_some_and(|frame| frame.is_ok()));
    // Waits for ffmpeg and the thread: this must return.
    drop(source);
}

#[test]
fn a_change_of_size_is_an_error() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let mut bytes = Vec::new();
    for size in ["scale=320:240", "scale=240:320", "scale=160:120"] {
        let part = clip(&folder, "part.mjpeg", &["-vf", size, "-f", "mjpeg"]);
        bytes.push(std::fs::read(part).expect("read"));
    }
    let settings = VideoSettings {
        format: Some(VideoFormat::Mjpeg),
        fps: Some(25.0),
        ..VideoSettings::default()
    };
    let path = path_in(&folder, "parts.mjpeg");
    std::fs::write(&path, [&*bytes[0], &*bytes[2]].concat()).expect("written");
    let source = Source::open(&opened(&path, settings)).expect("opens");
    let frames: Vec<_> = source.collect();
    assert_eq!(frames.len(), 7);
    let error = frames[6].as_ref().expect_err("of another size").to_string();
    assert!(error.contains("frame 6 is not 320 x 240 pixels"), "{error}");
}

/// Creates a pipe with a name and writes a file into it, once.
#[cfg(unix)]
fn pipe_of(folder: &TempDir, file: &str) -> (String, JoinHandle<()>) {
    let pipe = path_in(folder, "pipe");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.expect("mkfifo runs").success());
    let (from, to) = (file.to_owned(), pipe.clone());
    let writer = std::thread::spawn(move || {
        let bytes = std::fs::read(from).expect("read");
        std::fs::write(to, bytes).expect("read to its end");
    });
    (pipe, writer)
}

#[cfg(unix)]
#[test]
fn pipes_are_opened_once_and_deliver_the_same_as_files() {
    if programs().is_none() {
        return;
    }
    for (name, arguments) in [
        (
            "h264.ts",
            &["-c:v", "libx264", "-pix_fmt", "yuv420p", "-bf", "2"][..],
        ),
        (
            "hd.mkv",
            &[
                "-vf",
                "scale=1280:720",
                "-c:v",
                "libx264",
                "-pix_fmt",
                "yuv420p",
            ],
        ),
        ("420.avi", &["-c:v", "mjpeg", "-pix_fmt", "yuvj420p"]),
        (
            "422.avi",
            &[
                "-vf",
                "scale=162:119",
                "-c:v",
                "mjpeg",
                "-pix_fmt",
                "yuvj422p",
            ],
        ),
        ("nv12.nut", &["-c:v", "rawvideo", "-pix_fmt", "nv12"]),
        ("bgr.nut", &["-c:v", "rawvideo", "-pix_fmt", "bgr24"]),
        ("gray.nut", &["-c:v", "rawvideo", "-pix_fmt", "gray"]),
    ] {
        let folder = TempDir::new().expect("a folder");
        let file = clip(&folder, name, arguments);
        let (wanted, wanted_s, wanted_bytes, _) = read(&config(&file));
        let (pipe, writer) = pipe_of(&folder, &file);
        let (found, found_s, found_bytes, _) = read(&config(&pipe));
        writer.join().expect("written");
        assert_eq!(found_s, wanted_s, "{name}");
        assert!(found_bytes == wanted_bytes, "{name}");
        let of = |d: &Description| (d.size_px, d.pixel_format, d.encoding);
        assert_eq!(of(&found), of(&wanted), "{name}");
        let codec = wanted.content.split(' ').next().expect("a word");
        assert!(found.content.starts_with(codec), "{found:?}");
        assert_eq!(found.frame_count, None);
    }
}

#[cfg(unix)]
#[test]
fn playlists_in_pipes_are_refused() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let list = path_in(&folder, "list");
    std::fs::write(&list, "ffconcat version 1.0\nfile 'secret.mp4'\n").expect("written");
    let (pipe, _) = pipe_of(&folder, &list);
    let error = error_of(&config(&pipe));
    assert!(error.contains("its content names other files"), "{error}");
}

/// Returns the source of a stream from a server on this machine.
fn tcp(listener: &std::net::TcpListener, timeout_s: f64) -> SourceConfig {
    let address = format!("tcp://{}", listener.local_addr().expect("an address"));
    SourceConfig {
        kind: SourceKind::Video {
            video: VideoInput {
                place: VideoPlace::Address(Protocol::Tcp, address),
                settings: VideoSettings {
                    timeout_s: Some(timeout_s),
                    ..VideoSettings::default()
                },
            },
            encoding: None,
        },
        ..config("")
    }
}

#[test]
fn a_server_for_one_client_is_connected_once() {
    use std::io::Write;
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let file = clip(
        &folder,
        "clip.ts",
        &["-c:v", "libx264", "-pix_fmt", "yuv420p"],
    );
    let bytes = std::fs::read(&file).expect("read");
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let source = tcp(&listener, 20.0);
    let server = std::thread::spawn(move || {
        let (mut client, _) = listener.accept().expect("a client");
        // Nobody else is accepted.
        drop(listener);
        client.write_all(&bytes).expect("sent");
    });
    let (_, times_s, _, _) = read(&source);
    server.join().expect("served");
    assert_eq!(times_s, read(&config(&file)).1);
}

#[test]
fn a_source_without_frames_ends_the_wait() {
    if programs().is_none() {
        return;
    }
    // It accepts the connection and sends nothing.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let error = error_of(&tcp(&listener, 0.5));
    assert!(error.contains("no frame came within 0.5 s"), "{error}");
    let address = listener.local_addr().expect("an address");
    drop(listener);
    let closed = std::net::TcpListener::bind(address).expect("the same port");
    let source = tcp(&closed, 20.0);
    drop(closed);
    let error = error_of(&source);
    assert!(error.contains("Connection refused"), "{error}");
}
