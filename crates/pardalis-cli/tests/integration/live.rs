//! Live sources with the real program and the real ffmpeg.

use std::fs::{self, File};
use std::io::Write as _;
use std::net::TcpListener;
use std::process::{Command, Stdio};
#[cfg(target_os = "linux")]
use std::time::Duration;

use crate::common::{Run, Workplace, rows_in, scene_with};

/// Returns a workplace with the first frames of the sequence as an MPEG transport stream; `None` without ffmpeg.
pub(crate) fn with_stream(frames: usize) -> Option<Workplace> {
    let place = Workplace::with_frames(frames);
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-framerate", "25", "-i", "images/%06d.jpg"])
        .args(["-c:v", "libx264", "-preset", "ultrafast", "-g", "5"])
        .args(["-pix_fmt", "yuvj420p", "ride.ts"])
        .status();
    if encoded.is_ok_and(|status| status.success()) {
        return Some(place);
    }
    println!("skipped: ffmpeg is not installed");
    None
}

/// Returns the scene with this video in place of its images.
pub(crate) fn video(input: &str) -> String {
    let lines = format!("video = \"{input}\"");
    scene_with("images = \"images\"\nfps = 25", &lines)
}

#[test]
fn standard_input_is_a_source_like_the_file() {
    let Some(place) = with_stream(12) else {
        return;
    };
    let from_file = place.track_with(video("ride.ts"), &["-o", "-"]).fine();
    let mut command = place.command(video("-"), &["-o", "-"]);
    let input = File::open(place.path("ride.ts")).unwrap();
    let run = Run::of(command.stdin(input)).fine();
    assert_eq!(rows_in(&run.stdout).len(), 12);
    assert_eq!(run.stdout, from_file.stdout);
    // Nothing comes.
    let mut command = place.command(video("-"), &["-o", "-"]);
    let empty = Run::of(command.stdin(Stdio::null()));
    empty.refused(&["line 3: cameras.cam1.video: standard input: ffmpeg cannot open it"]);
}

#[test]
fn interlaced_live_sources_are_named_with_their_line() {
    let Some(place) = with_stream(6) else {
        return;
    };
    let encoded = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-i", "ride.ts", "-vf", "setfield=tff"])
        .args(["-c:v", "mpeg2video", "-flags", "+ildct+ilme", "fields.ts"])
        .status();
    assert!(encoded.unwrap().success());
    let warning = "warning: scene.toml: line 3: cameras.cam1.video: standard input: is marked as interlaced; \
                   set input.deinterlace = true in the table of this camera";
    let input = || File::open(place.path("fields.ts")).unwrap();
    for command in ["track", "check"] {
        let run = |scene: String| {
            place.write("scene.toml", scene);
            let mut program = Command::new(env!("CARGO_BIN_EXE_pardalis"));
            program.current_dir(place.path(""));
            Run::of(program.args([command, "scene.toml"]).stdin(input()))
        };
        let undecided = run(video("-"));
        assert_eq!(undecided.code, Some(0), "{}", undecided.stderr);
        assert!(undecided.stderr.contains(warning), "{}", undecided.stderr);
        // The line to set is right.
        let decided =
            video("-").replace("video = \"-\"", "video = \"-\"\ninput.deinterlace = true");
        let decided = run(decided);
        assert_eq!(decided.code, Some(0), "{}", decided.stderr);
        assert!(!decided.stderr.contains("interlaced"), "{}", decided.stderr);
    }
}

#[test]
fn raw_streams_need_their_format_and_frame_rate() {
    let Some(place) = with_stream(12) else {
        return;
    };
    for (name, codec, format) in [
        ("raw.h264", "copy", "h264"),
        ("raw.mjpeg", "mjpeg", "mjpeg"),
    ] {
        let converted = Command::new("ffmpeg")
            .current_dir(place.path(""))
            .args(["-v", "error", "-i", "ride.ts", "-c:v", codec, name])
            .status();
        assert!(converted.unwrap().success());
        let wanted = format!(
            "is a raw stream without time stamps; give input.format = \"{format}\" and fps, or put it into a container"
        );
        place
            .track(video(name))
            .refused(&["line 3: cameras.cam1.video: raw", &wanted]);
        let from_pipe = |scene: String| {
            let mut command = place.command(scene, &["-o", "out", "--no-plots"]);
            Run::of(command.stdin(File::open(place.path(name)).unwrap()))
        };
        from_pipe(video("-")).refused(&["line 3: cameras.cam1.video: standard input: ", &wanted]);
        let lines = format!("video = \"-\"\ninput.format = \"{format}\"\nfps = 50");
        from_pipe(scene_with("images = \"images\"\nfps = 25", &lines)).fine();
        let rows = place.rows();
        assert_eq!(rows.len(), 12);
        assert_eq!(rows[11][1].parse::<f64>().unwrap(), 0.22);
    }
}

/// Returns the identifiers of the processes that a process has started.
#[cfg(target_os = "linux")]
fn children_of(process: u32) -> Vec<String> {
    // Any of its threads may have started them.
    let threads = fs::read_dir(format!("/proc/{process}/task")).into_iter();
    let mut children = Vec::new();
    for thread in threads.flatten().flatten() {
        let text = fs::read_to_string(thread.path().join("children")).unwrap_or_default();
        children.extend(text.split_whitespace().map(str::to_owned));
    }
    children
}

/// Waits until something holds; fails after half a minute.
#[cfg(target_os = "linux")]
#[track_caller]
fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    for _ in 0..1500 {
        if holds() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("{what}");
}

#[cfg(target_os = "linux")]
#[test]
fn no_ffmpeg_outlives_the_program() {
    if with_stream(1).is_none() || Command::new("setpriv").arg("--version").output().is_err() {
        println!("skipped: ffmpeg or setpriv is not installed");
        return;
    }
    for signal in ["INT", "TERM", "KILL"] {
        let place = Workplace::with_frames(1);
        // It accepts connections and sends nothing, so that ffmpeg never writes.
        let silent = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp://{}", silent.local_addr().unwrap());
        let mut command = place.command(video(&address), &["-o", "out"]);
        let mut program = command.stderr(Stdio::piped()).spawn().unwrap();
        let (connection, _) = silent.accept().unwrap();
        let children = children_of(program.id());
        assert_eq!(children.len(), 1, "{children:?}");
        let ffmpeg = format!("/proc/{}/cmdline", children[0]);
        let started = fs::read_to_string(&ffmpeg).unwrap();
        assert!(started.contains("ffmpeg"), "{started}");
        let kill = format!("kill -{signal} {}", program.id());
        let sent = Command::new("/bin/sh").args(["-c", &kill]).status();
        assert!(sent.unwrap().success());
        program.wait().unwrap();
        // An ended process has no command line.
        wait_until("ffmpeg goes on", || {
            fs::read_to_string(&ffmpeg).unwrap_or_default().is_empty()
        });
        drop(connection);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn no_ffprobe_outlives_the_program() {
    use std::os::unix::fs::PermissionsExt;
    if with_stream(1).is_none() || Command::new("setpriv").arg("--version").output().is_err() {
        println!("skipped: ffmpeg or setpriv is not installed");
        return;
    }
    let place = Workplace::with_frames(1);
    place.write("ride.mkv", "");
    fs::create_dir(place.path("bin")).unwrap();
    // It hangs, as on a disk that does not answer.
    place.write("bin/ffprobe", "#!/bin/sh\nexec sleep 60\n");
    fs::set_permissions(place.path("bin/ffprobe"), fs::Permissions::from_mode(0o755)).unwrap();
    let search_path = std::env::var("PATH").unwrap();
    let search_path = format!("{}:{search_path}", place.path("bin").display());
    let mut command = place.command(video("ride.mkv"), &["-o", "out"]);
    let mut program = command.env("PATH", search_path).spawn().unwrap();
    let mut ffprobe = String::new();
    let started = |process: &str| fs::read_to_string(process).unwrap_or_default();
    wait_until("ffprobe does not start", || {
        let children = children_of(program.id());
        let mut children = children.iter().map(|id| format!("/proc/{id}/cmdline"));
        let found = children.find(|process| started(process).starts_with("sleep"));
        ffprobe = found.unwrap_or_default();
        !ffprobe.is_empty()
    });
    program.kill().unwrap();
    program.wait().unwrap();
    wait_until("ffprobe goes on", || started(&ffprobe).is_empty());
}

#[test]
fn a_source_that_keeps_silent_is_announced_and_given_up() {
    if with_stream(1).is_none() {
        return;
    }
    let place = Workplace::with_frames(1);
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", silent.local_addr().unwrap());
    let lines = format!("video = \"{address}\"\ninput.timeout_s = 3");
    let run = place.track(scene_with("images = \"images\"\nfps = 25", &lines));
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    let waiting = format!("waiting for the first frame of {address}, at most 3 s\n");
    assert!(run.stderr.starts_with(&waiting), "{}", run.stderr);
    let given_up = format!("line 3: cameras.cam1.video: {address}: no frame came within 3 s");
    assert!(run.stderr.contains(&given_up), "{}", run.stderr);
}

/// A server of ffmpeg serves one connection, and is started again after it.
#[test]
fn a_server_that_is_away_for_a_moment_is_awaited() {
    let Some(place) = with_stream(12) else {
        return;
    };
    let stream = fs::read(place.path("ride.ts")).unwrap();
    // Its port is free again.
    let address = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let server = std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_millis(1500));
        let listener = TcpListener::bind(address).unwrap();
        listener.accept().unwrap().0.write_all(&stream).unwrap();
    });
    let run = place.track(video(&format!("tcp://{address}")));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let wanted = format!("nobody listens at tcp://{address}; trying for 5 s");
    assert!(run.stderr.contains(&wanted), "{}", run.stderr);
    assert_eq!(place.rows().len(), 12);
    server.join().unwrap();
}

#[test]
fn sources_that_cannot_be_opened_say_what_to_check() {
    if with_stream(1).is_none() {
        return;
    }
    let place = Workplace::with_frames(1);
    // Its port is free again.
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr();
    let address = format!("tcp://{}", address.unwrap());
    let of_address = place.track(video(&address));
    assert_eq!(of_address.code, Some(2), "{}", of_address.stderr);
    let wanted = "line 3: cameras.cam1.video: ";
    assert!(of_address.stderr.contains(wanted), "{}", of_address.stderr);
    let wanted =
        "ffmpeg cannot open it; nobody listens there: start the sender, or check the address";
    assert!(of_address.stderr.contains(wanted), "{}", of_address.stderr);
    assert!(!of_address.stderr.contains("pardalis devices"));
    let mut command = place.command(video("-"), &["-o", "-"]);
    Run::of(command.stdin(Stdio::null())).refused(&[
        "standard input: ffmpeg cannot open it; it is empty, or an MP4, which cannot be read from a pipe",
    ]);
}
