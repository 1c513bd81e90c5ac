//! Files that are either whole or not there.
//!
//! The bytes go to a temporary file in the same folder, to the disk, and then
//! under the name: whoever opens the name sees the old content or the new one.
//!
//! Only a file is replaced. A symbolic link stays, and what it leads to is
//! written; what is no file (`/dev/null`, `/dev/stdout`, a named pipe) is given the
//! bytes when all are there.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Seek, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::{Error, Result};

/// Writes `bytes` to `path`, replacing what is there.
///
/// # Errors
/// [`Error::MissingFolder`] where the folder of `path` does not exist (it is
/// not created), [`Error::ClosedFolder`] where it takes no file, [`Error::Io`] where the operating system refuses. Then
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
    stage_with(path, content)?.commit()?;
    Ok(())
}

/// A file that is written and does not have its name yet. Where several belong
/// together, all are written before the first gets its name.
#[derive(Debug)]
#[must_use = "a staged file gets its name with `commit` only"]
pub struct Staged {
    path: PathBuf,
    file: NamedTempFile,
    target: Target,
}

/// Where bytes go.
#[derive(Debug)]
enum Target {
    /// To a file, or a name that is free.
    File(PathBuf),
    /// To what is no file, or links that lead nowhere.
    Other,
}

/// Writes the file that will be `path`.
///
/// # Errors
/// As [`write()`].
pub fn stage(path: impl AsRef<Path>, bytes: &[u8]) -> Result<Staged> {
    let path = path.as_ref();
    stage_with(path, |out| out.write_all(bytes).map_err(Error::io(path)))
}

/// Writes the file that will be `path` as `content` does.
///
/// # Errors
/// As [`write_with`].
pub fn stage_with<E: From<Error>>(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut BufWriter<&mut File>) -> std::result::Result<(), E>,
) -> std::result::Result<Staged, E> {
    let path = path.as_ref();
    let (target, folder) = (target(path), existing_folder(path)?);
    let mut file = temporary_file(path, &folder)?;
    let mut buffered = BufWriter::with_capacity(1 << 16, file.as_file_mut());
    content(&mut buffered)?;
    buffered.flush().map_err(Error::io(path))?;
    drop(buffered);
    file.as_file().sync_all().map_err(Error::io(path))?;
    Ok(Staged { path: path.to_path_buf(), file, target })
}

/// A file without its name, in the folder that `path` will be in.
fn temporary_file(path: &Path, folder: &Path) -> Result<NamedTempFile> {
    let file = tempfile::Builder::new().prefix(".waymark-").permissions_of_new_files().tempfile_in(folder);
    // What is said of it would name the temporary file.
    let closed = |why| Error::ClosedFolder { path: path.to_path_buf(), folder: folder.to_path_buf(), why };
    file.map_err(|error| closed(error.kind()))
}

impl Staged {
    /// Gives the file its name, replacing what is there.
    ///
    /// # Errors
    /// [`Error::Io`] where the operating system refuses.
    pub fn commit(self) -> Result<()> {
        let Self { path, mut file, target } = self;
        match target {
            Target::File(target) => {
                file.persist(target).map_err(|failed| Error::io(&path)(failed.error))?;
            }
            Target::Other => {
                let file = file.as_file_mut();
                file.rewind().and_then(|()| pass_on(file, &path)).map_err(Error::io(&path))?;
            }
        }
        Ok(())
    }
}

/// Writes a file to what is no file.
fn pass_on(file: &mut File, path: &Path) -> std::io::Result<()> {
    if is_output(path) {
        let mut output = std::io::stdout();
        let written = std::io::copy(file, &mut output).and_then(|_| output.flush());
        // As with `output::print`, a reader may be gone.
        return written.or_else(|error| if error.kind() == ErrorKind::BrokenPipe { Ok(()) } else { Err(error) });
    }
    std::io::copy(file, &mut OpenOptions::new().write(true).open(path)?)?;
    Ok(())
}

/// Whether a name is that of the standard output. Opened by it, one that is a file
/// would begin anew.
fn is_output(path: &Path) -> bool {
    ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path == Path::new(name))
}

/// Links that are followed to a name that is free: as many as Linux follows.
const MOST_LINKS: usize = 40;

fn target(path: &Path) -> Target {
    if is_other(path) {
        return Target::Other;
    }
    let mut target = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let Ok(next) = std::fs::read_link(&target) else { return Target::File(target) };
        target = folder_of(&target).join(next);
    }
    Target::Other
}

/// Whether what a name leads to is neither a file nor a folder; nor is the standard
/// output, wherever it goes.
pub fn is_other(path: &Path) -> bool {
    is_output(path) || std::fs::metadata(path).is_ok_and(|of| !of.is_file() && !of.is_dir())
}

/// The folder for temporary files on the way to a file: its own, or that of the system
/// where it is no file.
pub fn work_folder(path: &Path) -> PathBuf {
    match target(path) {
        Target::File(target) => folder_of(&target).to_path_buf(),
        Target::Other => std::env::temp_dir(),
    }
}

fn existing_folder(path: &Path) -> Result<PathBuf> {
    let folder = work_folder(path);
    if folder.is_dir() { Ok(folder) } else { Err(Error::MissingFolder { path: path.to_path_buf(), folder }) }
}

/// Whether a file can be put under a name, as far as folders go: to be asked before long
/// work, where it would be found out at the end. A file without a name is put there and
/// taken away: whether a folder takes one, its permissions do not say.
///
/// # Errors
/// [`Error::MissingFolder`] where the folder of `path` does not exist,
/// [`Error::IsAFolder`] where `path` is one, [`Error::ClosedFolder`] where the folder
/// takes no file.
pub fn check(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    let folder = existing_folder(path)?;
    if path.is_dir() {
        return Err(Error::IsAFolder { path: path.to_path_buf() });
    }
    temporary_file(path, &folder).map(drop)
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
    fn a_staged_file_gets_its_name_in_the_end_or_never() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.csm");
        drop(stage(&path, b"never").unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let staged = stage(&path, b"new").unwrap();
        assert!(!path.exists());
        staged.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_lead_to_what_is_written() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let [link, far, file] = ["link.csm", "far.csm", "maps/a.csm"].map(|name| folder.path().join(name));
        std::fs::create_dir(folder.path().join("maps")).unwrap();
        symlink("link.csm", &far).unwrap();
        symlink("maps/a.csm", &link).unwrap();
        for content in [b"first", b"later"] {
            write(&far, content).unwrap();
            assert!(link.is_symlink() && far.is_symlink());
            assert_eq!(std::fs::read(&file).unwrap(), content);
        }
        assert_eq!(std::fs::read_dir(folder.path().join("maps")).unwrap().count(), 1);
        let round = folder.path().join("round");
        symlink("round", &round).unwrap();
        assert!(write(&round, b"").unwrap_err().to_string().contains("round: "));
        assert!(round.is_symlink());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_no_file_is_given_the_bytes_and_stays() {
        use std::io::Read;
        use std::os::fd::AsRawFd;
        write("/dev/null", b"nothing").unwrap();
        assert!(is_other(Path::new("/dev/null")));
        assert!(write("/dev/full", b"too much").unwrap_err().to_string().contains("/dev/full: No space left"));
        let (mut reader, writer) = std::io::pipe().unwrap();
        write(format!("/proc/self/fd/{}", writer.as_raw_fd()), b"through").unwrap();
        drop(writer);
        let mut read = Vec::new();
        reader.read_to_end(&mut read).unwrap();
        assert_eq!(read, b"through");
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

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_takes_no_file_is_found_before_anything_is_written() {
        let path = Path::new("/proc/map.csm");
        for said in [check(path), write(path, b"")].map(|failed| failed.unwrap_err().to_string()) {
            assert!(said.starts_with("/proc/map.csm cannot be written: the folder /proc takes no file ("), "{said}");
            assert!(!said.contains(".waymark-") && said.ends_with("); make it writable, or give another"), "{said}");
        }
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
