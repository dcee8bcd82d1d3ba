//! Atomic replacement of files.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use crate::user_error::user_error;

/// Writes a file via a temporary file next to it, so that a failure leaves the previous content intact.
///
/// Errors: the file cannot be written.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
    let written = File::create(&partial)
        .and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&partial, path));
    written.map_err(|error| {
        // If the temporary file could not be created, there is nothing to remove.
        let _ = fs::remove_file(&partial);
        user_error!(
            "{}: cannot be written ({error}); choose an existing folder with write permission",
            path.display()
        )
    })
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
}
