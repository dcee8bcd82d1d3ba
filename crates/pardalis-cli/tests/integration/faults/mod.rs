//! The fault harness: what the real program does when cameras, disks, ffmpeg, clocks, memory and files fail. It needs no
//! ffmpeg, because cameras are streams of frames that a stand-in for ffmpeg passes on.
#![cfg(unix)]

mod camera;
mod cameras;
mod clocks;
mod disks;
mod ffmpeg;
mod files;
mod limits;
mod live_poses;
#[cfg(target_os = "linux")]
mod process;
#[cfg(target_os = "linux")]
mod soak;
mod stamps;
