//! Drives of many worlds, one after the other: each is generated, mapped, localized and
//! forgotten.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use common::geometry::Pose;
use common::kitti::{read_poses, write_poses};
use common::map::EncodeOptions;
use fixtures::Options;
use localizer::config::Config as LocalizerConfig;
use mapper::drive::{Drive, MAX_RANGE_M};
use mapper::lidar::measured;
use mapper::{Config, PoseSource};

use crate::map_score::{Found, MapScore, WITHIN_M, aligned, score};
use crate::trial::{Figures, LookArgs};

/// Built poses and exact ones that are farther apart than this lie in maps of their own,
/// metres: a survey with such a drift says where nothing of the world is.
const ELSEWHERE_M: f64 = 0.3;

/// Seeds of a world: `city:11-14,31`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Seeds {
    /// Name of the world.
    pub world: String,
    /// Its seeds.
    pub seeds: Vec<u64>,
}

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let hint = || format!("`{text}` is no world with seeds; write WORLD:SEEDS, as city:11-14,31");
        let (world, seeds) = text.split_once(':').ok_or_else(hint)?;
        let mut all = Vec::new();
        for part in seeds.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let number = |text: &str| text.parse::<u64>().map_err(|_| hint());
            let (first, last) = (number(first)?, number(last)?);
            if first > last || last - first >= MOST_SEEDS {
                return Err(hint());
            }
            all.extend(first..=last);
        }
        if world.is_empty() { Err(hint()) } else { Ok(Self { world: world.to_owned(), seeds: all }) }
    }
}

/// More drives than anybody waits for: who asks for them made a slip.
const MOST_SEEDS: u64 = 10_000;

/// What came of a drive.
#[derive(Debug, Clone)]
pub struct Row {
    /// Name of the world.
    pub world: String,
    /// Its seed.
    pub seed: u64,
    /// Size of its map.
    pub map_bytes: usize,
    /// The map against the truth.
    pub map: MapScore,
    /// The drive localized from label images alone; none where nothing was.
    pub from_labels: Option<Figures>,
    /// The same with wheels and gyroscope.
    pub with_odometry: Option<Figures>,
}

/// Generates a drive in a folder, maps it from every fifth scan, and localizes it in its map
/// from a simulated GPS start, all with the default settings.
///
/// Positions are scored against the exact poses, or, where the survey drifts so much that the
/// map lies elsewhere, against those that the map was built with.
///
/// # Errors
/// What the three programs say.
pub fn measure(options: &Options, folder: &Path) -> Result<Row, Box<dyn std::error::Error>> {
    let drive = folder.join("drive");
    fixtures::generate(options, &drive, &|_| ())?;
    let (map_bytes, map, truth) = mapped(&drive, folder)?;
    let wheels = drive.join("sequences/00/odometry.csv");
    let localized = |odometry: Option<PathBuf>| -> localizer::Result<Option<Figures>> {
        let look = LookArgs::of_labels(&drive, &folder.join(MAP), &truth, odometry);
        let trial = look.read_by(LocalizerConfig::default())?;
        Ok(trial.outcome(&trial.run()?).figures)
    };
    Ok(Row {
        world: options.world.name.clone(),
        seed: options.world.seed,
        map_bytes,
        map,
        from_labels: localized(None)?,
        with_odometry: localized(Some(wheels))?,
    })
}

/// The map of a drive in its folder.
const MAP: &str = "map.csm";

/// Maps a drive; also says which poses its positions are to be scored against.
fn mapped(drive: &Path, folder: &Path) -> Result<(usize, MapScore, PathBuf), Box<dyn std::error::Error>> {
    let mut config = Config::default();
    let mut scans = Drive::open(drive, "00", 5, (0, usize::MAX), None, MAX_RANGE_M)?;
    config.lidar = measured(&mut scans, &config.lidar)?;
    let built = mapper::build(&scans, PoseSource::Refine, &config, |_| Ok(()))?;
    let bytes = built.map.encode(&EncodeOptions { quantum_m: config.quantum_m })?;
    common::atomic_file::write(folder.join(MAP), &bytes)?;
    let stored = common::map::read(folder.join(MAP))?;

    let truth = drive.join("truth/poses.txt");
    let (exact, poses) = (read_poses(&truth)?, &built.registration.map_from_camera);
    let score = score(&aligned(&stored, poses, &exact), &crate::truth::read(drive)?, &exact, WITHIN_M);
    if !lies_elsewhere(poses, &exact) {
        return Ok((bytes.len(), score, truth));
    }
    let own = folder.join("poses.txt");
    write_poses(&own, poses)?;
    Ok((bytes.len(), score, own))
}

fn lies_elsewhere(built: &[Pose], exact: &[Pose]) -> bool {
    let apart_m = |(a, b): (&Pose, &Pose)| (a.translation.vector - b.translation.vector).norm();
    built.iter().zip(exact).map(apart_m).any(|apart_m| apart_m > ELSEWHERE_M)
}

/// What came of many drives.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Totals {
    /// Drives.
    pub drives: usize,
    /// Poles of all.
    pub poles: Found,
    /// Signs of all.
    pub signs: Found,
    /// Lane lines of all, metres.
    pub lanes: Found,
    /// From label images alone.
    pub from_labels: Localized,
    /// With wheels and gyroscope.
    pub with_odometry: Localized,
}

/// How well all drives were localized.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Localized {
    /// Drives in which anything was.
    pub drives: usize,
    /// Sum of the RMS of the positions of these, metres.
    pub sum_rms_m: f64,
    /// The largest RMS, metres.
    pub worst_rms_m: f64,
    /// Frames that were scored.
    pub frames: usize,
    /// Of these under half a metre off.
    pub under_half_metre: f64,
    /// Called ok.
    pub ok: f64,
    /// Called ok, and off by half a metre or more.
    pub hazardous: usize,
}

impl Localized {
    fn add(&mut self, of: &Figures) {
        let frames = of.frames as f64;
        self.drives += 1;
        self.sum_rms_m += of.rms_m;
        self.worst_rms_m = self.worst_rms_m.max(of.rms_m);
        self.frames += of.frames;
        self.under_half_metre += of.under_half_metre * frames;
        self.ok += (1.0 - of.flagged) * frames;
        self.hazardous += of.hazards.len();
    }

    /// Mean of the drives' RMS, metres.
    pub fn mean_rms_m(&self) -> f64 {
        self.sum_rms_m / self.drives.max(1) as f64
    }

    /// A number of frames as a share of all.
    pub fn share(&self, frames: f64) -> f64 {
        frames / self.frames.max(1) as f64
    }
}

impl Totals {
    /// Adds a drive.
    pub fn add(&mut self, row: &Row) {
        self.drives += 1;
        for (all, one) in
            [(&mut self.poles, &row.map.poles), (&mut self.signs, &row.map.signs), (&mut self.lanes, &row.map.lanes)]
        {
            all.add(one);
        }
        for (all, one) in [(&mut self.from_labels, &row.from_labels), (&mut self.with_odometry, &row.with_odometry)] {
            if let Some(figures) = one {
                all.add(figures);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_ranges_and_single_ones() {
        let seeds: Seeds = "city:11-13,31".parse().unwrap();
        assert_eq!(seeds, Seeds { world: "city".into(), seeds: vec![11, 12, 13, 31] });
        for wrong in ["city", "city:", ":1", "city:a", "city:3-1", "city:1-", "city:0-18446744073709551615"] {
            assert!(wrong.parse::<Seeds>().unwrap_err().contains("WORLD:SEEDS"), "{wrong}");
        }
    }

    #[test]
    fn a_short_drive_gives_a_row_and_its_totals() {
        let folder = tempfile::tempdir().unwrap();
        let mut options = Options::default();
        options.world.frames = Some(40);
        let row = measure(&options, folder.path()).unwrap();
        assert!(row.map.poles.wanted > 0.0 && row.map.poles.recall() > 0.8, "{:?}", row.map.poles);
        let [labels, wheels] = [&row.from_labels, &row.with_odometry].map(|figures| figures.as_ref().unwrap());
        assert_eq!((labels.frames, wheels.frames), (38, 38));
        assert!(labels.rms_m < 0.3 && wheels.rms_m < 0.3);

        let mut totals = Totals::default();
        totals.add(&row);
        totals.add(&row);
        assert_eq!((totals.drives, totals.from_labels.frames), (2, 76));
        assert_eq!(totals.poles.recall().to_bits(), row.map.poles.recall().to_bits());
        assert!((totals.from_labels.mean_rms_m() - labels.rms_m).abs() < 1e-12);
    }
}
