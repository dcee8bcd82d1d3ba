//! Pixel formats, encodings and rotations.

use super::*;

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

#[test]
fn interlaced_videos_are_deinterlaced_unless_the_scene_says_otherwise() {
    if programs().is_none() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let path = path_in(&folder, "fields.mpg");
    // A white square that moves by 8 pixels from field to field, 20 ms apart.
    let square = "color=black:size=320x64:rate=50[b];color=white:size=16x32:rate=50[w];\
                  [b][w]overlay=x=8*n:y=16,interlace=scan=tff";
    let codec = ["-c:v", "mpeg2video", "-flags", "+ildct+ilme", "-q:v", "1"];
    let input = ["-f", "lavfi", "-i", square, "-frames:v", "6"];
    ffmpeg(&[&input[..], &codec, &[&path]].concat());
    // How far a bright pixel differs from those above and below, in the last frame.
    let combs = |bytes: &[u8]| {
        let last = &bytes[5 * bytes.len() / 6..];
        let row = |y: usize| &last[320 * y..][..320];
        let comb = |y: usize, x: usize| {
            let [above, here, below] = [y - 1, y, y + 1].map(|y| i32::from(row(y)[x]));
            (2 * here - above - below).abs()
        };
        let rows = 20..44;
        rows.flat_map(|y| (0..320).map(move |x| (y, x)))
            .filter(|&(y, x)| comb(y, x) > 200)
            .count()
    };
    let given = |deinterlace| VideoSettings {
        deinterlace,
        ..VideoSettings::default()
    };
    let kept = read(&opened(&path, given(Some(false))));
    assert!(combs(&kept.2) > 200, "{}", combs(&kept.2));
    for deinterlace in [None, Some(true)] {
        let (description, times, bytes, _) = read(&opened(&path, given(deinterlace)));
        assert!(
            description.content.ends_with(", deinterlaced"),
            "{description:?}"
        );
        assert_eq!((times, bytes.len()), (kept.1.clone(), kept.2.len()));
        assert!(combs(&bytes) < 20, "{deinterlace:?}: {}", combs(&bytes));
    }
    // Progressive videos stay as they are.
    let path = clip(&folder, "progressive.mp4", &["-c:v", "libx264"]);
    let (description, ..) = read(&config(&path));
    assert!(
        !description.content.contains("deinterlaced"),
        "{description:?}"
    );
}
