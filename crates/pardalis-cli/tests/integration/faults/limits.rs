//! Limits of memory, threads and files, cameras that are too fast, and 64 cameras.

use std::fs;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Command, Output, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use super::camera::{Cameras, SIZE_PX, Stream, ball};
use super::process::threads;
use crate::common::{Run, SCENE, Workplace, rows_in};

/// A run that takes longer than this hangs. It usually takes less than a second.
const LONGEST: Duration = Duration::from_mins(2);

/// Runs a command in a shell that sets a limit before. Without backtraces: printing one takes memory too.
fn limited(limit: &str, command: &Command) -> Command {
    let mut shell = Command::new("/bin/sh");
    shell.args(["-c", &format!("ulimit {limit}; exec \"$0\" \"$@\"")]);
    shell.arg(command.get_program()).args(command.get_args());
    shell.current_dir(command.get_current_dir().unwrap());
    for (name, value) in command.get_envs() {
        shell.env(name, value.unwrap());
    }
    shell.env("RUST_BACKTRACE", "0");
    shell
}

/// Runs a command to its end. Fails with what its threads were doing if it hangs.
fn output(command: &mut Command) -> Output {
    let command = command.stdin(Stdio::null()).process_group(0);
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    let program = child.id();
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || sender.send(child.wait_with_output().unwrap()));
    receiver.recv_timeout(LONGEST).unwrap_or_else(|_| {
        let threads = threads(program);
        // With the programs that it started. The shell's built-in, as in `interrupt`.
        let kill = format!("kill -KILL -- -{program}");
        let _ = Command::new("/bin/sh").args(["-c", &kill]).status();
        let output = receiver.recv_timeout(LONGEST);
        panic!("{command:?} hangs.\n{threads}\n{output:?}");
    })
}

/// Reports whether all panics were those of Rust's standard library in threads that it could not start: a thread needs
/// a second stack for signals before it runs anything of the program, and the system then ends the process.
fn has_unstarted_thread(stderr: &str) -> bool {
    let mut panics = stderr.split("panicked at ").skip(1).peekable();
    let is_of_library = |panic: &str| {
        panic
            .lines()
            .next()
            .is_some_and(|at| at.contains("/library/std/src/sys/"))
    };
    panics.peek().is_some() && panics.all(is_of_library)
}

/// Checks that a run without enough memory ended with its own message or, in an allocation that fails, with the system's
/// signal, and that its rows are whole. Reports whether it succeeded.
fn holds(place: &Workplace, command: &mut Command, limit: &str) -> bool {
    let _ = fs::remove_dir_all(place.path("out"));
    let output = output(command);
    let code = output.status.code();
    let aborted = output.status.signal() == Some(6);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    if !(aborted && has_unstarted_thread(&stderr)) {
        // Fails if it panicked.
        Run::from(output);
        let has_reason = stderr.contains("error: ");
        let is_named = aborted && stderr.contains("memory allocation of");
        let is_early = aborted && stderr.contains("cannot allocate memory");
        assert!(
            code == Some(0) || has_reason || is_named || is_early,
            "{limit}: {code:?} {stderr}"
        );
    }
    if let Ok(text) = fs::read_to_string(place.path("out/tracks.csv"))
        && !text.is_empty()
    {
        rows_in(&text);
    }
    code == Some(0)
}

#[cfg(target_os = "linux")]
#[test]
fn too_little_memory_leaves_whole_rows() {
    let place = Workplace::with_frames(12);
    // With less than the program itself needs, the system does not start it.
    let program_mib = fs::metadata(env!("CARGO_BIN_EXE_pardalis")).unwrap().len() >> 20;
    let sizes_mib = [8, 12, 16, 24, 32, 48, 64, 1024].map(|mib| program_mib + mib);
    let mut succeeded = Vec::new();
    for mib in sizes_mib {
        let limit = format!("-v {}", mib << 10);
        let command = place.command(SCENE, &["-o", "out", "--threads", "2"]);
        succeeded.push(holds(&place, &mut limited(&limit, &command), &limit));
    }
    assert!(!succeeded[0] && succeeded[7], "{succeeded:?}");
    let images = ball(6);
    let cameras = Cameras::new(4, "input.reopen_s = 0");
    for number in 1..=4 {
        let camera = format!("cam{number}");
        for opening in 1..=8 {
            let stream = Stream::of(SIZE_PX).ball(&images, 0.0);
            cameras.opening(&camera, opening, stream);
        }
    }
    let mut succeeded = Vec::new();
    for mib in sizes_mib {
        let limit = format!("-v {}", mib << 10);
        let command = cameras.command(cameras.scene());
        succeeded.push(holds(
            &cameras.place,
            &mut limited(&limit, &command),
            &limit,
        ));
    }
    assert!(!succeeded[0] && succeeded[7], "{succeeded:?}");
}

#[test]
fn too_few_files_are_named_with_their_camera() {
    let script = "cat stream; exec sleep 1000";
    let cameras = Cameras::with_script(64, "input.reopen_s = 0", script);
    let stream = Stream::of(SIZE_PX).ball(&ball(2), 0.0);
    cameras.place.write("stream", stream.bytes);
    let command = cameras.command(cameras.scene());
    let run = Run::of(&mut limited("-n 40", &command));
    assert_ne!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("Too many open files"), "{}", run.stderr);
    assert!(run.stderr.contains(": cameras.cam"), "{}", run.stderr);
    assert!(!cameras.place.path("out").exists());
}

#[test]
fn sixty_four_cameras_are_tracked_together() {
    let cameras = Cameras::with_script(64, "input.reopen_s = 0", "exec cat stream");
    let stream = Stream::of(SIZE_PX).ball(&ball(4), 0.0);
    cameras.place.write("stream", stream.bytes);
    // They are opened one after another.
    let scene = cameras.scene() + "[timing]\nmax_delay_s = 20\n";
    cameras.track_scene(scene).fine();
    assert_eq!(cameras.times_s(), [0.0, 0.04, 0.08, 0.12]);
    for number in 1..=64 {
        let summary = cameras.summary(&format!("cam{number}"));
        assert_eq!(summary["frames"]["used"], 4, "{number}: {summary}");
    }
}

/// Tracks a camera that sends 600 frames, 550 MB, in much less time than tracking takes for all of them. Returns how many it could send, and the most
/// memory of the program in MiB.
#[cfg(target_os = "linux")]
fn track_slowly(cameras: &Cameras, scene: String, options: &[&str]) -> (u32, u64) {
    use std::io::Write as _;

    use super::process::peak_mib;
    let pipe = cameras.place.path("pipe");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let mut image = ball(1).remove(0);
    let camera = std::thread::spawn(move || {
        let mut pipe = fs::OpenOptions::new().write(true).open(pipe).unwrap();
        let mut sent = 0;
        let mut stream = Stream::of(SIZE_PX).bytes;
        while sent < 600 && pipe.write_all(&stream).is_ok() {
            // No image is that of another frame: any of them may follow any other, and would count as frozen.
            image[..2].copy_from_slice(&(sent as u16).to_le_bytes());
            stream = Stream { bytes: Vec::new() }
                .frame(0.04 * f64::from(sent), &image)
                .bytes;
            sent += 1;
        }
        sent
    });
    let scene = scene.replace("particles = 100", "particles = 100_000");
    let mut command = cameras.command(scene);
    let mut program = command.args(options).spawn().unwrap();
    let mut peak = 0;
    while program.try_wait().unwrap().is_none() {
        peak = peak.max(peak_mib(program.id()).unwrap_or(0));
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    (camera.join().unwrap(), peak)
}

#[cfg(target_os = "linux")]
#[test]
fn a_camera_that_is_faster_than_tracking_fills_no_memory() {
    let cameras = Cameras::with_script(1, "input.reopen_s = 0", "exec cat pipe");
    let (sent, peak) = track_slowly(&cameras, cameras.scene(), &["--frames", "40"]);
    assert_eq!(cameras.times_s().len(), 40);
    assert!(
        (40..100).contains(&sent),
        "{sent} frames were taken for 40 rows"
    );
    assert!((10..150).contains(&peak), "{peak} MiB");
}

/// Frames are read while a step goes on, however long it takes: what is not read grows old in ffmpeg and in the system.
#[cfg(target_os = "linux")]
#[test]
fn slow_tracking_leaves_out_the_oldest_frames_of_a_camera_and_uses_the_last() {
    let cameras = Cameras::with_script(1, "input.reopen_s = 0", "exec cat pipe");
    let scene = cameras.scene().replace("\"wait\"", "\"drop\"");
    let (sent, peak) = track_slowly(&cameras, scene, &[]);
    assert_eq!(sent, 600);
    assert!((10..150).contains(&peak), "{peak} MiB");
    let frames = &cameras.summary("cam1")["frames"];
    // The last frame that was made was not sent any more.
    assert_eq!(frames["delivered"], 599);
    let [used, overtaken] = ["used", "overtaken"].map(|key| frames[key].as_u64().unwrap());
    assert_eq!(used + overtaken, 599);
    assert!(used < 200, "{used} of 599 frames were used");
    let times_s = cameras.times_s();
    assert_eq!(times_s.len() as u64, used);
    assert_eq!(times_s.last(), Some(&(0.04 * 598.0)));
}
