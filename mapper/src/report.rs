//! What a build did, written beside its map: `04.build.json` for `04.csm`.

use std::path::{Path, PathBuf};

use common::atomic_file::{self, Staged, is_other};
use serde::{Deserialize, Serialize};

use crate::build::PoseSource;
use crate::cloud::StitchedScan;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::evidence::MapEvidence;
use crate::input::MapFrame;
use crate::register;

/// What a build did. It depends on the input and the settings only, so the
/// same build writes the same bytes: times and memory are not in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildReport {
    /// Length of the map file, bytes.
    pub map_bytes: usize,
    /// Checksum of the map file: tells whether this is its report.
    pub map_crc32c: u32,
    /// Where the poses come from.
    pub poses: PoseSource,
    /// Frames of the drive, stitched or not.
    pub frames: usize,
    /// What places the map in the world; none in reports of versions that did not keep it.
    #[serde(default)]
    pub frame: Option<MapFrame>,
    /// The scans that were stitched.
    pub scans: ScanCounts,
    /// What the refinement of the poses estimated and what it gave.
    pub registration: register::Report,
    /// Steps of the survey that the vehicle did not make; none in reports of versions that did
    /// not ask.
    #[serde(default)]
    pub survey_jumps: Vec<register::SurveyJump>,
    /// How well each landmark is known, in the order in which the map's file
    /// is decoded.
    #[serde(default)]
    pub evidence: MapEvidence,
    /// All settings, by the names that they had in the version that built the
    /// map.
    pub config: serde_json::Value,
}

impl BuildReport {
    /// A setting, by its JSON pointer (RFC 6901); none where the version that
    /// built the map had no such number.
    pub fn setting(&self, pointer: &str) -> Option<f64> {
        self.config.pointer(pointer)?.as_f64()
    }
}

/// Points of the stitched scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScanCounts {
    /// Number of scans.
    pub scans: usize,
    /// First stitched frame.
    pub first_frame: usize,
    /// Last stitched frame.
    pub last_frame: usize,
    /// Points that could be used.
    pub points: usize,
    /// Points dropped because a value of theirs is not finite.
    pub dropped_not_finite: usize,
    /// Points dropped because they are no returns or too far away.
    pub dropped_out_of_range: usize,
    /// Points dropped because their file says that they are withheld or noise.
    #[serde(default, skip_serializing_if = "is_none")]
    pub dropped_as_noise: usize,
}

/// Few formats say of a point that it is noise, and so few reports do.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_none(count: &usize) -> bool {
    *count == 0
}

impl ScanCounts {
    /// Adds a scan that was not added before; by ascending frame.
    pub fn add(&mut self, scan: &StitchedScan) {
        if self.scans == 0 {
            self.first_frame = scan.frame;
        }
        self.last_frame = scan.frame;
        self.scans += 1;
        self.points += scan.points;
        self.dropped_not_finite += scan.dropped_not_finite;
        self.dropped_out_of_range += scan.dropped_out_of_range;
        self.dropped_as_noise += scan.dropped_as_noise;
    }
}

/// Settings as a report has them.
///
/// # Errors
/// [`Error::BadReport`] with the path of the report, where they have no JSON
/// form, which is a fault of [`Config`].
pub fn settings(map: &Path, config: &Config) -> Result<serde_json::Value> {
    serde_json::to_value(config).map_err(Error::report(&path_beside(map)))
}

/// Where the report of a map lies.
pub fn path_beside(map: &Path) -> PathBuf {
    map.with_extension("build.json")
}

/// The checksum at the end of a map file; 0 where the file is shorter.
pub fn checksum(map_bytes: &[u8]) -> u32 {
    map_bytes.last_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

/// Writes a map and the report beside it. Nothing lies beside what is no file.
///
/// # Errors
/// As [`atomic_file::write`]; then the map is as it was.
pub fn write_with_map(map: &Path, map_bytes: &[u8], report: Option<&BuildReport>) -> Result<()> {
    let staged = report.map(|report| stage_beside(map, report)).transpose()?.flatten();
    let map = atomic_file::stage(map, map_bytes)?;
    // The map last: where the run ends between the two, the old map is known not to be
    // that of the report.
    if let Some(staged) = staged {
        staged.commit()?;
    }
    Ok(map.commit()?)
}

/// Writes the report that will lie beside a map; none beside what is no file.
///
/// # Errors
/// As [`atomic_file::stage`].
pub fn stage_beside(map: &Path, report: &BuildReport) -> Result<Option<Staged>> {
    if is_other(map) {
        return Ok(None);
    }
    let path = path_beside(map);
    let mut text = serde_json::to_string_pretty(report).map_err(Error::report(&path))?;
    text.push('\n');
    Ok(Some(atomic_file::stage(&path, text.as_bytes())?))
}

/// What lies beside a map as the report of its build.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Beside {
    /// The report about these very bytes.
    pub own: Option<BuildReport>,
    /// Why the report that lies there is passed over, for people: it is of another map.
    pub note: Option<String>,
}

/// Reads the report that lies beside a map of these bytes, if one does.
///
/// # Errors
/// [`Error::BadReport`] where the file beside the map is no report,
/// [`common::Error::Io`] where it cannot be read.
pub fn read_beside(map: &Path, map_bytes: &[u8]) -> Result<Beside> {
    let path = path_beside(map);
    let text = match std::fs::read(&path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Beside::default()),
        read => read.map_err(common::Error::io(&path))?,
    };
    let report: BuildReport = serde_json::from_slice(&text).map_err(Error::report(&path))?;
    if report.map_bytes == map_bytes.len() && report.map_crc32c == checksum(map_bytes) {
        return Ok(Beside { own: Some(report), note: None });
    }
    let note = format!(
        "{} is the report of another map and is passed over, so how {} was built is not known and its landmarks count \
         as known alike: put the report of its own build there, or remove this one",
        path.display(),
        map.display()
    );
    Ok(Beside { own: None, note: Some(note) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(map_bytes: &[u8]) -> BuildReport {
        let mut scans = ScanCounts::default();
        for frame in [5, 10] {
            scans.add(&StitchedScan {
                frame,
                points: 100,
                dropped_not_finite: 1,
                dropped_out_of_range: 2,
                dropped_as_noise: 3,
            });
        }
        BuildReport {
            map_bytes: map_bytes.len(),
            map_crc32c: checksum(map_bytes),
            poses: PoseSource::Refine,
            frames: 11,
            frame: None,
            scans,
            registration: register::Report { vertical_angle_rad: 0.1, ..register::Report::default() },
            survey_jumps: Vec::new(),
            evidence: MapEvidence::default(),
            config: settings(Path::new("04.csm"), &Config::default()).unwrap(),
        }
    }

    #[test]
    fn a_report_belongs_to_the_bytes_of_one_map() {
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("04.csm");
        assert_eq!(read_beside(&map, b"some map").unwrap(), Beside::default());
        let written = report(b"some map");
        write_with_map(&map, b"some map", Some(&written)).unwrap();
        assert!(folder.path().join("04.build.json").exists());
        assert_eq!(read_beside(&map, b"some map").unwrap(), Beside { own: Some(written), note: None });
        let Beside { own, note } = read_beside(&map, b"some mop").unwrap();
        assert!(own.is_none() && note.unwrap().contains("04.build.json is the report of another map"));
        std::fs::write(path_beside(&map), "{}").unwrap();
        assert!(read_beside(&map, b"some map").unwrap_err().to_string().contains("04.build.json"));
    }

    #[test]
    fn the_report_of_another_version_tells_all_but_unknown_settings() {
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("04.csm");
        let mut written = report(b"some map");
        written.config = serde_json::json!({ "a_setting_of_then": 3.0 });
        write_with_map(&map, b"some map", Some(&written)).unwrap();
        let read = read_beside(&map, b"some map").unwrap().own.unwrap();
        assert_eq!(
            (read.setting("/a_setting_of_then"), read.setting("/refine/graph/survey_sigma_m")),
            (Some(3.0), None)
        );
        assert_eq!(read, written);
    }

    #[test]
    fn the_report_of_an_earlier_version_is_read_without_what_it_did_not_ask() {
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("04.csm");
        let mut written = serde_json::to_value(report(b"some map")).unwrap();
        let registration = written["registration"].as_object_mut().unwrap();
        for key in ["survey_doubted_frames", "survey_doubt_most"] {
            assert!(registration.remove(key).is_some(), "{key}");
        }
        std::fs::write(path_beside(&map), written.to_string()).unwrap();
        assert_eq!(read_beside(&map, b"some map").unwrap().own, Some(report(b"some map")));
    }

    #[test]
    fn a_doubted_survey_is_named() {
        let mut doubted = report(b"");
        let is_named = |report: &BuildReport| crate::inspect::build_text(report).contains("contradicts the scans");
        assert!(!is_named(&doubted));
        (doubted.registration.survey_doubted_frames, doubted.registration.survey_doubt_most) = (9, 4.2);
        assert!(is_named(&doubted) && crate::inspect::build_text(&doubted).contains("around 9"));
    }

    #[test]
    fn counts_add_up() {
        let counts = report(b"").scans;
        assert_eq!((counts.scans, counts.first_frame, counts.last_frame), (2, 5, 10));
        assert_eq!((counts.points, counts.dropped_not_finite, counts.dropped_out_of_range), (200, 2, 4));
    }
}
