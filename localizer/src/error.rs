//! What can go wrong in the localizer. Each message is one sentence: the file,
//! the place in it, what to do.

use std::path::PathBuf;

/// Result of everything here that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// Errors of the localizer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Files, settings, maps.
    #[error(transparent)]
    Common(#[from] common::Error),
    /// Images, probability maps, networks.
    #[error(transparent)]
    Vision(#[from] crate::vision::Error),
    /// Neither networks nor labels were given.
    #[error("nothing says where the features come from; give `--pole-net` and `--lane-net`, or `--labels`")]
    NoFeatureSource,
    /// An option is missing that the command needs.
    #[error("`{option}` is missing; give it, or see `--help`")]
    MissingOption {
        /// The option.
        option: &'static str,
    },
    /// A TUM file without the times of the frames.
    #[error("{}: its lines have times, and nothing says of which frames; give the sequence's times.txt as `--times`", path.display())]
    TimesNeeded {
        /// The file.
        path: PathBuf,
    },
    /// Something that the paper's method cannot take in.
    #[error(
        "`--method paper` starts by GPS and then asks images alone, so `{option}` would change nothing; leave it out, or take `--method robust`"
    )]
    NotOfPaper {
        /// The option, or the setting.
        option: &'static str,
    },
    /// No true poses to simulate GPS from.
    #[error("{} is missing, and without `--gps` positions are simulated from true poses; give `--gps`, or with `--truth` poses", path.display())]
    NoTruth {
        /// Where they would be.
        path: PathBuf,
    },
    /// Images that would be written where they are read.
    #[error("`{option}` would write over the images of {}, which are read; give another folder", folder.display())]
    WritesOverImages {
        /// The option.
        option: &'static str,
        /// The folder.
        folder: PathBuf,
    },
    /// Label images that hold hardly anything.
    #[error(
        "no pixel of the label images in {} is over {largest} of 255; write 255 for what is certain (masks of 0 and 1 times 255)",
        folder.display()
    )]
    FaintLabels {
        /// The folder.
        folder: PathBuf,
        /// The largest value of all.
        largest: u8,
    },
    /// A frame without an image, which networks need.
    #[error("frame {frame} has no image, and networks need one; give it, or label images with `--labels`")]
    NoImage {
        /// The frame.
        frame: usize,
    },
    /// A range of frames that ends before it begins.
    #[error("no frame is from {first} on and up to {last}: `--first` is after `--last`; exchange them")]
    FirstAfterLast {
        /// First frame that was asked for.
        first: usize,
        /// Last frame that was asked for.
        last: usize,
    },
    /// No frame of the range has an image or labels.
    #[error("frames {first} to {last} of {} hold none to localize in; it has frames {have_first} to {have_last}", folder.display())]
    NoFrames {
        /// Where they should be.
        folder: PathBuf,
        /// First frame that was asked for.
        first: usize,
        /// Last frame that was asked for.
        last: usize,
        /// First frame that is there.
        have_first: usize,
        /// Last frame that is there.
        have_last: usize,
    },
    /// A folder without any frame.
    #[error(
        "{} holds no images 000000.png and so on; give a KITTI sequence with `image_2`, or with `--labels` a folder with `pole/000000.png` and the like",
        folder.display()
    )]
    EmptyFolder {
        /// The folder.
        folder: PathBuf,
    },
    /// The localizer cannot start.
    #[error(
        "no GPS fix lies on the frames {first} to {last}; give one for the first frame with `--gps`, or true poses to simulate it"
    )]
    NoStart {
        /// First frame of the run.
        first: usize,
        /// Last frame of the run.
        last: usize,
    },
    /// A row of a GPS file of unknown form.
    #[error(
        "{} line {line} has {found} columns; give `t x y z` or `t x y z qx qy qz qw` (TUM), \
         `frame` and a 3x4 pose (13 columns), or a 3x4 pose per frame (12 columns)",
        path.display()
    )]
    GpsRow {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Its columns.
        found: usize,
    },
    /// A row of a GPS file that is no place on the Earth, of a map that is on it.
    #[error(
        "{} line {line} is no place within 2,000 km of where `--origin`, or `--crs` and `--reduced`, have the map; give \
         `t latitude longitude altitude`, degrees north and east, and metres, with or without a course in degrees \
         clockwise from north",
        path.display()
    )]
    GpsPlace {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// A row of a GPS file that begins with no frame.
    #[error("{} line {line} is of frame {found}, which is none; give whole numbers from 0 on, and a 3x4 pose", path.display())]
    GpsFrame {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What stands there.
        found: f64,
    },
    /// A GPS file without a fix for any frame that is localized.
    #[error("{} has no fix of the frames {first} to {last}; give one for the first frame", path.display())]
    NoFix {
        /// The file.
        path: PathBuf,
        /// First frame of the run.
        first: usize,
        /// Last frame of the run.
        last: usize,
    },
    /// Fixes whose times are no frame's: here is the first.
    #[error("{} line {line} is at {time_s} s, but the nearest frame is {off_s:.3} s away; give times as in times.txt", path.display())]
    GpsTime {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Time of the fix, seconds.
        time_s: f64,
        /// Distance to the nearest frame, seconds.
        off_s: f64,
    },
    /// A row of an odometry file of unknown form.
    #[error("{} line {line} has {found} columns; give `t_s,speed_m_s,yaw_rate_rad_s`", path.display())]
    OdometryRow {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Its columns.
        found: usize,
    },
    /// Odometry that goes back in time.
    #[error("{} line {line} is at {time_s} s, no later than the line before; sort the lines by time", path.display())]
    OdometryTime {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Its time, seconds.
        time_s: f64,
    },
    /// Columns of odometry that are others than they are taken for.
    #[error("{} line {line} names the columns `{found}`; give `t_s,speed_m_s,yaw_rate_rad_s`, in this order and these units", path.display())]
    OdometryColumns {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// Odometry of which no motion can be told.
    #[error("{} has fewer than two lines of `t_s,speed_m_s,yaw_rate_rad_s`, which tell no motion; give those of the drive, or leave `--odometry` out", path.display())]
    NoOdometry {
        /// The file.
        path: PathBuf,
    },
    /// Odometry of another time than the drive's.
    #[error(
        "{} tells of no step between frames: its lines are from {:.3} to {:.3} s, and the frames from {:.3} to {:.3} s; \
         give times as in times.txt, or leave `--odometry` out",
        path.display(), told_s[0], told_s[1], frames_s[0], frames_s[1]
    )]
    OdometryElsewhere {
        /// The file.
        path: PathBuf,
        /// When it begins and ends, seconds.
        told_s: [f64; 2],
        /// When the first and the last frame were taken, seconds.
        frames_s: [f64; 2],
    },
    /// A line of `localizer live` that says nothing it knows.
    #[error(
        "line {line} of the standard input is `{text}`; give `image T FRAME [PATH]`, `odometry T SPEED_M_S YAW_RATE_RAD_S`, \
         or `gps T X Y Z [QX QY QZ QW]`, with finite numbers and whole frames"
    )]
    LiveLine {
        /// The line, from 1.
        line: usize,
        /// How it begins.
        text: String,
    },
    /// An image that is not later than the one before, by its number.
    #[error(
        "line {line} of the standard input is of frame {frame}, no later than the one before; number images as they come"
    )]
    LiveFrame {
        /// The line, from 1.
        line: usize,
        /// The frame.
        frame: usize,
    },
    /// Odometry that goes back in time.
    #[error(
        "line {line} of the standard input is of {time_s} s, no later than the `odometry` before; give it as it comes"
    )]
    LiveOdometry {
        /// The line, from 1.
        line: usize,
        /// Its time, seconds.
        time_s: f64,
    },
    /// Odometry of who said that there would be none.
    #[error("line {line} of the standard input is of wheels, which were not announced; begin again with `--wheels`")]
    LiveWheels {
        /// The line, from 1.
        line: usize,
    },
    /// The standard input cannot be read on.
    #[error("line {line} of the standard input cannot be read ({problem}); begin again")]
    LiveInput {
        /// The line, from 1.
        line: usize,
        /// Why.
        problem: String,
    },
    /// Lines that were told of as they came.
    #[error("{lines} lines of the standard input were passed over, each told of above; see `localizer live --help`")]
    LivePassedOver {
        /// How many.
        lines: usize,
    },
    /// A result file without the columns of one.
    #[error("{} is no result of `localizer run`: line {line} {problem}; give its output folder or its estimates.csv", path.display())]
    BadResult {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// Images of which no two can be compared.
    #[error("the frames show no motion, for no two of them differ; give more of the drive (`--first`, `--last`)")]
    NoMotion,
    /// Images that could not be read, each told of.
    #[error(
        "the images of {frames} frames could not be read, each told of above, and all others were taken in; give intact ones"
    )]
    FramesPassedOver {
        /// How many.
        frames: usize,
    },
    /// A run that came to no pose.
    #[error(
        "no frame was localized: from the first position on no image shows what the map has; give images or labels that show its landmarks, and positions within metres (`--gps`)"
    )]
    NothingLocalized,
    /// A run of which no frame is scored.
    #[error(
        "only {localized} of the frames were localized, and the first {}, which GPS starts, are not scored; give more of the drive (`--first`, `--last`)",
        crate::eval::START_FRAMES
    )]
    NothingScored {
        /// Frames that were localized.
        localized: usize,
    },
    /// Estimates and truth share no frame.
    #[error(
        "{} and {} share no frame from {first} {}; give the truth of the same sequence",
        estimate.display(), truth.display(), last.map_or_else(|| "on".to_owned(), |last| format!("to {last}"))
    )]
    NoCommonFrames {
        /// The estimates.
        estimate: PathBuf,
        /// The truth.
        truth: PathBuf,
        /// First frame that counts.
        first: usize,
        /// Last frame that counts, where one is given.
        last: Option<usize>,
    },
    /// A report that cannot be written as JSON.
    #[error("the report cannot be written as JSON: {message}; leave `--json` out")]
    Json {
        /// What the encoder says.
        message: String,
    },
}

impl Error {
    /// Whether it is one image that is damaged, and others may be intact.
    pub fn is_of_an_image(&self) -> bool {
        matches!(self, Self::Vision(crate::vision::Error::Decode { .. }))
    }
}
