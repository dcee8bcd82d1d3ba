//! What the system says about a running program.

use std::fs;

/// What a process uses.
#[derive(Debug, Clone, Copy)]
pub(super) struct Usage {
    /// Memory that is resident, in KiB.
    pub(super) memory_kib: u64,
    /// Open files, pipes and the like.
    pub(super) handles: usize,
    pub(super) threads: usize,
}

/// Returns what a process uses; `None` if it has ended.
pub(super) fn usage(process: u32) -> Option<Usage> {
    let handles = fs::read_dir(format!("/proc/{process}/fd")).ok()?;
    Some(Usage {
        memory_kib: status(process, "VmRSS:")?,
        handles: handles.count(),
        threads: status(process, "Threads:")? as usize,
    })
}

/// Returns the peak of the memory of a process in MiB; `None` if it has ended.
pub(super) fn peak_mib(process: u32) -> Option<u64> {
    Some(status(process, "VmHWM:")? >> 10)
}

/// Describes what each thread of a process is doing: its name, its state, and the call to the system that it is in.
pub(super) fn threads(process: u32) -> String {
    let threads = fs::read_dir(format!("/proc/{process}/task"));
    let describe = |folder: std::path::PathBuf| {
        let read = |file: &str| fs::read_to_string(folder.join(file)).unwrap_or_default();
        ["stat", "wchan", "syscall"].map(read).join(" ")
    };
    let threads = threads.into_iter().flatten().flatten();
    let threads = threads.map(|thread| describe(thread.path()));
    threads.collect::<Vec<_>>().join("\n")
}

/// Returns a number from /proc/PROCESS/status; `None` if the process has ended.
fn status(process: u32, key: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.split_whitespace().next()?.parse().ok()
}
