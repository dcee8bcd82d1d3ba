use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::Command;
use std::thread::JoinHandle;

use tempfile::TempDir;

use super::*;
use crate::source::{Clock, Counters, Delivery, Source, SourceConfig, SourceKind};
use pardalis::Frame;
use pardalis_scene::{FrameRange, Protocol, VideoFormat, VideoPlace, VideoSettings};

/// Returns the installed programs; prints a note and returns `None` if these tests cannot run.
fn programs() -> Option<Programs> {
    let found = Programs::find(&std::env::var_os("PATH").unwrap_or_default()).ok();
    if found.is_none() {
        println!("skipped: ffmpeg is not installed");
    }
    found
}

/// Runs ffmpeg, which must succeed, and returns its standard output.
fn ffmpeg(arguments: &[&str]) -> Vec<u8> {
    let output = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-nostdin", "-y"])
        .args(arguments)
        .output()
        .expect("ffmpeg runs");
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

fn sequence() -> String {
    format!(
        "{}/../../data/dioptric-jump/frames",
        env!("CARGO_MANIFEST_DIR")
    )
}

fn path_in(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).to_string_lossy().into_owned()
}

/// Creates a clip of the sequence's first six frames with these arguments.
fn clip(folder: &TempDir, name: &str, arguments: &[&str]) -> String {
    let path = path_in(folder, name);
    let pattern = format!("{}/%06d.jpg", sequence());
    let input = ["-framerate", "25", "-i", &pattern, "-frames:v", "6"];
    ffmpeg(&[&input, arguments, &[path.as_str()]].concat());
    path
}

fn config(input: &str) -> SourceConfig {
    SourceConfig {
        kind: SourceKind::Video {
            video: VideoInput::of_path(input),
            encoding: None,
        },
        time_offset_s: 0.0,
        frames: FrameRange::ALL,
    }
}

/// A file that is opened with these settings.
fn opened(path: &str, settings: VideoSettings) -> SourceConfig {
    SourceConfig {
        kind: SourceKind::Video {
            video: VideoInput {
                place: VideoPlace::File(path.to_owned()),
                settings,
            },
            encoding: None,
        },
        ..config(path)
    }
}

/// Unwraps a frame; a video has no broken images that could be skipped.
fn frame_of(delivery: Delivery) -> Frame {
    match delivery {
        Delivery::Frame { frame, .. } => frame,
        Delivery::Broken(why) => panic!("{why}"),
    }
}

/// Reads the whole source: its description, all time stamps, all bytes and the statistics. Every frame must be valid.
fn read(config: &SourceConfig) -> (Description, Vec<f64>, Vec<u8>, Counters) {
    let mut source = Source::open(config).expect("opens");
    let (mut times, mut bytes) = (Vec::new(), Vec::new());
    for frame in source.by_ref() {
        let frame = frame_of(frame.expect("a frame"));
        times.push(frame.time_s());
        bytes.extend_from_slice(frame.bytes());
    }
    (source.describe().clone(), times, bytes, source.counters())
}

#[test]
fn pixels_are_delivered_in_the_streams_own_format() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    for (name, codec, pix_fmt, format) in [
        ("h264.mp4", "libx264", "yuv420p", PixelFormat::I420),
        ("mjpeg.avi", "mjpeg", "yuvj420p", PixelFormat::I420),
        ("nv12.nut", "rawvideo", "nv12", PixelFormat::Nv12),
        ("yuyv.avi", "rawvideo", "yuyv422", PixelFormat::Yuyv),
        ("uyvy.nut", "rawvideo", "uyvy422", PixelFormat::Uyvy),
        ("rgb.nut", "rawvideo", "rgb24", PixelFormat::Rgb8),
    ] {
        // An odd size, where chroma is rounded up; H.264 takes even ones only.
        let size = if codec == "libx264" {
            "scale=162:120"
        } else {
            "scale=161:119"
        };
        let path = clip(
            &folder,
            name,
            &["-vf", size, "-c:v", codec, "-pix_fmt", pix_fmt],
        );
        let (description, times, bytes, counters) = read(&config(&path));
        assert_eq!(description.pixel_format, format, "{name}");
        assert!(
            description
                .content
                .ends_with(&format!("video in {pix_fmt}")),
            "{description:?}"
        );
        let expected = ffmpeg(&["-i", &path, "-f", "rawvideo", "-pix_fmt", pix_fmt, "-"]);
        assert!(!bytes.is_empty() && bytes == expected, "{name}");
        let expected: Vec<f64> = (0..6).map(|frame| f64::from(frame) / 25.0).collect();
        assert_eq!(times, expected, "{name}");
        assert_eq!(counters.ffmpeg_errors, 0, "{name}");
    }
}

#[test]
fn planar_422_is_packed_without_loss_in_both_ranges() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    for (name, codec, pix_fmt, range) in [
        ("full.avi", "mjpeg", "yuvj422p", YuvRange::Full),
        ("limited.nut", "rawvideo", "yuv422p", YuvRange::Limited),
    ] {
        let path = clip(&folder, name, &["-c:v", codec, "-pix_fmt", pix_fmt]);
        let (description, _, bytes, _) = read(&config(&path));
        assert_eq!(description.pixel_format, PixelFormat::Yuyv);
        assert!(
            description.content.contains("converted to yuyv422"),
            "{description:?}"
        );
        assert_eq!(
            description.encoding.map(|encoding| encoding.range),
            Some(range)
        );
        let planar = ffmpeg(&["-i", &path, "-f", "rawvideo", "-pix_fmt", pix_fmt, "-"]);
        let count = 640 * 480;
        for (packed, planar) in bytes.chunks(2 * count).zip(planar.chunks(2 * count)) {
            assert!(packed.iter().step_by(2).eq(&planar[..count]), "{name}: Y");
            assert!(
                packed
                    .iter()
                    .skip(1)
                    .step_by(4)
                    .eq(&planar[count..count + count / 2]),
                "{name}: U"
            );
            assert!(
                packed
                    .iter()
                    .skip(3)
                    .step_by(4)
                    .eq(&planar[count + count / 2..]),
                "{name}: V"
            );
        }
    }
}

#[test]
fn unsupported_formats_are_converted_to_rgb() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let exact = clip(
        &folder,
        "rgb.nut",
        &["-c:v", "rawvideo", "-pix_fmt", "rgb24"],
    );
    let (_, _, rgb, _) = read(&config(&exact));
    for pix_fmt in ["bgr24", "rgba"] {
        let path = clip(
            &folder,
            "other.nut",
            &["-c:v", "rawvideo", "-pix_fmt", pix_fmt],
        );
        let (description, _, bytes, _) = read(&config(&path));
        assert_eq!(
            (description.pixel_format, description.encoding),
            (PixelFormat::Rgb8, None)
        );
        assert!(bytes == rgb, "{pix_fmt}");
    }
    // 4:4:4 in each encoding: equal to our own conversion except for rounding.
    let path = clip(
        &folder,
        "444.nut",
        &["-c:v", "rawvideo", "-pix_fmt", "yuv444p"],
    );
    let planes = ffmpeg(&["-i", &path, "-f", "rawvideo", "-pix_fmt", "yuv444p", "-"]);
    let count = 640 * 480;
    for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
        for range in [YuvRange::Full, YuvRange::Limited] {
            let encoding = YuvEncoding { matrix, range };
            let mut config = config(&path);
            if let SourceKind::Video {
                encoding: given, ..
            } = &mut config.kind
            {
                *given = Some(encoding);
            }
            let (_, _, bytes, _) = read(&config);
            for i in (0..count).step_by(97) {
                let yuv = [planes[i], planes[count + i], planes[2 * count + i]];
                let expected = encoding.rgb8_from_yuv(yuv);
                for c in 0..3 {
                    let found = bytes[3 * i + c];
                    assert!(
                        found.abs_diff(expected[c]) <= 2,
                        "{encoding:?} {yuv:?} {expected:?} {found}"
                    );
                }
            }
        }
    }
}

#[test]
fn time_stamps_are_those_of_the_stream() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let durations = ["0.04", "0.003", "0.004", "0.5", "0.04"];
    let list = durations
        .iter()
        .enumerate()
        .fold("ffconcat version 1.0\n".to_owned(), |list, (i, d)| {
            list + &format!("file '{}/{i:06}.jpg'\nduration {d}\n", sequence())
        });
    let list_path = path_in(&folder, "list.txt");
    std::fs::write(&list_path, list).expect("written");
    let path = path_in(&folder, "odd:name %d.mkv");
    let output = format!("file:{path}");
    // The first time differs from zero, and the frame rate varies.
    ffmpeg(&[
        "-f",
        "concat",
        "-safe",
        "0",
        "-i",
        &list_path,
        "-vf",
        "settb=1/1000,setpts=PTS+7.3/TB",
        "-fps_mode",
        "passthrough",
        "-enc_time_base",
        "1/1000",
        "-c:v",
        "libx264",
        "-pix_fmt",
        "yuv420p",
        &output,
    ]);
    let probed = Command::new("ffprobe")
        .args([
            "-v",
            "error",
            "-show_entries",
            "frame=pts_time",
            "-of",
            "csv=p=0",
            "-i",
            &output,
        ])
        .output()
        .expect("ffprobe runs");
    let expected: Vec<f64> = String::from_utf8_lossy(&probed.stdout)
        .lines()
        .map(|line| line.trim_end_matches(','))
        .filter(|line| !line.is_empty())
        .map(|line| line.parse().expect("a time"))
        .collect();
    let (_, times, bytes, _) = read(&config(&path));
    assert_eq!(times, expected);
    assert!(times.len() == 5 && times[0] > 7.0, "{times:?}");
    assert!(
        times[4] - times[3] > 0.4 && times[3] - times[1] < 0.02,
        "{times:?}"
    );
    assert_eq!(bytes.len(), 5 * 640 * 480 * 3 / 2);

    let part = SourceConfig {
        time_offset_s: 0.25,
        frames: FrameRange {
            first: 3,
            step: 2,
            limit: Some(1),
        },
        ..config(&path)
    };
    let (_, part_times, part_bytes, _) = read(&part);
    assert_eq!(part_times, [expected[3] + 0.25]);
    assert!(part_bytes == bytes[3 * part_bytes.len()..4 * part_bytes.len()]);
    let beyond = SourceConfig {
        frames: FrameRange {
            first: 5,
            ..FrameRange::ALL
        },
        ..config(&path)
    };
    let error = Source::open(&beyond)
        .expect("opens")
        .next()
        .expect("an error");
    let error = error.expect_err("beyond the end").to_string();
    assert!(
        error.contains("the video has 5 frames; allowed: 0 to 4"),
        "{error}"
    );
}

#[test]
fn rotated_videos_are_delivered_upright() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let lying = clip(
        &folder,
        "lying.mp4",
        &["-c:v", "libx264", "-pix_fmt", "yuv420p"],
    );
    let turned = path_in(&folder, "turned.mp4");
    let rotate = ["-metadata:s:v:0", "rotate=90", "-c", "copy"];
    ffmpeg(&[&["-i", &lying], rotate.as_slice(), &[&turned]].concat());
    let (description, _, bytes, _) = read(&config(&turned));
    if description.content.contains("rotated by") {
        assert_eq!(description.size_px, (480, 640));
        let expected = ffmpeg(&["-i", &turned, "-f", "rawvideo", "-pix_fmt", "yuv420p", "-"]);
        assert!(bytes == expected);
    } else {
        println!("skipped: this ffmpeg does not write rotations");
    }
}

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

/// Returns the error of opening a source.
fn error_of(config: &SourceConfig) -> String {
    match Source::open(config) {
        Ok(source) => panic!("opens: {:?}", source.describe()),
        Err(error) => error.to_string(),
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
fn a_part_of_a_file_keeps_its_times() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let path = clip(
        &folder,
        "clip.mp4",
        &["-c:v", "libx264", "-pix_fmt", "yuv420p"],
    );
    let (_, all_s, bytes, _) = read(&config(&path));
    let part = VideoSettings {
        start_s: Some(0.08),
        duration_s: Some(0.12),
        ..VideoSettings::default()
    };
    let source = Source::open(&opened(&path, part.clone())).expect("opens");
    let span = source.span().expect("stated by the file");
    assert_eq!((span.first_s, source.frame_count()), (0.08, None));
    assert!((span.last_s - 0.20).abs() < 1e-9, "{span:?}");
    let (_, times_s, part_bytes, _) = read(&opened(&path, part));
    assert_eq!(times_s, all_s[2..5]);
    let frame = bytes.len() / 6;
    assert!(part_bytes == bytes[2 * frame..5 * frame]);
}

#[test]
fn formats_without_time_stamps_use_the_stated_rate() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let raw = clip(
        &folder,
        "frames.raw",
        &["-f", "rawvideo", "-pix_fmt", "nv12"],
    );
    let settings = VideoSettings {
        format: Some(VideoFormat::Rawvideo),
        fps: Some(12.5),
        size_px: Some([640, 480]),
        pixel_format: Some("nv12".to_owned()),
        ..VideoSettings::default()
    };
    let (description, times_s, bytes, _) = read(&opened(&raw, settings));
    assert_eq!(description.pixel_format, PixelFormat::Nv12);
    assert_eq!(times_s, [0.0, 0.08, 0.16, 0.24, 0.32, 0.4]);
    assert!(bytes == std::fs::read(&raw).expect("read"));
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

/// Creates programs that replace ffmpeg's: the second runs the shell script.
#[cfg(unix)]
fn stand_in(folder: &TempDir, script: &str) -> Programs {
    use std::os::unix::fs::PermissionsExt;
    let real = |name: &str| {
        std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())
            .map(|folder| folder.join(name))
            .find(|path| path.is_file())
            .expect("found before")
    };
    let write = |name: &str, text: String| {
        let path: PathBuf = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).expect("runnable");
    };
    let ffmpeg = real("ffmpeg").display().to_string();
    write(
        "ffprobe",
        format!("#!/bin/sh\nexec {} \"$@\"\n", real("ffprobe").display()),
    );
    write(
        "ffmpeg",
        format!(
            "#!/bin/sh\ncase \"$*\" in *'-h long'*) exec {ffmpeg} \"$@\";; esac\n{}\n",
            script.replace("FFMPEG", &ffmpeg)
        ),
    );
    Programs::find(OsStr::new(folder.path())).expect("both stand-ins")
}

/// Reads a clip of six frames with a stand-in; returns the times of the valid frames, the error and the statistics.
#[cfg(unix)]
fn read_with(script: &str) -> Option<(Vec<f64>, Option<String>, Counters)> {
    programs()?;
    let folder = TempDir::new().expect("a folder");
    let path = clip(
        &folder,
        "clip.nut",
        &["-c:v", "rawvideo", "-pix_fmt", "nv12"],
    );
    let programs = stand_in(&folder, script);
    let (description, frames) = VideoFrames::open(
        &programs,
        &VideoInput::of_path(&path),
        None,
        FrameRange::ALL,
    )
    .expect("opens");
    let process = frames.process();
    let mut source = Source::start(description, Clock::Recorded, 0.0, frames);
    source.process = Some(process);
    let (mut times, mut error) = (Vec::new(), None);
    for frame in source.by_ref() {
        match frame {
            Ok(delivery) => times.push(frame_of(delivery).time_s()),
            Err(found) => error = Some(found.to_string()),
        }
    }
    Some((times, error, source.counters()))
}

#[cfg(unix)]
#[test]
fn frames_before_a_failure_are_delivered_and_the_failure_is_quoted() {
    // The third frame is truncated.
    let script = "FFMPEG \"$@\" | head -c 1000000; echo '[fatal] camera unplugged' >&2; exit 9";
    let Some((times, error, counters)) = read_with(script) else {
        return;
    };
    assert_eq!(times, [0.0, 0.04]);
    let error = error.expect("a failure");
    assert!(
        error.contains("clip.nut: ffmpeg failed (exit status: 9), after 2 frames"),
        "{error}"
    );
    assert!(error.contains("[fatal] camera unplugged"), "{error}");
    assert!(counters.ffmpeg_errors >= 1);
}

#[cfg(unix)]
#[test]
fn what_is_no_frame_is_an_error() {
    for (script, frames, expected) in [
        ("FFMPEG \"$@\"; echo surplus", 6, "frame 6 is not"),
        ("FFMPEG \"$@\" | head -c 1000000", 2, "ended within a frame"),
        (
            "echo this is not a stream of frames",
            0,
            "it is not a NUT stream",
        ),
    ] {
        let Some((times, error, _)) = read_with(script) else {
            return;
        };
        assert_eq!(times.len(), frames);
        let error = error.expect("an error");
        assert!(error.contains(expected), "{error}");
    }
}

#[cfg(unix)]
#[test]
fn times_do_not_depend_on_the_messages_of_ffmpeg() {
    let Some((times, error, _)) = read_with("FFMPEG \"$@\" 2> /dev/null") else {
        return;
    };
    assert_eq!(error, None);
    assert_eq!(times, [0.0, 0.04, 0.08, 0.12, 0.16, 0.2]);
}

/// Runs the installed ffmpeg with another filter before its own ones.
#[cfg(unix)]
fn read_filtered(filter: &str) -> Option<(Vec<f64>, Option<String>, Counters)> {
    read_with(&format!(
        "for a; do shift; case \"$a\" in format=*) a=\"{filter},$a\";; esac; set -- \"$@\" \"$a\"; done; FFMPEG \"$@\""
    ))
}

#[cfg(unix)]
#[test]
fn times_that_repeat_or_decrease_or_are_negative_are_kept() {
    let Some((times, error, _)) =
        read_filtered("setpts='if(eq(N,2),PTS-3/TB,if(eq(N,4),PTS-0.04/TB,PTS))'")
    else {
        return;
    };
    assert_eq!(error, None);
    let third = 0.08 - 3.0;
    assert!((times[2] - third).abs() < 1e-9, "{times:?}");
    let others = [times[0], times[1], times[3], times[4], times[5]];
    assert_eq!(others, [0.0, 0.04, 0.12, 0.12, 0.2]);
}

#[cfg(unix)]
#[test]
fn a_missing_time_stamp_is_an_error() {
    let Some((times, error, _)) = read_filtered("setpts='if(eq(N,2),NAN,PTS)'") else {
        return;
    };
    assert_eq!(times, [0.0, 0.04]);
    let error = error.expect("an error");
    assert!(error.contains("frame 2 has no time stamp"), "{error}");
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

#[test]
fn layouts_of_streams() {
    use YuvMatrix::{Bt601, Bt709};
    use YuvRange::{Full, Limited};

    let stream = |pix_fmt: &str, space: &str, range: &str, height| ProbedStream {
        width: 640,
        height,
        pix_fmt: pix_fmt.to_owned(),
        color_space: space.to_owned(),
        color_range: range.to_owned(),
        ..ProbedStream::default()
    };
    let encoding = |matrix, range| Some(YuvEncoding { matrix, range });
    for (stream, expected) in [
        (stream("yuv420p", "", "", 480), encoding(Bt601, Limited)),
        (
            stream("yuv420p", "unknown", "unknown", 720),
            encoding(Bt709, Limited),
        ),
        (stream("yuvj420p", "", "", 480), encoding(Bt601, Full)),
        (stream("nv12", "bt709", "pc", 480), encoding(Bt709, Full)),
        (
            stream("nv12", "smpte170m", "tv", 1080),
            encoding(Bt601, Limited),
        ),
        (stream("rgb24", "gbr", "pc", 480), None),
        (stream("yuv420p10le", "bt2020nc", "tv", 2160), None),
    ] {
        assert_eq!(Layout::of(&stream, None).encoding, expected, "{stream:?}");
    }
    let given = encoding(Bt601, Full);
    let layout = Layout::of(&stream("yuv420p10le", "bt2020nc", "tv", 2160), given);
    assert_eq!((layout.format, layout.encoding), (PixelFormat::I420, given));
}
