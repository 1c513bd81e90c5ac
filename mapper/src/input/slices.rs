//! Slices of a stitched cloud, on the disk.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use common::geometry::Pose;
use common::kitti::{Scan, ScanPoint, read_scan};
use rayon::prelude::*;
use tempfile::TempDir;

use super::ANY_RANGE_M;
use super::beams::Steps;
use super::config::InputConfig;
use super::deal::Dealer;
use crate::error::Result;
use crate::lidar::LidarConfig;

/// A stitched cloud in slices.
#[derive(Debug)]
pub struct Slices {
    cloud: PathBuf,
    /// Holds the folder that they lie in.
    root: TempDir,
    folder: PathBuf,
    /// Intensity that counts as a reflectance of 1.
    full_scale: f32,
    /// How far apart the points of the lidar are.
    steps: Steps,
    /// Those that are to be dealt.
    undealt: Option<Undealt>,
}

/// Slices that are cut where they lie.
#[derive(Debug)]
struct Undealt {
    /// The frame of each, and `velodyne_from_map` there.
    places: Vec<(usize, Pose)>,
    config: InputConfig,
}

impl Slices {
    /// Of a cloud, in a folder of their own: none yet.
    ///
    /// # Errors
    /// Where no folder can be made.
    pub fn new(cloud: &Path, lidar: &LidarConfig) -> Result<Self> {
        let root = tempfile::tempdir().map_err(common::Error::io(std::env::temp_dir()))?;
        let folder = folder_in(&root, "cut")?;
        let cloud = cloud.to_path_buf();
        Ok(Self { cloud, root, folder, full_scale: 1.0, steps: Steps::of(lidar), undealt: None })
    }

    /// Its name, for people.
    pub fn name(&self) -> String {
        let name = self.cloud.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        format!("cloud {name}")
    }

    /// The stitched cloud.
    pub fn cloud(&self) -> &Path {
        &self.cloud
    }

    /// The folder of the slices.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Intensity that counts as a reflectance of 1.
    pub fn full_scale(&self) -> f32 {
        self.full_scale
    }

    /// Says which intensity counts as a reflectance of 1.
    pub fn put_full_scale(&mut self, full_scale: f32) {
        self.full_scale = full_scale;
    }

    /// Says that they are cut where they lie, and at which places (frame, and
    /// `velodyne_from_map`): once the lidar is known they are dealt.
    pub fn cut_in_space(&mut self, places: Vec<(usize, Pose)>, config: &InputConfig) {
        self.undealt = Some(Undealt { places, config: *config });
    }

    /// Says what the lidar is like.
    ///
    /// # Errors
    /// Where slices that are to be dealt cannot be read or written.
    pub fn put_lidar(&mut self, lidar: &LidarConfig) -> Result<()> {
        self.steps = Steps::of(lidar);
        let Some(Undealt { places, config }) = self.undealt.take() else { return Ok(()) };
        let (frames, poses): (Vec<usize>, Vec<Pose>) = places.into_iter().unzip();
        let dealer = Dealer::new(&poses, lidar, config.deal);
        let dealt = folder_in(&self.root, "dealt")?;
        let mut held = Held::new(&dealt, &frames, config.held_points);
        let slices: Vec<(usize, &usize)> = frames.iter().enumerate().collect();
        for batch in slices.chunks(rayon::current_num_threads().max(1)) {
            let deal =
                |(number, frame): &(usize, &usize)| Ok(dealer.deal(*number, &self.slice(**frame, ANY_RANGE_M)?.points));
            for points in batch.par_iter().map(deal).collect::<Result<Vec<_>>>()? {
                points.into_iter().try_for_each(|(to, point)| held.add(to, point))?;
            }
        }
        held.put_away()?;
        let cut = std::mem::replace(&mut self.folder, dealt);
        Ok(std::fs::remove_dir_all(&cut).map_err(common::Error::io(&cut))?)
    }

    /// The file of a slice.
    pub fn scan_path(&self, frame: usize) -> PathBuf {
        file_of(&self.folder, frame)
    }

    /// A slice as a scan, its reflectance from 0 to 1; one without a point is empty.
    ///
    /// # Errors
    /// As [`read_scan`].
    pub fn read(&self, frame: usize, max_range_m: f32) -> Result<Scan> {
        let mut scan = self.slice(frame, max_range_m)?;
        for p in &mut scan.points {
            p.reflectance /= self.full_scale;
        }
        self.steps.cut(&mut scan.points);
        Ok(scan)
    }

    /// A slice as it lies on the disk.
    fn slice(&self, frame: usize, max_range_m: f32) -> Result<Scan> {
        let path = self.scan_path(frame);
        if path.exists() { Ok(read_scan(&path, max_range_m)?) } else { Ok(Scan::default()) }
    }
}

/// Makes a folder in another.
fn folder_in(root: &TempDir, name: &str) -> Result<PathBuf> {
    let folder = root.path().join(name);
    std::fs::create_dir(&folder).map_err(common::Error::io(&folder))?;
    Ok(folder)
}

/// The file of a slice.
fn file_of(folder: &Path, frame: usize) -> PathBuf {
    folder.join(format!("{frame:06}.bin"))
}

/// Slices on their way to the disk.
pub struct Held<'a> {
    folder: &'a Path,
    /// The frame of each.
    frames: &'a [usize],
    /// What is not on the disk yet.
    bytes: Vec<Vec<u8>>,
    points: usize,
    most_points: usize,
}

impl<'a> Held<'a> {
    /// Slices of these frames; no more than `most_points` are held in memory.
    pub fn new(folder: &'a Path, frames: &'a [usize], most_points: usize) -> Self {
        Self { folder, frames, bytes: vec![Vec::new(); frames.len()], points: 0, most_points }
    }

    /// Adds a point to a slice, by its number.
    ///
    /// # Errors
    /// As [`Self::put_away`].
    pub fn add(&mut self, slice: usize, point: ScanPoint) -> Result<()> {
        self.bytes[slice].extend(point.to_le_bytes());
        self.points += 1;
        if self.points >= self.most_points { self.put_away() } else { Ok(()) }
    }

    /// Appends what is held to the slices on the disk.
    ///
    /// # Errors
    /// Where one cannot be written.
    pub fn put_away(&mut self) -> Result<()> {
        for (frame, bytes) in self.frames.iter().zip(&mut self.bytes).filter(|(_, bytes)| !bytes.is_empty()) {
            let path = file_of(self.folder, *frame);
            let file = OpenOptions::new().create(true).append(true).open(&path);
            file.and_then(|mut file| file.write_all(bytes)).map_err(common::Error::io(&path))?;
            *bytes = Vec::new();
        }
        self.points = 0;
        Ok(())
    }
}
