//! Runs of the real program and the rows that they write.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output};
use std::time::Duration;

/// The first line of every tracks.csv.
pub(crate) const HEADER: &str = "frame,time_s,target,state,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,heading_rad,\
                          xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2,ess,confidence,best_x_m,best_y_m,best_z_m,\
                          radius_m,sigma_radius_m,sigma_heading_rad,\
                          vxx_m2ps2,vxy_m2ps2,vxz_m2ps2,vyy_m2ps2,vyz_m2ps2,vzz_m2ps2";

/// Returns the fields of the rows of a tracks.csv after checking that header and rows are complete.
pub(crate) fn rows_in(text: &str) -> Vec<Vec<String>> {
    assert!(text.ends_with('\n'), "the last row is not whole: {text}");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(HEADER));
    lines
        .map(|line| {
            let fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            assert_eq!(fields.len(), 31, "{line}");
            fields
        })
        .collect()
}

/// The outcome of a run.
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    /// The lines of standard error about results of an earlier run that were kept. Most tests track several times in one
    /// folder, so they are not part of `stderr`.
    pub(crate) kept: Vec<String>,
}

impl Run {
    /// Runs a command to its end.
    pub(crate) fn of(command: &mut Command) -> Self {
        Self::from(command.output().unwrap())
    }

    /// Runs `pardalis` with these arguments in a folder.
    pub(crate) fn pardalis(folder: impl AsRef<Path>, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
        Self::of(command.current_dir(folder).args(arguments))
    }

    /// Returns the outcome of a program that has ended. Whatever the input, it must not have panicked.
    pub(crate) fn from(output: Output) -> Self {
        let stderr = String::from_utf8(output.stderr).unwrap();
        let lines = stderr.split_inclusive('\n');
        let (kept, others): (Vec<_>, Vec<_>) =
            lines.partition(|line| line.contains(" of an earlier run is kept as "));
        let run = Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: others.concat(),
            kept: kept.iter().map(|line| line.trim_end().to_owned()).collect(),
        };
        assert!(!run.stderr.contains("panicked"), "{}", run.stderr);
        run
    }

    /// Checks that the run succeeded and wrote nothing to standard error.
    #[track_caller]
    pub(crate) fn fine(self) -> Self {
        assert_eq!((self.code, &*self.stderr), (Some(0), ""));
        self
    }

    /// Checks that the user's input was rejected with a message that contains all of `wanted`.
    #[track_caller]
    pub(crate) fn refused(&self, wanted: &[&str]) {
        assert_eq!(self.code, Some(2), "{}", self.stderr);
        assert!(self.stderr.starts_with("error: "), "{}", self.stderr);
        assert_eq!(self.stdout, "");
        for wanted in wanted {
            let found = self.stderr.contains(wanted);
            assert!(found, "no {wanted:?} in: {}", self.stderr);
        }
    }
}

/// Waits until a running program has written this many lines to a file; fails after a minute.
#[track_caller]
pub(crate) fn wait_for_lines(child: &mut Child, path: &Path, count: usize) {
    let written = || fs::read_to_string(path).unwrap_or_default().lines().count();
    for _ in 0..30_000 {
        if written() >= count {
            return;
        }
        let ended = child.try_wait().unwrap();
        assert!(ended.is_none(), "it ended before it wrote {count} lines");
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("it wrote {} of {count} lines", written());
}

/// Interrupts a running program, and returns how it ends.
pub(crate) fn interrupt(child: Child) -> Run {
    let id = child.id();
    interrupted(child, &id.to_string())
}

/// Interrupts a running program that leads a process group, and all programs of this group, as Ctrl-C in a terminal does.
/// Returns how it ends.
pub(crate) fn interrupt_group(child: Child) -> Run {
    let id = child.id();
    interrupted(child, &format!("-{id}"))
}

fn interrupted(child: Child, target: &str) -> Run {
    // The shell's built-in kill, because the program of that name is not installed everywhere.
    let sent = Command::new("/bin/sh")
        .args(["-c", &format!("kill -s INT -- {target}")])
        .status()
        .unwrap();
    assert!(sent.success());
    Run::from(child.wait_with_output().unwrap())
}
