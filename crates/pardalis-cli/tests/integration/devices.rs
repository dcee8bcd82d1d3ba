//! `pardalis devices` on the computer of the test.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::Command;

use crate::common::Run;

#[test]
fn a_computer_without_cameras_is_told_what_to_do() {
    let devices = fs::read_dir("/dev").unwrap().flatten();
    let mut names = devices.map(|entry| entry.file_name().to_string_lossy().into_owned());
    if names.any(|name| name.starts_with("video")) {
        println!("skipped: there is a camera");
        return;
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let run = Run::of(command.arg("devices"));
    assert_eq!((run.code, &*run.stdout), (Some(1), ""), "{}", run.stderr);
    let wanted = "error: no camera was found: there is no /dev/video...; plug one in";
    assert!(run.stderr.contains(wanted), "{}", run.stderr);
    // Nor is ffmpeg installed.
    let run = Run::of(command.env("PATH", ""));
    assert!(run.stderr.contains(wanted), "{}", run.stderr);
}
