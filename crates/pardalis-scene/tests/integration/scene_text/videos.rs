//! Videos of cameras: files, devices, addresses and their settings.

use pardalis_scene::{Input, Protocol, Scene, VideoFormat, VideoInput, VideoPlace, WhenBehind};

use super::{SCENE, assert_rejected, parsed};

/// Reads a scene whose camera has these lines instead of its images.
fn video(lines: &str) -> Result<Scene, Vec<String>> {
    let images = "images = \"up\"\n";
    assert!(SCENE.contains(images));
    parsed(&SCENE.replace(images, &format!("{lines}\n")))
}

/// Returns the video of that camera.
fn video_of(lines: &str) -> VideoInput {
    let scene = video(lines).unwrap_or_else(|problems| panic!("{lines}: {problems:#?}"));
    let camera = scene
        .cameras
        .into_iter()
        .find(|camera| camera.name == "mirror");
    match camera.map(|camera| camera.input) {
        Some(Input::Video { video, .. }) => video,
        other => panic!("{lines}: {other:?}"),
    }
}

#[test]
fn videos_are_files_devices_or_addresses() {
    let file = |name: &str| VideoPlace::File(name.to_owned());
    for name in [
        "a.mp4",
        "concat:a|b",
        "subfile,,start,0,end,0,,:a.mp4",
        "file:a.mp4",
        "-y",
    ] {
        assert_eq!(video_of(&format!("video = '{name}'")).place, file(name));
    }
    assert_eq!(video_of("video = '-'").place, VideoPlace::StandardInput);
    let device = video_of("video = '/dev/video2'\nfps = 30\nsize_px = [640, 480]");
    assert_eq!(device.place, VideoPlace::Device("/dev/video2".to_owned()));
    let settings = device.settings;
    assert_eq!(settings.format, Some(VideoFormat::V4l2));
    assert_eq!(
        (settings.fps, settings.size_px),
        (Some(30.0), Some([640, 480]))
    );
    let named = video_of("video = 'video=Integrated Camera'\ninput.format = 'dshow'");
    assert!(matches!(named.place, VideoPlace::Device(_)), "{named:?}");
    for address in [
        "udp://a:1",
        "tcp://[::1]:5?listen",
        "rtp://a:5004/x",
        "http://a",
    ] {
        let place = video_of(&format!("video = '{address}'")).place;
        assert!(matches!(place, VideoPlace::Address(_, of) if of == address));
    }
    let address = video_of("video = 'rtsp://a/b'\ninput.rtsp_transport = 'tcp'");
    let wanted = VideoPlace::Address(Protocol::Rtsp, "rtsp://a/b".to_owned());
    assert_eq!(address.place, wanted);
}

#[test]
fn cameras_are_opened_again_and_do_not_wait_and_what_may_have_an_end_does() {
    let cameras = [
        "'/dev/video2'",
        "'rtsp://a/b'",
        "'rtp://a:5004'",
        "'udp://a:1'",
        "'http://a/video'\ninput.format = 'mpjpeg'",
    ];
    for camera in cameras {
        let input = video_of(&format!("video = {camera}"));
        assert_eq!(input.reopen_s(), 60.0, "{camera}");
        assert_eq!(input.when_behind(), WhenBehind::Drop, "{camera}");
        let part = video_of(&format!("video = {camera}\ninput.duration_s = 5"));
        assert_eq!(part.reopen_s(), 0.0, "{camera}");
        let own = format!("video = {camera}\ninput.reopen_s = 3\ninput.when_behind = 'wait'");
        let own = video_of(&own);
        assert_eq!(own.reopen_s(), 3.0, "{camera}");
        assert_eq!(own.when_behind(), WhenBehind::Wait, "{camera}");
    }
    for other in ["'a.mp4'", "'-'", "'http://a/b.mp4'", "'tcp://a:1'"] {
        let input = video_of(&format!("video = {other}"));
        assert_eq!(input.reopen_s(), 0.0, "{other}");
        assert_eq!(input.when_behind(), WhenBehind::Wait, "{other}");
    }
}

#[test]
fn scenes_cannot_give_options_generators_or_other_protocols() {
    let key = "cameras.mirror.video";
    let at = |name: &str| format!("cameras.mirror.input.{name}");
    let (format, pixel_format) = (at("format"), at("pixel_format"));
    assert_rejected(
        video,
        &[
            (
                "video = 'a'\ninput_options = ['-f', 'lavfi']",
                "cameras.mirror.input_options",
                "is not a key",
            ),
            (
                "video = 'a'\ninput.dump_separator = 'x'",
                &at("dump_separator"),
                "is not a key",
            ),
            (
                "video = 'color=red'\ninput.format = 'lavfi'",
                &format,
                "allowed: \"v4l2\"",
            ),
            (
                "video = 'a'\ninput.format = 'concat'",
                &format,
                "is the text \"concat\"",
            ),
            (
                "video = 'a'\ninput.format = 'hls'",
                &format,
                "is the text \"hls\"",
            ),
            (
                "video = 'async:http://a'",
                key,
                "the protocol async:http; allowed: rtsp, rtp",
            ),
            (
                "video = 'http,method,POST,://a'",
                key,
                "protocol http,method,POST,",
            ),
            ("video = 'HTTP://a'", key, "protocol HTTP"),
            (
                "video = 'udp://a'",
                key,
                "has no port; give udp://HOST:PORT",
            ),
            ("video = 'tcp://[::1]/a:5?b'", key, "has no port; give tcp"),
            ("video = 'rtp://a:0'", key, "has no port"),
            ("video = '/dev/stdin'", key, "write \"-\" for it"),
            ("video = '/dev/fd/0'", key, "write \"-\" for it"),
            ("video = 'file:///etc/passwd'", key, "or the path of a file"),
            ("video = \"http://a\\r\\nX: y\"", key, "control character"),
            (
                "video = '/dev/video0'\ninput.pixel_format = 'a -y b'",
                &pixel_format,
                "letters, digits and underscores",
            ),
        ],
    );
}

#[test]
fn settings_of_videos_are_rejected_where_they_do_not_apply() {
    let input = "cameras.mirror.input";
    let at = |name: &str| format!("{input}.{name}");
    let (pixel_format, codec) = (at("pixel_format"), at("codec"));
    let (start_s, real_time, transport) = (at("start_s"), at("real_time"), at("rtsp_transport"));
    assert_rejected(
        video,
        &[
            (
                "video = 'a'\ninput.pixel_format = 'nv12'",
                &pixel_format,
                "devices and rawvideo only",
            ),
            (
                "video = 'a'\ninput.codec = 'mjpeg'",
                &codec,
                "v4l2 and dshow only",
            ),
            (
                "video = 'udp://a:1'\ninput.start_s = 1",
                &start_s,
                "files only",
            ),
            (
                "video = '/dev/video0'\ninput.real_time = true",
                &real_time,
                "files only",
            ),
            (
                "video = 'a'\ninput.when_behind = 'drop'",
                &at("when_behind"),
                "devices, addresses, pipes, and files with real_time only",
            ),
            (
                "video = 'udp://a:1'\ninput.when_behind = 'hurry'",
                &at("when_behind"),
                "allowed: \"drop\", \"wait\"",
            ),
            (
                "video = 'http://a'\ninput.rtsp_transport = 'udp'",
                &transport,
                "rtsp:// only",
            ),
            (
                "video = 'a'\nfps = 25",
                "cameras.mirror.fps",
                "have time stamps",
            ),
            (
                "video = 'a'\ninput.format = 'h264'",
                "cameras.mirror.fps",
                "h264 has no time stamps",
            ),
            (
                "video = 'a'\nfps = 25\ninput.format = 'rawvideo'",
                &pixel_format,
                "rawvideo does not state it",
            ),
            (
                "video = 'a'\nfps = 25\ninput = { format = 'rawvideo', pixel_format = 'nv12' }",
                "cameras.mirror.size_px",
                "rawvideo does not state it",
            ),
            (
                "images = 'up'\ninput.real_time = true",
                input,
                "applies to video only",
            ),
        ],
    );
}
