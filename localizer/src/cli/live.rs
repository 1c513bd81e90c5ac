//! `localizer live`: lines of the standard input, each image answered on the standard
//! output before the next line is read.

use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};

use clap::Args;
use common::earth::OnEarth;
use common::geometry::PinholeCamera;
use common::kitti::Calibration;
use common::{is_separator, words};

use super::ConfigArgs;
use super::earth::EarthArgs;
use super::input::SourceArgs;
use crate::camera::{ScaledCamera, Source};
use crate::config::Config;
use crate::drive::CAMERA;
use crate::gps::{GpsConfig, GpsFix};
use crate::live::{LiveLocalizer, Received};
use crate::local_map::LocalMap;
use crate::output::{estimates_header, estimates_row};
use crate::vision::image::{check_calibration, image_size};
use crate::vision::labels;
use crate::watch::Sensors;
use crate::{Error, Result};

const IMAGE: &str = "image";
const GPS: &str = "gps";
const ODOMETRY: &str = "odometry";
/// Longest line, bytes: a path has 4,096 at most.
const LONGEST_LINE: u64 = 16_384;
/// What of a line that says nothing is shown, characters.
const SHOWN: usize = 60;

/// What is written and read, for `--help`.
const PROTOCOL: &str = "\
Lines of the standard input, words separated by blanks, commas or tabs:
  image T FRAME [PATH]                  an image that was taken at T, seconds. FRAME is a
                                        number that comes back, and ascends; with --labels it
                                        names the label images, and PATH may be left out
  gps T X Y Z [QX QY QZ QW]             a rough position of the camera, map frame, metres;
  gps T LAT LON ALT [COURSE]            with --origin: degrees north and east, metres,
                                        degrees clockwise from north
  odometry T SPEED_M_S YAW_RATE_RAD_S   with --wheels: the mean since the line before
  # anything                            is passed over

The standard output begins with the header of `estimates.csv` of `localizer run`, once maps
and networks are loaded. Each image is answered with one line, before the next is read: that
of `estimates.csv`, or one that begins with `#` and says why there is no pose. A line that
says nothing, or an image that cannot be read, is told of on the error stream and passed
over; the exit code is 2 then.";

/// Arguments of `localizer live`.
#[derive(Debug, Args)]
#[command(after_help = PROTOCOL)]
pub struct LiveArgs {
    /// Map file (.csm), or atlas of many (.csa).
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Calibration of the camera: a file with its line `P2:` as in KITTI's `calib.txt`.
    #[arg(long, value_name = "FILE")]
    calib: Option<PathBuf>,
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    earth: EarthArgs,
    /// Lines of `odometry` will come.
    #[arg(long)]
    wheels: bool,
    /// Let the fixes bound the pose all along, not only start it.
    #[arg(long)]
    fuse_gps: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

pub fn execute(args: &LiveArgs) -> Result<bool> {
    let Some(mut config) = args.config.load()? else { return Ok(true) };
    config.gps.fuse |= args.fuse_gps;
    let on_earth = args.earth.on_earth()?;
    let mut map = LocalMap::open(&super::required(args.map.as_ref(), "--map")?, &config.local_map)?;
    let camera = Calibration::read_camera(super::required(args.calib.as_ref(), "--calib")?, CAMERA)?;
    let source = args.source.open()?;
    let mut is_heard = common::output::print_to_reader(&estimates_header(on_earth.as_ref()));
    let mut vehicle = Vehicle::new(&mut map, camera, source, args.wheels, config, on_earth);
    let mut input = std::io::stdin().lock();
    let mut passed_over = 0;
    for line in 1.. {
        let Some(text) = next_line(&mut input, line)?.filter(|_| is_heard) else { break };
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        match vehicle.take(line, text) {
            Ok(None) => {}
            Ok(Some(answer)) => is_heard = common::output::print_to_reader(&answer),
            Err(error) => {
                passed_over += 1;
                common::output::print_error(&error);
                if text.starts_with(IMAGE) {
                    is_heard = common::output::print_to_reader(&format!("# {error}\n"));
                }
            }
        }
    }
    if passed_over > 0 { Err(Error::LivePassedOver { lines: passed_over }) } else { Ok(true) }
}

/// The next line of the input; none after the last.
fn next_line(input: &mut impl BufRead, line: usize) -> Result<Option<String>> {
    let failed = |problem: String| Error::LiveInput { line, problem };
    let mut bytes = Vec::new();
    input.take(LONGEST_LINE).read_until(b'\n', &mut bytes).map_err(|error| failed(error.to_string()))?;
    if bytes.len() as u64 == LONGEST_LINE {
        return Err(failed(format!("it is longer than {LONGEST_LINE} bytes")));
    }
    Ok((!bytes.is_empty()).then(|| String::from_utf8_lossy(&bytes).into_owned()))
}

/// What a line says.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Said<'t> {
    Image { time_s: f64, frame: usize, path: Option<&'t Path> },
    Gps { time_s: f64, fix: GpsFix },
    Odometry { time_s: f64, speed_m_s: f64, yaw_rate_rad_s: f64 },
}

/// What a line says; none where that is nothing known.
fn said<'t>(text: &'t str, config: &GpsConfig, on_earth: Option<&OnEarth>) -> Option<Said<'t>> {
    let mut rest = text;
    match next_word(&mut rest)? {
        IMAGE => {
            let time_s = next_word(&mut rest)?.parse().ok().filter(|time_s: &f64| time_s.is_finite())?;
            let frame = next_word(&mut rest)?.parse().ok()?;
            // What is left is the path, with all blanks in it.
            Some(Said::Image { time_s, frame, path: Some(rest).filter(|rest| !rest.is_empty()).map(Path::new) })
        }
        GPS => {
            let row = numbers(rest)?;
            let (time_s, fix) = match on_earth {
                Some(on_earth) => GpsFix::of_place(&row, config, on_earth)?,
                None => GpsFix::of_row(&row, config)?,
            };
            Some(Said::Gps { time_s, fix })
        }
        ODOMETRY => {
            let [time_s, speed_m_s, yaw_rate_rad_s] = numbers(rest)?[..].try_into().ok()?;
            Some(Said::Odometry { time_s, speed_m_s, yaw_rate_rad_s })
        }
        _ => None,
    }
}

/// Takes the first word of a line away, and what separates it from the next.
fn next_word<'t>(rest: &mut &'t str) -> Option<&'t str> {
    let end = rest.find(is_separator).unwrap_or(rest.len());
    let (word, others) = rest.split_at_checked(end)?;
    *rest = others.trim_start_matches(is_separator);
    Some(word).filter(|word| !word.is_empty())
}

/// The words of a line as numbers; none where one is no finite number.
fn numbers(rest: &str) -> Option<Vec<f64>> {
    words(rest).map(|word| word.parse().ok().filter(|value: &f64| value.is_finite())).collect()
}

/// A vehicle with one camera, and its localizer once an image has shown how large
/// images are.
struct Vehicle<'m> {
    camera: PinholeCamera,
    source: Source,
    has_wheels: bool,
    config: Config,
    /// Where the map is on the Earth, if that is known.
    on_earth: Option<OnEarth>,
    last_frame: Option<usize>,
    /// Taken by the localizer.
    map: Option<&'m mut LocalMap>,
    /// What came before that.
    received: Received,
    running: Option<(ScaledCamera, LiveLocalizer<'m>)>,
}

impl<'m> Vehicle<'m> {
    fn new(
        map: &'m mut LocalMap,
        camera: PinholeCamera,
        source: Source,
        has_wheels: bool,
        config: Config,
        on_earth: Option<OnEarth>,
    ) -> Self {
        let (map, received) = (Some(map), Received::default());
        Self { camera, source, has_wheels, config, on_earth, last_frame: None, map, received, running: None }
    }

    /// Takes a line in; the answer to an image.
    ///
    /// # Errors
    /// Where it says nothing, what it says is refused, or an image cannot be read.
    fn take(&mut self, line: usize, text: &str) -> Result<Option<String>> {
        let unknown = || Error::LiveLine { line, text: text.chars().take(SHOWN).collect() };
        match said(text, &self.config.gps, self.on_earth.as_ref()).ok_or_else(unknown)? {
            Said::Image { time_s, frame, path } => {
                if self.last_frame.is_some_and(|last| last >= frame) {
                    return Err(Error::LiveFrame { line, frame });
                }
                self.last_frame = Some(frame);
                return self.image(time_s, frame, path);
            }
            Said::Gps { time_s, fix } => self.received().gps(time_s, fix),
            Said::Odometry { .. } if !self.has_wheels => return Err(Error::LiveWheels { line }),
            Said::Odometry { time_s, speed_m_s, yaw_rate_rad_s } => {
                if !self.received().odometry(time_s, speed_m_s, yaw_rate_rad_s) {
                    return Err(Error::LiveOdometry { line, time_s });
                }
            }
        }
        Ok(None)
    }

    fn received(&mut self) -> &mut Received {
        match &mut self.running {
            Some((_, localizer)) => &mut localizer.received,
            None => &mut self.received,
        }
    }

    /// The answer to an image.
    fn image(&mut self, time_s: f64, frame: usize, path: Option<&Path>) -> Result<Option<String>> {
        if self.running.is_none() {
            let camera = self.scaled(frame, path)?;
            let sensors = Sensors { images: path.is_some(), wheels: self.has_wheels };
            self.running = self.map.take().map(|map| {
                let mut localizer = LiveLocalizer::new(map, &camera, sensors, &self.config);
                localizer.received = std::mem::take(&mut self.received);
                (camera, localizer)
            });
        }
        let Some((camera, localizer)) = &mut self.running else { return Ok(None) };
        let seen = camera.look(&self.source, frame, path, &self.config.vision)?;
        let result = localizer.image(frame, time_s, seen)?;
        let unknown = || format!("# frame {frame}, {time_s:.6} s: no position came yet\n");
        let row = |result| estimates_row(result, self.on_earth.as_ref());
        Ok(Some(result.as_ref().map_or_else(unknown, row)))
    }

    /// The camera as images of the size of this one are looked at.
    fn scaled(&self, frame: usize, path: Option<&Path>) -> Result<ScaledCamera> {
        let (shown, taken_px) = match (&self.source, path) {
            (Source::Labels(folder), _) => (folder.as_path(), labels::size(folder, frame)?),
            (Source::Networks(_), Some(path)) => (path, image_size(path)?),
            (Source::Networks(_), None) => return Err(Error::NoImage { frame }),
        };
        check_calibration(shown, taken_px, &self.camera)?;
        Ok(ScaledCamera::new(&self.camera, taken_px, self.config.vision.widest_px))
    }
}

#[cfg(test)]
mod tests;
