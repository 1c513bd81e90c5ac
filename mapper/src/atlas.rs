//! Many maps as one atlas, and what is in one.

mod inspection;

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use common::atomic_file::is_other;
use common::map::atlas::{AtlasBuilder, AtlasOptions, AtlasSummary};
use common::map::decode_with_layout;

pub use inspection::AtlasInspection;

use crate::error::{Error, Result};
use crate::frames::{self, OneFrame};
use crate::outputs;

/// A map that goes into an atlas, with what tells it from others.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Source {
    /// The checksum at its end.
    checksum: [u8; 4],
    /// Its length, bytes.
    length: u64,
    path: PathBuf,
}

/// Makes an atlas of maps that share a frame and a quantum. `inputs` are map
/// files, and folders of which all `.csm` files are taken; their order and
/// names do not change the bytes. `progress` is told how many of how many maps
/// are in.
///
/// One map at a time is in memory, and as much of the others as the options
/// say.
///
/// # Errors
/// Inputs that cannot be read or are no maps, that are the same, of several frames, or do not
/// fit together; an output that cannot be written.
pub fn make(
    inputs: &[PathBuf],
    out: &Path,
    options: AtlasOptions,
    note: Option<String>,
    mut progress: impl FnMut(usize, usize),
) -> Result<AtlasSummary> {
    let sources = sources(inputs)?;
    outputs::check(&[("--out", out)], sources.iter().map(|source| &*source.path))?;
    let mut builder = AtlasBuilder::new(out, options);
    let mut frame = OneFrame::default();
    for (done, source) in sources.iter().enumerate() {
        progress(done, sources.len());
        let bytes = std::fs::read(&source.path).map_err(common::Error::io(&source.path))?;
        frame.add(&source.path, frames::beside(&source.path, &bytes))?;
        let (map, layout) = decode_with_layout(&bytes).map_err(common::Error::in_file(&source.path))?;
        builder.add(&map, layout.quantum_m).map_err(common::Error::in_file(&source.path))?;
    }
    progress(sources.len(), sources.len());
    Ok(builder.write(note)?)
}

/// The maps in an order that their content gives.
fn sources(inputs: &[PathBuf]) -> Result<Vec<Source>> {
    let mut sources = Vec::new();
    for input in inputs {
        if input.is_dir() {
            for entry in std::fs::read_dir(input).map_err(common::Error::io(input))? {
                let path = entry.map_err(common::Error::io(input))?.path();
                if path.extension().is_some_and(|extension| extension == "csm") {
                    sources.push(source(path)?);
                }
            }
        } else {
            sources.push(source(input.clone())?);
        }
    }
    if sources.is_empty() {
        return Err(Error::NoMaps { inputs: inputs.to_vec() });
    }
    sources.sort();
    // Alike at the end and in length: the same map, or one in billions that
    // the names have to put in order.
    for pair in sources.windows(2) {
        let [first, second] = pair else { continue };
        if (first.checksum, first.length) == (second.checksum, second.length) {
            let read = |path: &PathBuf| std::fs::read(path).map_err(common::Error::io(path));
            if read(&first.path)? == read(&second.path)? {
                return Err(Error::SameMap { first: first.path.clone(), second: second.path.clone() });
            }
        }
    }
    Ok(sources)
}

fn source(path: PathBuf) -> Result<Source> {
    if is_other(&path) {
        return Err(common::Error::NoFile { path }.into());
    }
    let end = |path: &Path| {
        let mut file = std::fs::File::open(path)?;
        let length = file.metadata()?.len();
        let mut checksum = [0; 4];
        // A file that is shorter is no map, which is told when it is read.
        file.seek(SeekFrom::Start(length.saturating_sub(4)))?;
        let mut rest = Vec::new();
        file.take(4).read_to_end(&mut rest)?;
        checksum.iter_mut().zip(rest).for_each(|(byte, read)| *byte = read);
        Ok((checksum, length))
    };
    let (checksum, length) = end(&path).map_err(common::Error::io(&path))?;
    Ok(Source { checksum, length, path })
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::atlas::Atlas;
    use common::map::{EncodeOptions, Pole, PoleKind, Road, RoadId, SemanticMap};
    use nalgebra::Point3;

    fn write(folder: &Path, name: &str, x_m: f64) -> PathBuf {
        let map = SemanticMap {
            roads: vec![Road { path_map: vec![Point3::new(x_m, 0.0, 0.0), Point3::new(x_m, 0.0, 50.0)] }],
            poles: vec![Pole {
                kind: PoleKind::LampPost,
                foot_map: Point3::new(x_m + 4.0, 1.6, 10.0),
                top_map: Point3::new(x_m + 4.0, -3.4, 10.0),
                road: RoadId(0),
            }],
            ..SemanticMap::default()
        };
        let path = folder.join(name);
        common::map::write(&path, &map, &EncodeOptions::default()).unwrap();
        path
    }

    fn made(inputs: &[PathBuf], out: &Path) -> Result<Vec<u8>> {
        make(inputs, out, AtlasOptions::default(), None, |_, _| ())?;
        Ok(std::fs::read(out).unwrap())
    }

    #[test]
    fn order_names_and_folders_do_not_change_the_bytes() {
        let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let [a, b] = [write(folder.path(), "a.csm", 0.0), write(folder.path(), "b.csm", 4000.0)];
        let out = folder.path().join("all.csa");
        let bytes = made(&[a.clone(), b.clone()], &out).unwrap();
        assert_eq!(made(&[b.clone(), a], &out).unwrap(), bytes);
        assert_eq!(made(&[folder.path().to_path_buf()], &out).unwrap(), bytes);
        let renamed = [write(elsewhere.path(), "y.csm", 0.0), write(elsewhere.path(), "x.csm", 4000.0)];
        assert_eq!(made(&renamed, &out).unwrap(), bytes);
        assert_eq!(Atlas::open(&out).unwrap().summary().counts.poles, 2);
    }

    #[test]
    fn an_atlas_can_be_looked_at() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "a.csm", 0.0);
        write(folder.path(), "b.csm", 4000.0);
        let out = folder.path().join("all.csa");
        let bytes = made(&[folder.path().to_path_buf()], &out).unwrap();
        let inspection = AtlasInspection::of_file(&out).unwrap();
        assert_eq!((inspection.bytes, inspection.poles, inspection.tiles), (bytes.len() as u64, 2, 2));
        assert!((inspection.road_m - 100.0).abs() < 1e-9);
        let [least, median, most] = inspection.tile_bytes;
        assert!(0 < least && least <= median && median <= most && most < 100);
        let tiles: u64 = bytes.len() as u64 - inspection.index_bytes;
        assert!((2 * least as u64..=2 * most as u64).contains(&tiles), "{tiles}");
        let text = inspection.text();
        assert!(text.contains("2 poles") && text.contains("0.1 km of road"), "{text}");
    }

    #[test]
    fn what_cannot_be_put_together_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let a = write(folder.path(), "a.csm", 0.0);
        let out = folder.path().join("all.csa");
        let copy = folder.path().join("copy.csm");
        std::fs::copy(&a, &copy).unwrap();
        let said = made(&[copy, a.clone()], &out).unwrap_err().to_string();
        assert!(said.contains("a.csm") && said.contains("copy.csm") && said.contains("the same map"), "{said}");
        let empty = folder.path().join("empty");
        std::fs::create_dir(&empty).unwrap();
        assert!(made(&[empty], &out).unwrap_err().to_string().contains("no .csm file"));
        let text = folder.path().join("c.csm");
        std::fs::write(&text, "no").unwrap();
        assert!(made(&[a, text], &out).unwrap_err().to_string().contains("c.csm: this is no Waymark map"));
        assert!(!out.exists());
    }
}
