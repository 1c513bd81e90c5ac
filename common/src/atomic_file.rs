//! Files that are either whole or not there.
//!
//! The bytes go to a temporary file in the same folder, to the disk, and then
//! under the name: whoever opens the name sees the old content or the new one.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::{Error, Result};

/// Writes `bytes` to `path`, replacing what is there.
///
/// # Errors
/// [`Error::MissingFolder`] where the folder of `path` does not exist (it is
/// not created), [`Error::Io`] where the operating system refuses. Then
/// `path` is as it was.
pub fn write(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let path = path.as_ref();
    write_with(path, |out| out.write_all(bytes).map_err(Error::io(path)))
}

/// Writes to `path` what `content` writes, buffered, replacing what is there.
///
/// # Errors
/// As [`write()`], and whatever `content` returns; `E` is the error type of the
/// caller. Then `path` is as it was.
pub fn write_with<E: From<Error>>(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut dyn Write) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    write_seek_with(path, |out| content(out))
}

/// As [`write_with`], for content that goes back to fill in what was not known
/// at first.
///
/// # Errors
/// As [`write_with`].
pub fn write_seek_with<E: From<Error>>(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut BufWriter<&mut File>) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    let path = path.as_ref();
    let folder = folder_of(path);
    if !folder.is_dir() {
        let (path, folder) = (path.to_path_buf(), folder.to_path_buf());
        return Err(Error::MissingFolder { path, folder }.into());
    }
    let mut file = tempfile::Builder::new()
        .prefix(".waymark-")
        .permissions_of_new_files()
        .tempfile_in(folder)
        .map_err(Error::io(path))?;
    let mut buffered = BufWriter::with_capacity(1 << 16, file.as_file_mut());
    content(&mut buffered)?;
    buffered.flush().map_err(Error::io(path))?;
    drop(buffered);
    file.as_file().sync_all().map_err(Error::io(path))?;
    file.persist(path).map_err(|failed| Error::io(path)(failed.error))?;
    Ok(())
}

/// Whether a file can be put under a name, as far as folders go: to be asked before long
/// work, where it would be found out at the end.
///
/// # Errors
/// [`Error::MissingFolder`] where the folder of `path` does not exist,
/// [`Error::IsAFolder`] where `path` is one.
pub fn check(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(Error::MissingFolder { path: path.to_path_buf(), folder: folder.to_path_buf() });
    }
    if path.is_dir() { Err(Error::IsAFolder { path: path.to_path_buf() }) } else { Ok(()) }
}

/// The same of a folder that is created with those that hold it.
///
/// # Errors
/// [`Error::NotAFolder`] where it, or what should hold it, is a file.
pub fn check_folder(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    match path.ancestors().find(|above| above.exists()) {
        Some(file) if !file.is_dir() => Err(Error::NotAFolder { path: path.to_path_buf(), file: file.to_path_buf() }),
        _ => Ok(()),
    }
}

/// The folder that a file is, or would be, in.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Temporary files are private by default; ours become results, so they get
/// the permissions that any new file gets.
trait NewFilePermissions {
    /// Read and write for everybody, less the process's umask.
    fn permissions_of_new_files(&mut self) -> &mut Self;
}

impl NewFilePermissions for tempfile::Builder<'_, '_> {
    #[cfg(unix)]
    fn permissions_of_new_files(&mut self) -> &mut Self {
        use std::os::unix::fs::PermissionsExt;
        self.permissions(std::fs::Permissions::from_mode(0o666))
    }

    #[cfg(not(unix))]
    fn permissions_of_new_files(&mut self) -> &mut Self {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.csm");
        write(&path, b"old").unwrap();
        let failed = write_with(&path, |out| {
            out.write_all(b"half").map_err(Error::io(&path))?;
            Err(Error::NotAMap)
        });
        assert!(matches!(failed, Err(Error::NotAMap)));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let failed = write(folder.path().join("not_there").join("x"), b"").unwrap_err();
        assert!(failed.to_string().contains("not_there does not exist; create it"), "{failed}");
    }

    #[test]
    fn what_stands_in_the_way_is_found_before_anything_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("file"), b"").unwrap();
        for fine in ["", "new", "new/one"] {
            check_folder(at(fine)).unwrap();
        }
        for file in ["file", "file/new/one"] {
            assert!(matches!(check_folder(at(file)), Err(Error::NotAFolder { file, .. }) if file == at("file")));
        }
        assert!(check(at("file")).is_ok() && check(at("new")).is_ok());
        assert!(matches!(check(folder.path()), Err(Error::IsAFolder { .. })));
        assert!(matches!(check(at("new/one")), Err(Error::MissingFolder { .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_was_written() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("plain"), b"").unwrap();
        write(folder.path().join("ours"), b"").unwrap();
        let mode = |name| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        assert_eq!(mode("ours"), mode("plain"));
    }
}
