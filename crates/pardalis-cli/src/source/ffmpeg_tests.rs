use super::*;

#[test]
fn programs_that_are_not_installed_are_named() {
    for search_path in ["", "/nonexistent"] {
        let error = Programs::find(OsStr::new(search_path))
            .err()
            .expect("nothing there")
            .to_string();
        assert!(error.contains("program ffmpeg"), "{error}");
        assert!(error.contains("install the ffmpeg package"), "{error}");
    }
}

#[test]
fn ffmpeg_gets_nothing_but_what_the_settings_name() {
    let video = VideoInput {
        place: VideoPlace::Device("-report".to_owned()),
        settings: VideoSettings {
            format: Some(VideoFormat::V4l2),
            fps: Some(30.0),
            size_px: Some([1280, 720]),
            pixel_format: Some("yuyv422".to_owned()),
            codec: Some(pardalis_scene::DeviceCodec::Mjpeg),
            hardware: Some(pardalis_scene::Hardware::Vaapi),
            ..VideoSettings::default()
        },
    };
    assert_eq!(
        opening(&video).join(" "),
        "-max_pixels 67108864 -protocol_whitelist file -format_whitelist v4l2 -f v4l2 -framerate 30 -video_size 1280x720 \
         -pixel_format yuyv422 -input_format mjpeg"
    );
    assert_eq!(reading(&video.settings).join(" "), "-hwaccel vaapi");
    // It follows `-i`.
    assert_eq!(url(&video.place), "-report");
    let file = VideoInput::of_path("concat:a|b");
    assert_eq!(url(&file.place), "file:concat:a|b");
    for (protocol, allowed) in [
        (Protocol::Rtsp, "rtsp,rtp,udp,tcp -format_whitelist rtsp"),
        (Protocol::Udp, "udp -format_whitelist asf,"),
        (
            Protocol::Https,
            "http,https,httpproxy,tls,tcp -format_whitelist asf,",
        ),
    ] {
        let url = format!("{}://camera", protocol.name());
        let video = VideoInput {
            place: VideoPlace::Address(protocol, url),
            settings: VideoSettings::default(),
        };
        let options = opening(&video).join(" ");
        let wanted = format!("-max_pixels 67108864 -protocol_whitelist {allowed}");
        assert!(options.starts_with(&wanted), "{options}");
    }
    for generator in ["lavfi", "concat", "hls", "dash", "sdp", "image2"] {
        assert!(!CONTAINERS.split(',').any(|name| name == generator));
    }
}

#[test]
fn colors_are_those_that_ffmpeg_reports() {
    let frame = " @ 0x55] [info] n:   0 pts:   1536 pts_time:0.12    pos:    14738 fmt:yuv420p sar:1/1 s:640x480 i:P iskey:0 type:B";
    let colors = " @ 0x55] [info] color_range:tv color_space:bt470bg color_primaries:unknown color_trc:unknown";
    let config = " @ 0x55] [info] config in time_base: 1/12800, frame_rate: 25/1";
    for (last, space, range) in [(colors, "bt470bg", "tv"), (frame, "", "")] {
        let mut stream = ProbedStream::default();
        assert!(!add_report(&mut stream, config));
        assert!(!add_report(&mut stream, frame));
        assert!(add_report(&mut stream, last));
        let found = [&stream.pix_fmt, &stream.color_space, &stream.color_range];
        assert_eq!(found, ["yuv420p", space, range]);
        assert!(!stream.is_interlaced());
    }
    let mut stream = ProbedStream::default();
    add_report(&mut stream, &frame.replace("i:P", "i:B"));
    assert!(stream.is_interlaced());
    let mapping = "[info]   Stream #0:1 -> #0:0 (h264 (native) -> rawvideo (native))";
    assert_eq!(codec_in(mapping), Some("h264"));
    assert_eq!(codec_in("[info] Stream #0:0: Video: h264"), None);
}

#[test]
fn times_are_exact_although_they_are_moved() {
    // ffmpeg rounds the offset to ticks.
    for (numerator, denominator) in [
        (1, 12_800),
        (1, 9_000_000),
        (1001, 30_000),
        (1, 1_000_000_000),
    ] {
        let exact = (NUT_OFFSET_S as f64 * denominator as f64 / numerator as f64).round() as i64;
        for ticks in [0, 1, -7, 123_456_789] {
            let wanted = (ticks as f64 * numerator as f64) / denominator as f64;
            let time_base = (numerator, denominator);
            let found = without_offset(exact + ticks, time_base);
            assert_eq!(seconds(found, time_base), wanted);
        }
    }
}
