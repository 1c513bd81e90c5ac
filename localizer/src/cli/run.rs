//! `localizer run`.

use std::path::{Path, PathBuf};

use clap::Args;
use nalgebra::Point2;

use super::ConfigArgs;
use super::earth::EarthArgs;
use super::input::{Input, InputArgs, all_but, read_fixes, simulated};
use crate::drive::{CAMERA, Drive};
use crate::estimate::Status;
use crate::overlay::{self, ProjectedShape};
use crate::preselect::{Candidates, Lookup, Reach};
use crate::projection::View;
use crate::run::{FrameResult, Localizer, Method, localize};
use crate::watch::odometry;
use crate::{Error, Result, config::Config, output};

/// Steps at both ends of a drive in which a log of wheels begins and ends.
const ENDS: usize = 2;

/// Arguments of `localizer run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    input: InputArgs,
    /// Rough positions of given frames, one per row: `t x y z`, or TUM lines, or
    /// `frame` and a 3x4 pose, or a 3x4 pose for each frame (`nan` for none); with
    /// `--origin` rows `t latitude longitude altitude`, or with a course behind,
    /// degrees clockwise from north.
    #[arg(long, value_name = "FILE", conflicts_with = "gps_seed")]
    gps: Option<PathBuf>,
    /// Without `--gps`: seed of the noise on the true pose of the first two
    /// frames.
    #[arg(long, value_name = "N", default_value_t = 0)]
    gps_seed: u64,
    #[command(flatten)]
    earth: EarthArgs,
    /// Wheels and gyroscope: lines `t_s,speed_m_s,yaw_rate_rad_s`, each the mean
    /// since the line before.
    #[arg(long, value_name = "FILE")]
    odometry: Option<PathBuf>,
    /// Let the fixes bound the pose all along, not only start it.
    #[arg(long, requires = "gps")]
    fuse_gps: bool,
    /// How frames are localized.
    #[arg(long, value_enum, default_value = "robust")]
    method: Method,
    /// Save the networks' probabilities as images.
    #[arg(long, value_name = "DIR")]
    save_labels: Option<PathBuf>,
    /// Save images with features and projected landmarks.
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    /// Output folder; is created.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
}

impl RunArgs {
    /// That no image is written over one that is read.
    ///
    /// # Errors
    /// [`Error::WritesOverImages`] where one would be.
    fn check_apart(&self, drive: &Drive) -> Result<()> {
        let images = drive.sequence.image_path(CAMERA, 0).parent().map(Path::to_path_buf);
        let same = |written: &Path, read: &Path| {
            let place = std::fs::canonicalize(written);
            place.is_ok_and(|place| std::fs::canonicalize(read).is_ok_and(|read| read == place))
        };
        for (option, written) in [("--overlay", &self.overlay), ("--save-labels", &self.save_labels)] {
            let Some(written) = written else { continue };
            let mut read = [&images, &self.input.source.labels].into_iter().flatten();
            if read.any(|read| same(written, read)) {
                return Err(Error::WritesOverImages { option, folder: written.clone() });
            }
        }
        Ok(())
    }
}

pub fn execute(args: &RunArgs) -> Result<bool> {
    let Some(mut config) = args.config.load()? else { return Ok(true) };
    let wheels = (args.odometry.is_some(), "--odometry");
    args.method.check(&[wheels, (args.fuse_gps, "--fuse-gps"), (config.gps.fuse, "gps.fuse")])?;
    config.gps.fuse |= args.fuse_gps;
    let on_earth = args.earth.on_earth()?;
    let wheels = args.input.read_odometry(args.odometry.as_deref(), &config)?;
    let out = super::required(args.out.as_ref(), "--out")?;
    for folder in [Some(&out), args.save_labels.as_ref(), args.overlay.as_ref()].into_iter().flatten() {
        common::atomic_file::check_folder(folder)?;
    }
    // Whatever can be wrong is found before all images are looked at, which takes long.
    let opened = args.input.open(&config)?;
    let drive = &opened.drive;
    args.check_apart(drive)?;
    let fixes = match &args.gps {
        Some(path) => read_fixes(drive, path, &config, on_earth.as_ref())?,
        None => simulated(&drive.frames.iter().copied(), &args.input.true_poses(drive)?, &config, args.gps_seed)?,
    };
    let mut input = opened.watch(wheels.is_some(), &config, |drive, frame, seen| {
        args.save_labels.as_ref().map_or(Ok(()), |folder| drive.camera.write_labels(folder, frame, seen))
    })?;
    if let Some((wheels, path)) = wheels.as_ref().zip(args.odometry.as_ref()) {
        let times_s = input.drive.frame_times_s();
        let (told, steps) = (wheels.told(&times_s), times_s.len() - 1);
        if told + ENDS < steps {
            common::say!("{}: {} of {steps} steps between frames are not told", path.display(), steps - told);
        }
    }
    let odometry = odometry(wheels, &input.motion, &mut config);
    let localizer =
        Localizer::new(args.method, &mut input.map, &input.drive.camera.pinhole, input.drive.camera.seen_px(), &config);
    let results = localize(&input.frames, &fixes, &odometry, localizer)?;
    if results.is_empty() {
        // What was there stays.
        return Err(Error::NothingLocalized);
    }
    let read_of_atlas = input.map.usage();
    create(&out)?;
    output::write(&out, &results, input.map.numbering(), on_earth.as_ref())?;
    if let Some(folder) = &args.overlay {
        create(folder)?;
        let (with, without): (Vec<_>, Vec<_>) = results.iter().partition(|result| input.drive.has_image(result.frame));
        if !without.is_empty() {
            common::say!("{} frames have no image to draw on", without.len());
        }
        for result in with {
            let image = input.drive.image(result.frame)?;
            let shapes = shapes(&mut input, &config, result)?;
            let features = input.frames.iter().find(|seen| seen.frame == result.frame);
            let Some(seen) = features else { continue };
            let drawn = overlay::draw(&image, &seen.features, &shapes);
            crate::vision::write_png(folder.join(format!("{:06}.png", result.frame)), &drawn)?;
        }
    }
    let count = |status| results.iter().filter(|r| r.estimate.status == status).count();
    common::say!(
        "{} frames localized: {} ok, {} degraded, {} lost; written to {}",
        results.len(),
        count(Status::Ok),
        count(Status::Degraded),
        count(Status::Lost),
        out.display()
    );
    let off_s = typical_time_sigma_s(&results);
    if off_s >= config.clock.told_sigma_s {
        common::say!(
            "the times between images are off by {:.0} ms, as the images tell: give the times of their exposure",
            1e3 * off_s
        );
    }
    if let Some(usage) = read_of_atlas {
        common::say!(
            "{} tiles of the atlas read ({} bytes with the index), at most {} held",
            usage.tiles_read,
            usage.bytes_read,
            usage.most_held
        );
    }
    all_but(input.unread)
}

/// The median of how far off the times of the images were, seconds.
fn typical_time_sigma_s(results: &[FrameResult]) -> f64 {
    let mut sigmas: Vec<f64> = results.iter().map(|result| result.estimate.time_sigma_s).collect();
    sigmas.sort_by(f64::total_cmp);
    sigmas.get(sigmas.len() / 2).copied().unwrap_or(0.0)
}

fn create(folder: &PathBuf) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|source| common::Error::Io { path: folder.clone(), source })?;
    Ok(())
}

/// The landmarks that may be seen from an estimate, in its image.
fn shapes(input: &mut Input, config: &Config, result: &FrameResult) -> Result<Vec<ProjectedShape>> {
    let camera = &input.drive.camera.pinhole;
    let pose = &result.estimate.map_from_camera;
    let view = View::new(camera, pose);
    input.map.next_frame()?;
    let lookup = Lookup { map: &mut input.map, camera, image: input.drive.camera.seen_px(), config: &config.preselect };
    let mut candidates = Candidates::default();
    lookup.select(pose, &Reach { position_m: 0.0, angle_rad: 0.0 }, &mut candidates)?;
    let mut shapes = Vec::new();
    for pole in &candidates.poles {
        if let Some(image) = crate::measurement::PoleImage::new(&view, pole) {
            shapes.push(ProjectedShape::Pole { upper_px: image.top_px, lower_px: image.foot_px });
        }
    }
    for sign in &candidates.signs {
        if let Some((centre_px, depth_m)) = view.project(&sign.centroid_map) {
            let radius_px = 0.5 * sign.size_m * camera.fx_px / depth_m;
            shapes.push(ProjectedShape::Sign { centre_px, radius_px });
        }
    }
    for lane in &candidates.lanes {
        let points = candidates.lane_points_map.get(lane.start..lane.end).unwrap_or(&[]);
        let points_px: Vec<Point2<f64>> =
            points.iter().filter_map(|p| view.project(p)).map(|(pixel, _)| pixel).collect();
        shapes.push(ProjectedShape::Lane { points_px });
    }
    Ok(shapes)
}
