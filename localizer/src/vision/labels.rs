//! Probability maps as files: `FOLDER/CLASS/{frame:06}.png`, the class by its
//! [name](Class::name), 8-bit grey, `value / 255` the probability, each of the
//! image's size.
//!
//! A class without a folder has probability zero everywhere.

use std::path::{Path, PathBuf};

use super::image::{check_size, image_size, read_grey_png, write_grey_png};
use super::{Class, Error, ProbabilityMaps};

/// Where the map of a class and frame lies.
pub fn path(folder: &Path, class: Class, frame: usize) -> PathBuf {
    folder.join(class.name()).join(format!("{frame:06}.png"))
}

/// Columns and rows of the maps of a frame: those of the first class that has one.
///
/// # Errors
/// [`Error::NoLabels`] where no class has a map of this frame, and what
/// [`super::read_image`] says.
pub fn size(folder: &Path, frame: usize) -> Result<(usize, usize), Error> {
    let mut paths = Class::ALL.into_iter().map(|class| path(folder, class, frame));
    let first = paths.find(|path| path.exists());
    image_size(&first.ok_or_else(|| Error::NoLabels { folder: folder.into(), frame })?)
}

/// Reads the maps of a frame. With `expected`, the size of the image, a map
/// of another size is an error; else all have the size of the first.
///
/// # Errors
/// [`Error::NoLabels`] where no class has a map of this frame,
/// [`Error::MissingLabel`] where a class that has a folder has none,
/// [`Error::ImageSize`] where one has another size than the others or than
/// the image, and what [`read_grey_png`] says.
pub fn read(folder: &Path, frame: usize, expected: Option<(usize, usize)>) -> Result<ProbabilityMaps, Error> {
    let mut maps: Option<ProbabilityMaps> = None;
    if !Class::ALL.iter().any(|class| path(folder, *class, frame).exists()) {
        return Err(Error::NoLabels { folder: folder.into(), frame });
    }
    for class in Class::ALL.into_iter().filter(|class| folder.join(class.name()).exists()) {
        let path = path(folder, class, frame);
        if !path.exists() {
            return Err(Error::MissingLabel { path });
        }
        let plane = read_grey_png(&path)?;
        let size = (plane.width(), plane.height());
        check_size(&path, size, expected.or(maps.as_ref().map(|m| (m.width(), m.height()))).unwrap_or(size))?;
        maps.get_or_insert_with(|| ProbabilityMaps::zeros(size.0, size.1)).set(class, plane)?;
    }
    maps.ok_or_else(|| Error::NoLabels { folder: folder.into(), frame })
}

/// Folders with images in them that are of no class, by their names: a misspelt class would have
/// probability zero everywhere, and nobody would know.
///
/// # Errors
/// [`common::Error::Io`] where the folder cannot be read.
pub fn strangers(folder: &Path) -> Result<Vec<String>, Error> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(common::Error::io(folder))? {
        let inner = entry.map_err(common::Error::io(folder))?.path();
        let name = inner.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_image = |path: &Path| path.extension().is_some_and(|extension| extension == "png");
        // A file has no entries.
        let mut entries = std::fs::read_dir(&inner).into_iter().flatten().flatten();
        if Class::ALL.iter().all(|class| class.name() != name) && entries.any(|entry| is_image(&entry.path())) {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// Writes the maps of a frame, all classes; folders are created.
///
/// # Errors
/// [`common::Error::Io`] where a folder cannot be created, and what
/// [`write_grey_png`] says.
pub fn write(folder: &Path, frame: usize, maps: &ProbabilityMaps) -> Result<(), Error> {
    for class in Class::ALL {
        let path = path(folder, class, frame);
        let inner = folder.join(class.name());
        std::fs::create_dir_all(&inner).map_err(common::Error::io(&inner))?;
        write_grey_png(&path, maps.plane(class))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Plane;

    #[test]
    fn maps_survive_the_files_and_an_absent_class_is_zero() {
        let folder = tempfile::tempdir().unwrap();
        let mut maps = ProbabilityMaps::zeros(3, 2);
        maps.set(Class::Pole, Plane::new(3, vec![0, 1, 2, 253, 254, 255]).unwrap()).unwrap();
        write(folder.path(), 7, &maps).unwrap();
        assert_eq!(read(folder.path(), 7, Some((3, 2))).unwrap(), maps);
        std::fs::remove_dir_all(folder.path().join("lane")).unwrap();
        assert_eq!(read(folder.path(), 7, None).unwrap(), maps);
    }

    #[test]
    fn folders_of_no_class_are_strangers() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 7, &ProbabilityMaps::zeros(3, 2)).unwrap();
        std::fs::create_dir(folder.path().join("notes")).unwrap();
        std::fs::write(folder.path().join("list.png"), "").unwrap();
        assert!(strangers(folder.path()).unwrap().is_empty());
        for (class, name) in [(Class::Lane, "lanes"), (Class::Sign, "Sign")] {
            std::fs::rename(folder.path().join(class.name()), folder.path().join(name)).unwrap();
        }
        assert_eq!(strangers(folder.path()).unwrap(), ["Sign", "lanes"]);
    }

    #[test]
    fn a_missing_frame_and_a_wrong_size_are_named() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 7, &ProbabilityMaps::zeros(3, 2)).unwrap();
        assert!(matches!(read(folder.path(), 8, None), Err(Error::NoLabels { frame: 8, .. })));
        let lane = path(folder.path(), Class::Lane, 7);
        std::fs::rename(&lane, folder.path().join("kept.png")).unwrap();
        let error = read(folder.path(), 7, None).unwrap_err().to_string();
        assert!(error.contains("lane") && error.contains("000007.png is missing"), "{error}");
        std::fs::rename(folder.path().join("kept.png"), &lane).unwrap();
        write_grey_png(path(folder.path(), Class::Light, 7), &Plane::zeros(2, 2)).unwrap();
        let error = read(folder.path(), 7, None).unwrap_err().to_string();
        assert!(error.contains("000007.png has 2x2 px where 3x2"), "{error}");
    }
}
