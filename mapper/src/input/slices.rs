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
use super::deal::{Dealer, Ground};
use super::order::{Slice, Tour};
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
    /// The order that their points were put into, where the cloud's was none.
    order: Option<SliceOrder>,
    /// How they were cut, until the lidar is known.
    cut: Option<Cut>,
}

/// An order of points that were in none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SliceOrder {
    /// That of their times, or of the beams in the turns that these tell.
    Time,
    /// Strips across the way.
    Strips,
}

/// How a cloud was cut.
#[derive(Debug)]
pub struct Cut {
    /// The frame of each slice, and `velodyne_from_map` there.
    pub places: Vec<(usize, Pose)>,
    /// The trajectory in time, where the cloud was cut by that: else slices are to be dealt.
    pub tour: Option<Tour>,
    /// As in the settings.
    pub config: InputConfig,
}

impl Slices {
    /// Of a cloud, in a folder of their own: none yet.
    ///
    /// # Errors
    /// Where no folder can be made.
    pub fn new(cloud: &Path, lidar: &LidarConfig) -> Result<Self> {
        let root = tempfile::tempdir().map_err(common::Error::io(std::env::temp_dir()))?;
        let folder = folder_in(&root, "cut")?;
        let (cloud, steps) = (cloud.to_path_buf(), Steps::of(lidar));
        Ok(Self { cloud, root, folder, full_scale: 1.0, steps, order: None, cut: None })
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

    /// Whether points are in strips across the way, as nothing tells who took them when.
    pub fn are_in_lines(&self) -> bool {
        self.order == Some(SliceOrder::Strips)
    }

    /// What people should know about the order of the points, if anything.
    pub fn order_note(&self) -> Option<&'static str> {
        self.order.map(|order| match order {
            SliceOrder::Time => "the points of the cloud are in no order of a lidar, and are put into that of their times",
            SliceOrder::Strips => {
                "the points of the cloud are in no order of a lidar, nor do times tell one: the road is looked at in strips \
                 across the way, which finds fewer lane lines"
            }
        })
    }

    /// Says how the cloud was cut: once the lidar is known the points of its slices are put into an
    /// order, and what was cut in space is dealt.
    pub fn put_cut(&mut self, cut: Cut) {
        self.cut = Some(cut);
    }

    /// Says what the lidar is like.
    ///
    /// # Errors
    /// Where slices that are to be put into an order or dealt cannot be read or written.
    pub fn put_lidar(&mut self, lidar: &LidarConfig) -> Result<()> {
        self.steps = Steps::of(lidar);
        let Some(Cut { places, tour, config }) = self.cut.take() else { return Ok(()) };
        let (frames, poses): (Vec<usize>, Vec<Pose>) = places.into_iter().unzip();
        if !self.are_as_taken(&frames)? {
            self.put_in_order(&frames, &poses, tour.as_ref(), &config)?;
        }
        if tour.is_none() {
            let dealer = Dealer::new(&poses, lidar, config.deal);
            self.renewed("dealt", &frames, &config, |slices, number, frame| {
                Ok(dealer.deal(number, &slices.slice(frame, ANY_RANGE_M)?.points))
            })?;
        }
        Ok(())
    }

    /// Whether most of the points are in an order in which a lidar may have taken them.
    fn are_as_taken(&self, frames: &[usize]) -> Result<bool> {
        let look = |frame: &usize| {
            let points = self.slice(*frame, ANY_RANGE_M)?.points;
            Ok((self.steps.are_as_taken(&points), points.len()))
        };
        let looks: Vec<(bool, usize)> = frames.par_iter().map(look).collect::<Result<_>>()?;
        Ok(are_most(&looks))
    }

    /// Puts the points of all slices into an order: that of their times, where most are then as a
    /// lidar may have taken them, else that of strips.
    fn put_in_order(
        &mut self,
        frames: &[usize],
        poses: &[Pose],
        tour: Option<&Tour>,
        config: &InputConfig,
    ) -> Result<()> {
        let (steps, tour) = (self.steps, tour.map(|tour| (tour, config.turn_s)));
        let by_time = |slices: &Self, number: usize, frame: usize| -> Result<(bool, Vec<ScanPoint>)> {
            let (points, times_s) = (slices.slice(frame, ANY_RANGE_M)?.points, slices.times_s(frame)?);
            let ordered = Slice::new(&points, &times_s, poses, number).by_time(steps, tour);
            Ok((ordered.is_some(), ordered.unwrap_or(points)))
        };
        let look = |(number, frame): (usize, &usize)| {
            let (is_ordered, points) = by_time(self, number, *frame)?;
            Ok((is_ordered, points.len()))
        };
        let looks: Vec<(bool, usize)> = frames.par_iter().enumerate().map(look).collect::<Result<_>>()?;
        let own = |number: usize, points: Vec<ScanPoint>| points.into_iter().map(|p| (number, p)).collect();
        if are_most(&looks) {
            self.order = Some(SliceOrder::Time);
            return self.renewed("by_time", frames, config, |slices, number, frame| {
                Ok(own(number, by_time(slices, number, frame)?.1))
            });
        }
        self.order = Some(SliceOrder::Strips);
        self.renewed("in_strips", frames, config, |slices, number, frame| {
            let points = slices.slice(frame, ANY_RANGE_M)?.points;
            let ground = Ground::under(&points, config.deal);
            Ok(own(number, Slice::new(&points, &[], poses, number).in_strips(steps, config.strip_m, &ground)))
        })
    }

    /// Writes all slices anew, into a folder of that name: `renew` gives the points that come of
    /// one (number, frame), each with the number of the slice that it is of.
    fn renewed(
        &mut self,
        name: &str,
        frames: &[usize],
        config: &InputConfig,
        renew: impl Fn(&Self, usize, usize) -> Result<Vec<(usize, ScanPoint)>> + Sync,
    ) -> Result<()> {
        let folder = folder_in(&self.root, name)?;
        let mut held = Held::new(&folder, frames, config.held_points);
        let slices: Vec<(usize, &usize)> = frames.iter().enumerate().collect();
        for batch in slices.chunks(rayon::current_num_threads().max(1)) {
            let renew = |(number, frame): &(usize, &usize)| renew(self, *number, **frame);
            for points in batch.par_iter().map(renew).collect::<Result<Vec<_>>>()? {
                points.into_iter().try_for_each(|(to, point)| held.add(to, point, None))?;
            }
        }
        held.put_away()?;
        let before = std::mem::replace(&mut self.folder, folder);
        Ok(std::fs::remove_dir_all(&before).map_err(common::Error::io(&before))?)
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
        if !self.are_in_lines() {
            self.steps.cut(&mut scan.points);
        }
        Ok(scan)
    }

    /// A slice as it lies on the disk.
    fn slice(&self, frame: usize, max_range_m: f32) -> Result<Scan> {
        let path = self.scan_path(frame);
        if path.exists() { Ok(read_scan(&path, max_range_m)?) } else { Ok(Scan::default()) }
    }

    /// Times of the points of a slice as it was cut, seconds; none where the cloud has none.
    fn times_s(&self, frame: usize) -> Result<Vec<f64>> {
        let path = times_of(&self.folder, frame);
        if !path.exists() {
            return Ok(Vec::new());
        }
        let bytes = std::fs::read(&path).map_err(common::Error::io(&path))?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }
}

/// Whether more than half of the points are where it holds; these are counted with it.
fn are_most(looks: &[(bool, usize)]) -> bool {
    let all: usize = looks.iter().map(|(_, points)| points).sum();
    let such: usize = looks.iter().filter(|(holds, _)| *holds).map(|(_, points)| points).sum();
    2 * such >= all
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

/// The file of the times of its points.
fn times_of(folder: &Path, frame: usize) -> PathBuf {
    folder.join(format!("{frame:06}.times"))
}

/// Slices on their way to the disk.
pub struct Held<'a> {
    folder: &'a Path,
    /// The frame of each.
    frames: &'a [usize],
    /// What is not on the disk yet.
    bytes: Vec<Vec<u8>>,
    /// The same of the times of their points.
    times: Vec<Vec<u8>>,
    points: usize,
    most_points: usize,
}

impl<'a> Held<'a> {
    /// Slices of these frames; no more than `most_points` are held in memory.
    pub fn new(folder: &'a Path, frames: &'a [usize], most_points: usize) -> Self {
        let none = || vec![Vec::new(); frames.len()];
        Self { folder, frames, bytes: none(), times: none(), points: 0, most_points }
    }

    /// Adds a point to a slice, by its number, with its time in seconds.
    ///
    /// # Errors
    /// As [`Self::put_away`].
    pub fn add(&mut self, slice: usize, point: ScanPoint, time_s: Option<f64>) -> Result<()> {
        self.bytes[slice].extend(point.to_le_bytes());
        self.times[slice].extend(time_s.into_iter().flat_map(f64::to_le_bytes));
        self.points += 1;
        if self.points >= self.most_points { self.put_away() } else { Ok(()) }
    }

    /// Appends what is held to the slices on the disk.
    ///
    /// # Errors
    /// Where one cannot be written.
    pub fn put_away(&mut self) -> Result<()> {
        let slices =
            self.frames.iter().zip(&mut self.bytes).map(|(frame, bytes)| (file_of(self.folder, *frame), bytes));
        let times =
            self.frames.iter().zip(&mut self.times).map(|(frame, bytes)| (times_of(self.folder, *frame), bytes));
        for (path, bytes) in slices.chain(times).filter(|(_, bytes)| !bytes.is_empty()) {
            let file = OpenOptions::new().create(true).append(true).open(&path);
            file.and_then(|mut file| file.write_all(bytes)).map_err(common::Error::io(&path))?;
            *bytes = Vec::new();
        }
        self.points = 0;
        Ok(())
    }
}
