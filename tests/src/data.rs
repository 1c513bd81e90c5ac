//! Where real data lies, if there is any.

use std::path::{Path, PathBuf};

/// The folder of real data (`kitti/`, `models/`): `WAYMARK_DATA`, else
/// `shared` beside the repository. Where it is absent this says so in one
/// line on the error stream.
pub fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("WAYMARK_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    if folder.join("kitti/sequences/04").is_dir() {
        return Some(folder);
    }
    eprintln!("no KITTI data in {} (set WAYMARK_DATA): nothing is tested on it", folder.display());
    None
}
