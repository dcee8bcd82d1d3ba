//! Time stamps, and parts of files.

use super::*;
use pardalis_scene::VideoFormat;

#[test]
fn time_stamps_are_those_of_the_stream() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let pattern = path_in(&folder, "%06d.jpg");
    let numbered = ["-frames:v", "5", "-start_number", "0", &pattern];
    ffmpeg(&[&["-f", "lavfi", "-i", PICTURE], &numbered[..]].concat());
    let durations = ["0.04", "0.003", "0.004", "0.5", "0.04"];
    let list = durations
        .iter()
        .enumerate()
        .fold("ffconcat version 1.0\n".to_owned(), |list, (i, d)| {
            list + &format!("file '{i:06}.jpg'\nduration {d}\n")
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
