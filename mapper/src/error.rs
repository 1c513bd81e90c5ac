//! What can go wrong while a map is built.

use std::path::{Path, PathBuf};

/// Result of the mapper's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong while a map is built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Input or output.
    #[error(transparent)]
    Common(#[from] common::Error),
    /// No frame to stitch.
    #[error(
        "{} holds no scan to stitch with --every {every}: check the frames and --every",
        folder.display()
    )]
    NoScans {
        /// Where the scans should lie.
        folder: PathBuf,
        /// Stride of the frames.
        every: usize,
    },
    /// Scans of other frames than those that are stitched.
    #[error(
        "{} holds no scan to stitch with --every {every}, --first and --last: its scans are of frames {there}; change these options",
        folder.display()
    )]
    NoScanChosen {
        /// Where the scans lie.
        folder: PathBuf,
        /// Stride of the frames.
        every: usize,
        /// The frames that have a scan.
        there: String,
    },
    /// A folder without scans that holds something else.
    #[error(
        "{} holds no scan such as {wanted}, but {count} files such as {other}; give a drive with scans of KITTI's form (of its raw recordings a `_sync` one)",
        folder.display()
    )]
    OtherFiles {
        /// Where the scans should lie.
        folder: PathBuf,
        /// A name that scans have.
        wanted: String,
        /// Files and folders that are there.
        count: usize,
        /// The first of them.
        other: String,
    },
    /// A folder without scans.
    #[error("{} is empty; put scans such as {wanted} there", folder.display())]
    EmptyFolder {
        /// Where the scans should lie.
        folder: PathBuf,
        /// A name that scans have.
        wanted: String,
    },
    /// A scan of a frame that the poses do not reach.
    #[error(
        "{} has no pose, for the pose file ends after {poses} rows: give the poses of the whole drive or use --last",
        path.display()
    )]
    FrameWithoutPose {
        /// The scan.
        path: PathBuf,
        /// Rows in the pose file.
        poses: usize,
    },
    /// Poses too far apart for one drive.
    #[error(
        "{}: from frame {before} to frame {after} the survey jumps by {apart_m:.1} m (`roads.longest_step_m` allows {longest_m}): correct the poses, or build the parts by themselves with --first and --last",
        path.display()
    )]
    SurveyJumps {
        /// Where the survey stands.
        path: PathBuf,
        /// The frame before the jump.
        before: usize,
        /// The one after it.
        after: usize,
        /// Their distance, metres.
        apart_m: f64,
        /// The longest that is accepted, metres.
        longest_m: f64,
    },
    /// Poses in a frame whose origin is too far off.
    #[error(
        "{}: frame {frame} is {distance_m:.3e} m from the origin of the poses (`roads.farthest_m` allows {farthest_m}): give poses in the frame of the first one",
        path.display()
    )]
    FarFromOrigin {
        /// Where the survey stands.
        path: PathBuf,
        /// The frame.
        frame: usize,
        /// Its distance from the origin, metres.
        distance_m: f64,
        /// The largest that is accepted, metres.
        farthest_m: f64,
    },
    /// Scans that are all blind.
    #[error(
        "{}: no scan has a point with finite coordinates within reach, so there is nothing to map: give scans with returns, or change the ranges under `[cloud]`", scans.display()
    )]
    NothingSeen {
        /// Where the scans lie.
        scans: PathBuf,
    },
    /// Scans and poses that do not belong together.
    #[error(
        "{}: ground lies level under {seen_percent:.0} % of the driven path only: {why}; check the calibration (`Tr` leads from the lidar to the camera) and the frame of the poses", scans.display()
    )]
    NoGround {
        /// Where the scans lie.
        scans: PathBuf,
        /// Where ground was seen, percent of the best window's path.
        seen_percent: f64,
        /// What may be the cause.
        why: &'static str,
    },
    /// No drive was given.
    #[error("no drive is given: use --kitti with --sequence, --raw, --scans or --stitched")]
    NoSource,
    /// A scan or a cloud that is not what it should be.
    #[error("{}: {what}", path.display())]
    BadScan {
        /// The file.
        path: PathBuf,
        /// What is wrong, where, and what to do.
        what: String,
    },
    /// A folder without a scan.
    #[error("{} holds no scan; give a folder of .las, .laz, .pcd, .ply or .bin files", folder.display())]
    NoScanFiles {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder with scans of two formats.
    #[error("{} and {} are of two formats; give a folder with scans of one", first.display(), other.display())]
    MixedScans {
        /// A scan.
        first: PathBuf,
        /// A scan of another format.
        other: PathBuf,
    },
    /// As many poses as there are not scans.
    #[error(
        "{} has {poses} poses and {} has {scans} scans, which are not named by numbers of poses or by times: give a pose per scan, or TUM poses with --scan-times",
        survey.display(),
        folder.display()
    )]
    PosesAndScans {
        /// The file of the poses.
        survey: PathBuf,
        /// Its poses.
        poses: usize,
        /// The folder of the scans.
        folder: PathBuf,
        /// Its scans.
        scans: usize,
    },
    /// As many times as there are not scans.
    #[error("{} has {times} times and {} has {scans} scans: give one time per scan", path.display(), folder.display())]
    TimesAndScans {
        /// The file of the times.
        path: PathBuf,
        /// Its times.
        times: usize,
        /// The folder of the scans.
        folder: PathBuf,
        /// Its scans.
        scans: usize,
    },
    /// As many times as there are not KITTI rows.
    #[error(
        "{} has {times} times and {} has {poses} poses without times: give one time per pose, or TUM poses",
        path.display(),
        survey.display()
    )]
    TimesAndPoses {
        /// The file of the times.
        path: PathBuf,
        /// Its times.
        times: usize,
        /// The file of the poses.
        survey: PathBuf,
        /// Its poses.
        poses: usize,
    },
    /// Times for poses that have some.
    #[error("{} has a time for each pose already: leave --scan-times {} out", survey.display(), times.display())]
    TimesTwice {
        /// The file of the poses.
        survey: PathBuf,
        /// The file of the times.
        times: PathBuf,
    },
    /// Poses and scans of other times.
    #[error(
        "{}: its poses are from {:.3} to {:.3} s, and no scan of {} ({:.3} to {:.3} s) has one before and after within {gap_s} s: give the poses of this drive, or its times with --scan-times",
        survey.display(), poses_s.0, poses_s.1, scans.display(), scans_s.0, scans_s.1
    )]
    TimesApart {
        /// The file of the poses.
        survey: PathBuf,
        /// The folder of the scans.
        scans: PathBuf,
        /// First and last time of a pose, seconds.
        poses_s: (f64, f64),
        /// First and last time of a scan, seconds.
        scans_s: (f64, f64),
        /// Longest time between two poses, seconds.
        gap_s: f64,
    },
    /// A cloud that is not where its trajectory is.
    #[error(
        "{}: none of its {points} points is near the poses of {}: give the trajectory in the frame of the cloud, and --survey-frame camera where its z is forward",
        cloud.display(),
        survey.display()
    )]
    CloudApart {
        /// The cloud.
        cloud: PathBuf,
        /// The file of the poses.
        survey: PathBuf,
        /// Points of the cloud.
        points: usize,
    },
    /// Inputs of an atlas without a map.
    #[error("there is no .csm file in {}; give maps, or folders that hold some", list(inputs))]
    NoMaps {
        /// What was given.
        inputs: Vec<PathBuf>,
    },
    /// Inputs of an atlas that are one.
    #[error("{} and {} are the same map; give each map once", first.display(), second.display())]
    SameMap {
        /// One of them.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// Outputs that are one file.
    #[error("{}: {first} and {second} would be one file; give each a name of its own", path.display())]
    SameOutput {
        /// The file.
        path: PathBuf,
        /// What would be written to it.
        first: String,
        /// What would be written to it, too.
        second: String,
    },
    /// An output that is read.
    #[error("{}: it is read, and {option} would replace it; give another name", path.display())]
    OutputIsInput {
        /// The file.
        path: PathBuf,
        /// What would be written to it.
        option: String,
    },
    /// The LAS writer.
    #[error("{}: the point cloud could not be written: {reason}", path.display())]
    Cloud {
        /// The file.
        path: PathBuf,
        /// What the writer says.
        reason: String,
    },
    /// A file beside a map that is no report of its build.
    #[error("{}: {source}; it is no report of `mapper build`: build the map again, or remove the file", path.display())]
    BadReport {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: serde_json::Error,
    },
    /// A file to export to whose extension says no format.
    #[error(
        "{}: the extension says no format; name it .geojson, .osm (Lanelet2), .csv or .txt, or give --format",
        path.display()
    )]
    UnknownExport {
        /// The file to be written.
        path: PathBuf,
    },
    /// Other coordinates for a format that has the map's.
    #[error(
        "the paper's text has the map's own coordinates only: leave --origin, --crs and --coordinates away, or export as CSV or GeoJSON"
    )]
    MapFrameOnly,
    /// A map of whose place in the survey's world nothing is known.
    #[error(
        "{}: nothing beside it says where it is in its survey's world; put the report of its build there ({}), or leave --coordinates and --crs away",
        map.display(),
        report.display()
    )]
    NoSurveyFrame {
        /// The map.
        map: PathBuf,
        /// Where its report would be.
        report: PathBuf,
    },
    /// A map of which no survey in a grid is known.
    #[error("{} is in the frame of its first camera, which is in no grid; give --origin instead of --crs", map.display())]
    NoGrid {
        /// The map.
        map: PathBuf,
    },
    /// Maps that are not in one frame.
    #[error(
        "{} is {frame}, and {} is {other_frame}: their metres are not of one frame; build them with the same --reduce, and drives of KITTI raw as --scans with poses in one world",
        map.display(),
        other.display()
    )]
    FramesApart {
        /// A map.
        map: PathBuf,
        /// Its frame, for people.
        frame: String,
        /// Another map.
        other: PathBuf,
        /// Its frame.
        other_frame: String,
    },
    /// A file of sources that is not that of the map beside it.
    #[error("{}: {reason}; remove it to merge {} as it is, or merge its maps again", path.display(), map.display())]
    BadSources {
        /// The file of sources.
        path: PathBuf,
        /// The map beside it.
        map: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A budget that not even the roads fit.
    #[error(
        "no map fits {budget_bytes} bytes: {roads} road stretches without any landmark take {least_bytes}; \
         give --budget {least_bytes} or more"
    )]
    BudgetTooSmall {
        /// Most bytes that the map may have.
        budget_bytes: usize,
        /// Bytes of the roads alone, written as coarsely as is allowed.
        least_bytes: usize,
        /// Number of roads.
        roads: usize,
    },
    /// A map too large to look from every place of it.
    #[error(
        "the roads and lines of {name} are {length_m:.1e} m long (at most {longest_m:.0e} m is accepted): \
         build the map again, or give parts of it"
    )]
    TooLong {
        /// The map, as people know it.
        name: String,
        /// Length of its roads and lines, metres.
        length_m: f64,
        /// The largest that is accepted, metres.
        longest_m: f64,
    },
    /// A result that has no JSON form.
    #[error("the result cannot be printed as JSON: {0}")]
    Json(serde_json::Error),
    /// Threads that the operating system does not give.
    #[error("{threads} threads could not be started: {reason}; give a smaller --threads")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the operating system says.
        reason: String,
    },
}

fn list(paths: &[PathBuf]) -> String {
    let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    names.join(", ")
}

impl Error {
    /// What `las` says about a file.
    pub(crate) fn las(path: &Path, error: &las::Error) -> Self {
        let said = error.to_string().replace('\n', " ");
        Self::BadScan {
            path: path.to_path_buf(),
            what: format!("it is no whole LAS or LAZ file ({said}); copy or export it again"),
        }
    }

    /// For `map_err`: what is wrong with a report, together with its file.
    pub fn report(path: &Path) -> impl FnOnce(serde_json::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::BadReport { path, source }
    }
}
