//! Programs in processes of their own, and the drives that they run on.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

use common::geometry::Pose;
use common::kitti::{ScanPoint, write_poses, write_scan, write_times};

/// How a program ended and what it said.
#[derive(Debug)]
pub struct Ran {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Ran {
    fn new(output: &Output) -> Self {
        Self {
            code: output.status.code().unwrap(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// What it said, having ended well.
    pub fn ok(self) -> String {
        assert_eq!(self.code, 0, "{}", self.err);
        self.out
    }

    /// Its sentence, having refused an input: one line, with each of `parts`.
    pub fn refused(&self, parts: &[&str]) {
        assert_eq!(self.code, 2, "{self:?}");
        assert_eq!(self.err.lines().count(), 1, "{}", self.err);
        for part in parts {
            assert!(self.err.contains(part), "no `{part}` in: {}", self.err);
        }
    }
}

/// Runs `fixtures`, `mapper` or `localizer` with words (split at spaces; what
/// stands for a path is given after them).
pub fn run(program: &str, words: &[&str]) -> Ran {
    Ran::new(&Command::new(env!("CARGO_BIN_EXE_tool")).arg(program).args(words).output().unwrap())
}

/// Runs another program of the workspace, by its path.
pub fn run_path(program: &str, words: &[&str]) -> Ran {
    Ran::new(&Command::new(program).args(words).output().unwrap())
}

/// The same with a variable of the environment.
pub fn run_with((name, value): (&str, &str), program: &str, words: &[&str]) -> Ran {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tool"));
    Ran::new(&command.env(name, value).arg(program).args(words).output().unwrap())
}

/// The same with its standard output in a file, of which nothing is read here.
#[cfg(target_os = "linux")]
pub fn run_into(file: std::fs::File, program: &str, words: &[&str]) -> Ran {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tool"));
    Ran::new(&command.arg(program).args(words).stdout(file).output().unwrap())
}

/// `fixtures generate` of a drive, with settings that go into a file beside it.
pub fn generate(drive: &Path, settings: &str, more: &[&str]) -> Ran {
    let config = drive.with_extension("toml");
    std::fs::write(&config, settings).unwrap();
    run("fixtures", &[&["generate", "--config", text(&config), "--out", text(drive)], more].concat())
}

/// `mapper build` of a sequence to a map.
pub fn build(root: &Path, sequence: &str, map: &Path, more: &[&str]) -> Ran {
    let words = ["build", "--kitti", text(root), "--sequence", sequence, "--out", text(map)];
    run("mapper", &[&words[..], more].concat())
}

/// The report on a drive that is localized from label images.
pub fn localized(map: &Path, drive: &Path, truth: &Path, out: &Path) -> serde_json::Value {
    let labels = drive.join("sequences/00/labels_2");
    let words = ["run", "--map", text(map), "--kitti", text(drive), "--sequence", "00", "--labels", text(&labels)];
    run("localizer", &[&words[..], &["--truth", text(truth), "--out", text(out)]].concat()).ok();
    let said = run("localizer", &["eval", "--estimate", text(out), "--truth", text(truth), "--json"]).ok();
    serde_json::from_str(&said).unwrap()
}

/// A path as a word of a command line.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The demo's folder and what it said; it runs once for all tests.
pub struct Demo {
    pub folder: PathBuf,
    pub said: String,
}

impl Demo {
    /// A file of the demo.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// `localizer run` of its drive in a map.
    pub fn localize(&self, map: &Path, out: &Path) -> Ran {
        self.localize_by(&self.file("drive/sequences/00/labels_2"), map, out, &[])
    }

    /// The same with other label images, and more words.
    pub fn localize_by(&self, labels: &Path, map: &Path, out: &Path, more: &[&str]) -> Ran {
        let (drive, truth) = (self.file("drive"), self.file("drive/truth/poses.txt"));
        let words = ["run", "--map", text(map), "--kitti", text(&drive), "--sequence", "00", "--labels", text(labels)];
        run("localizer", &[&words[..], &["--truth", text(&truth), "--out", text(out)], more].concat())
    }
}

/// Frames of the demo's drive here: 80 m.
pub const FRAMES: usize = 60;

pub static DEMO: LazyLock<Demo> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("demo");
    // An earlier version may have left a drive that this one does not know.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).unwrap();
    }
    let frames = FRAMES.to_string();
    let words = ["--out", text(&folder), "--frames", &frames];
    let output = Command::new(env!("CARGO_BIN_EXE_demo")).args(words).output().unwrap();
    Demo { said: Ran::new(&output).ok(), folder }
});

/// An 8-bit image, grey or of three colours.
pub fn write_png(path: &Path, (width, height): (u32, u32), colour: png::ColorType) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    let bytes = vec![0; (width * height) as usize * colour.samples()];
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
}

/// The calibration of a KITTI-like rig.
pub const CALIBRATION: &str = "\
P0: 707 0 602 0 0 707 183 0 0 0 1 0
P1: 707 0 602 -380 0 707 183 0 0 0 1 0
P2: 707 0 602 45 0 707 183 0 0 0 1 0
P3: 707 0 602 -334 0 707 183 0 0 0 1 0
Tr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27
";

/// The least that a sequence 04 can be: three frames, two scans of a plain.
pub fn plain() -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    let sequence = root.path().join("sequences/04");
    for folder in [sequence.join("velodyne"), root.path().join("poses")] {
        std::fs::create_dir_all(folder).unwrap();
    }
    std::fs::write(sequence.join("calib.txt"), CALIBRATION).unwrap();
    write_times(sequence.join("times.txt"), &[0.0, 0.1, 0.2]).unwrap();
    let poses: Vec<Pose> = (0..3).map(|i| Pose::translation(0.0, 0.0, f64::from(i))).collect();
    write_poses(root.path().join("poses/04.txt"), &poses).unwrap();
    let point = |i: i32| ScanPoint {
        x_m: (i / 60 - 30) as f32 * 0.7,
        y_m: (i % 60 - 30) as f32 * 0.7,
        z_m: -1.73,
        reflectance: 0.3,
    };
    for frame in [0, 1] {
        let points: Vec<ScanPoint> = (0..3600).map(point).collect();
        write_scan(sequence.join(format!("velodyne/{frame:06}.bin")), &points).unwrap();
    }
    root
}
