//! That nothing is written over what is read, nor over another output.

use std::path::{Path, PathBuf};

use common::atomic_file::{self, folder_of, is_other};

use crate::error::{Error, Result};

/// What will be written: the option that says so, and where.
pub type Output<'a> = (&'static str, &'a Path);

/// That outputs have a folder each, and a file each, which none of the inputs is. It is
/// asked before the work, not after it.
///
/// # Errors
/// As [`atomic_file::check`], [`Error::SameOutput`] and [`Error::OutputIsInput`].
pub fn check<'a>(outputs: &[Output], inputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    let mut taken: Vec<(&str, PathBuf)> = Vec::new();
    // Nothing is replaced in what is no file.
    for (option, path) in outputs.iter().filter(|(_, path)| !is_other(path)) {
        let (option, path) = (*option, path.to_path_buf());
        atomic_file::check(&path)?;
        let file = whole(&path);
        if let Some((first, _)) = taken.iter().find(|(_, other)| *other == file) {
            return Err(Error::SameOutput { path, first: (*first).into(), second: option.into() });
        }
        taken.push((option, file));
    }
    for input in inputs {
        let file = whole(input);
        if let Some((option, _)) = taken.iter().find(|(_, output)| *output == file) {
            return Err(Error::OutputIsInput { path: input.to_path_buf(), option: (*option).into() });
        }
    }
    Ok(())
}

/// The one path of a file, however it is spelled and whatever leads to it.
fn whole(path: &Path) -> PathBuf {
    let free = || Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize().ok().or_else(free).unwrap_or_else(|| path.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_is_neither_an_input_nor_another_output() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, poses] = ["a.csm", "b.txt", "poses.txt"].map(|name| folder.path().join(name));
        std::fs::write(&poses, "").unwrap();
        let around = folder.path().join("x/..");
        std::fs::create_dir(folder.path().join("x")).unwrap();
        let said = |second: &Path, input: &Path| {
            check(&[("--out", &a), ("--trajectory", second)], [input]).map_err(|e| e.to_string())
        };
        assert_eq!(said(&b, &poses), Ok(()));
        for spelled in [a.clone(), around.join("a.csm")] {
            let said = said(&spelled, &poses).unwrap_err();
            assert!(said.contains("a.csm: --out and --trajectory would be one file"), "{said}");
        }
        let over = said(&around.join("poses.txt"), &poses).unwrap_err();
        assert!(over.contains("poses.txt: it is read, and --trajectory would replace it"), "{over}");
        assert!(said(&folder.path().join("no/b.txt"), &poses).unwrap_err().contains("create it first"));
        assert!(said(&folder.path().join("x"), &poses).unwrap_err().contains("x cannot be written: it is a folder"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&poses, &b).unwrap();
            assert!(said(&b, &poses).unwrap_err().contains("--trajectory would replace it"));
            let null = Path::new("/dev/null");
            assert!(check(&[("--out", null), ("--trajectory", null)], [null]).is_ok());
        }
    }
}
