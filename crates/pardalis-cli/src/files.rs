//! Atomic replacement of files, and files of rows that stay whole.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;

use anyhow::{Error, Result};

use crate::output::Shown;
use crate::user_error::user_error;

/// Longer lines than this have no place in a table, in bytes.
const MAX_LINE_BYTES: usize = 1 << 20;

/// Writes a file via a temporary file next to it, so that a failure leaves the previous content intact. A device or a pipe
/// receives the bytes directly, and a link stays one.
///
/// Errors: the file cannot be written.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let is_replaced = fs::metadata(path).map_or(true, |metadata| metadata.is_file());
    let written = if is_replaced {
        // A link that leads nowhere is replaced.
        let place = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        replace(&place, bytes)
    } else {
        File::options()
            .write(true)
            .open(path)
            .and_then(|mut file| file.write_all(bytes))
    };
    written.map_err(|error| unwritable(path, error))
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
    let written = File::create(&partial)
        .and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&partial, path));
    if written.is_err() {
        // If the temporary file could not be created, there is nothing to remove.
        let _ = fs::remove_file(&partial);
    }
    written
}

/// Returns the error of a file that cannot be written. The user's input is to blame if another name would help, but not for
/// a full disk.
pub(crate) fn unwritable(path: &Path, error: io::Error) -> Error {
    let name = path.shown();
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
            Error::new(error).context(format!(
                "{name}: cannot be written: the disk is full, or no larger file is allowed; free some space, or choose \
                 another folder"
            ))
        }
        // Deliberately by its reader; callers look for it.
        ErrorKind::BrokenPipe => Error::new(error).context(format!("{name}: cannot be written")),
        _ => user_error!(
            "{name}: cannot be written ({error}); choose an existing folder with write permission"
        ),
    }
}

/// Fails if a folder for results holds a link. Results written through it would replace a file elsewhere, and the folder may
/// have come with the scene of somebody else. What cannot be listed has no links.
pub(crate) fn refuse_links(folder: &Path) -> Result<()> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let links = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_symlink()));
    match links.map(|entry| entry.path()).min() {
        Some(link) => Err(user_error!(
            "{}: is a link, through which results could replace a file elsewhere; remove it, or choose another folder \
             for the results",
            link.shown()
        )),
        None => Ok(()),
    }
}

/// Fails if there is a file at the path that an option names for a result, unless the result may replace it: most likely the path is
/// that of something else, such as an input. An empty file, a device and a pipe take any result.
pub(crate) fn refuse_foreign(
    option: &str,
    path: &Path,
    what: &str,
    is_own: impl Fn(&Path) -> bool,
) -> Result<()> {
    let is_empty = |path: &Path| fs::metadata(path).is_ok_and(|metadata| metadata.len() == 0);
    if !path.is_file() || is_empty(path) || is_own(path) {
        return Ok(());
    }
    Err(user_error!(
        "{option} {}: exists and holds no {what}; choose another name, or remove it",
        path.shown()
    ))
}

/// A table that grows by whole rows, whatever fails.
pub(crate) struct RowFile {
    out: Out,
    /// The destination, for messages.
    place: String,
    /// Number of bytes of the rows that are complete.
    whole_bytes: u64,
}

enum Out {
    File(File),
    Stdout(io::Stdout),
}

impl RowFile {
    /// Creates a file, or empties an existing one.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|error| unwritable(path, error))?;
        Ok(Self {
            out: Out::File(file),
            place: path.shown(),
            whole_bytes: 0,
        })
    }

    /// Returns the table that is printed on standard output.
    pub(crate) fn stdout() -> Self {
        Self {
            out: Out::Stdout(io::stdout()),
            place: "standard output".to_owned(),
            whole_bytes: 0,
        }
    }

    /// Adds rows at once, so that neither a reader nor a crash sees half a row. If they cannot be written, the file ends
    /// with the rows before them.
    ///
    /// Errors: they cannot be written, or the file has been removed.
    pub(crate) fn write(&mut self, rows: &str) -> Result<()> {
        if let Out::File(file) = &self.out
            && is_removed(file)
        {
            return Err(anyhow::anyhow!(
                "{}: was removed while it was written, and its rows are lost; choose a folder that nothing clears",
                self.place
            ));
        }
        let written = match &mut self.out {
            Out::File(file) => file.write_all(rows.as_bytes()),
            Out::Stdout(stdout) => stdout
                .write_all(rows.as_bytes())
                .and_then(|()| stdout.flush()),
        };
        if let (Err(_), Out::File(file)) = (&written, &self.out) {
            // Pipes and devices have no length; what they took is gone.
            let _ = file.set_len(self.whole_bytes);
        }
        written.map_err(|error| unwritable(Path::new(&self.place), error))?;
        self.whole_bytes += rows.len() as u64;
        Ok(())
    }
}

/// Reports whether an open file has no name any more, so that nobody can read what is written into it. Writing succeeds
/// nevertheless.
#[cfg(unix)]
fn is_removed(file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.metadata().is_ok_and(|metadata| metadata.nlink() == 0)
}

/// Other systems do not remove open files.
#[cfg(not(unix))]
fn is_removed(_: &File) -> bool {
    false
}

/// A reader that fails at lines too long for a table, before they fill the memory.
pub(crate) struct Lines<R> {
    input: R,
    /// Length so far of the line that is read, in bytes.
    line_bytes: usize,
}

impl Lines<File> {
    /// Opens a file.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        Ok(Self {
            input: File::open(path)?,
            line_bytes: 0,
        })
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.input.read(buffer)?;
        for part in buffer[..length].split_inclusive(|byte| *byte == b'\n') {
            self.line_bytes += part.len();
            if self.line_bytes > MAX_LINE_BYTES {
                let what =
                    format!("a line has more than {MAX_LINE_BYTES} bytes, so it is not a table");
                return Err(io::Error::new(ErrorKind::InvalidData, what));
            }
            if part.ends_with(b"\n") {
                self.line_bytes = 0;
            }
        }
        Ok(length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_replaced_without_leftovers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        write_file(&path, b"old").unwrap();
        write_file(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    }

    #[test]
    fn a_failed_write_names_the_file_and_keeps_the_previous_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        // A folder of that name cannot be replaced by a file.
        fs::create_dir(&path).unwrap();
        let error = write_file(&path, b"new").unwrap_err();
        assert!(error.is::<crate::user_error::UserError>());
        assert!(error.to_string().contains("model.toml"), "{error}");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_and_devices_stay_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_file(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        // Not /dev/null itself: a mistake would replace it.
        let null = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write_file(&null, b"new").unwrap();
        assert!(null.is_symlink());
        assert!(!Path::new("/dev/null").is_file());
    }

    #[test]
    fn a_full_disk_is_named_and_is_not_the_users_mistake() {
        let full = io::Error::from(ErrorKind::StorageFull);
        let error = unwritable(Path::new("out/tracks.csv"), full);
        assert!(!error.is::<crate::user_error::UserError>());
        assert!(
            error
                .to_string()
                .contains("out/tracks.csv: cannot be written: the disk is full")
        );
    }
}
