//! The whole job on a generated drive: scans to a map, its size, a camera's
//! trajectory and its score.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;

/// Generates a drive, maps it, and localizes a camera in the map. Every
/// command is printed as it could be typed.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// Folder for everything; it is made if need be.
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    out: PathBuf,
    /// Number of frames of the drive: ten a second, 1.3 m apart.
    #[arg(long, value_name = "N", default_value_t = 100)]
    frames: usize,
}

type Program = (&'static str, fn(Vec<OsString>) -> ExitCode);

const FIXTURES: Program = ("fixtures", |arguments| fixtures::cli::run(arguments));
const MAPPER: Program = ("mapper", |arguments| mapper::cli::run(arguments));
const LOCALIZER: Program = ("localizer", |arguments| localizer::cli::run(arguments));

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let started = Instant::now();
    if let Err(error) = std::fs::create_dir_all(&arguments.out) {
        common::output::print_error(format!("{}: {error}; give another --out", arguments.out.display()));
        return ExitCode::from(2);
    }
    let files = Files::within(&arguments.out);
    for step in steps(&files, arguments.frames) {
        common::say!("\n{}\n$ {}", step.title, step.command_line());
        let code = step.run();
        if code != ExitCode::SUCCESS {
            return code;
        }
    }
    common::say!(
        "\nDone in {:.0} s.\n  {}  the map\n  {}  its picture\n  {}  the trajectory: KITTI, TUM, CSV with covariances",
        started.elapsed().as_secs_f64(),
        files.map,
        files.picture,
        files.estimate
    );
    ExitCode::SUCCESS
}

/// Where the demo's files lie.
struct Files {
    drive: String,
    labels: String,
    truth: String,
    map: String,
    trajectory: String,
    picture: String,
    estimate: String,
}

impl Files {
    fn within(out: &Path) -> Self {
        let file = |name: &str| out.join(name).display().to_string();
        Self {
            drive: file("drive"),
            labels: file("drive/sequences/00/labels_2"),
            truth: file("drive/truth/poses.txt"),
            map: file("street.csm"),
            trajectory: file("street_poses.txt"),
            picture: file("street.svg"),
            estimate: file("localized"),
        }
    }
}

/// A command that the demo runs.
struct Step {
    title: &'static str,
    program: Program,
    words: Vec<String>,
}

impl Step {
    fn new(title: &'static str, program: Program, words: &[&str]) -> Self {
        Self { title, program, words: words.iter().map(ToString::to_string).collect() }
    }

    /// The command as it could be typed.
    fn command_line(&self) -> String {
        let quoted = |word: &String| if word.contains(' ') { format!("'{word}'") } else { word.clone() };
        let words: Vec<String> = self.words.iter().map(quoted).collect();
        format!("cargo run --release --bin {} -- {}", self.program.0, words.join(" "))
    }

    fn run(&self) -> ExitCode {
        let (name, run) = self.program;
        run(std::iter::once(name.into()).chain(self.words.iter().map(OsString::from)).collect())
    }
}

fn steps(files: &Files, frames: usize) -> Vec<Step> {
    let Files { drive, labels, truth, map, trajectory, picture, estimate } = files;
    let frames = frames.to_string();
    let drive_words = ["--kitti", drive, "--sequence", "00"];
    vec![
        Step::new(
            "A street with known truth: lidar scans, label images, the poses of a survey",
            FIXTURES,
            &["generate", "--frames", &frames, "--scan-every", "5", "--out", drive],
        ),
        Step::new(
            "Its map, from every fifth scan",
            MAPPER,
            &[&["build"], &drive_words[..], &["--every", "5", "--out", map, "--trajectory", trajectory]].concat(),
        ),
        Step::new("Is it small enough?", MAPPER, &["size", map, "--budget", "4096"]),
        Step::new("The map from above", MAPPER, &["draw", map, "--out", picture]),
        Step::new(
            "Where was the camera? From the label images and the map, starting from GPS",
            LOCALIZER,
            &[&["run", "--map", map], &drive_words[..], &["--labels", labels, "--truth", truth, "--out", estimate]]
                .concat(),
        ),
        Step::new("Against the exact poses", LOCALIZER, &["eval", "--estimate", estimate, "--truth", truth]),
    ]
}
