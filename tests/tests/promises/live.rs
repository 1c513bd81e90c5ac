//! A vehicle is answered image by image, as a whole drive is.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};

use crate::support::{DEMO, text};

/// `localizer live` with the demo's map and label images, and more words.
fn live(more: &[&str]) -> Child {
    let (map, sequence) = (DEMO.file("street.csm"), DEMO.file("drive/sequences/00"));
    let (calibration, labels) = (sequence.join("calib.txt"), sequence.join("labels_2"));
    let words = ["live", "--map", text(&map), "--calib", text(&calibration), "--labels", text(&labels)];
    let mut command = Command::new(env!("CARGO_BIN_EXE_tool"));
    command.arg("localizer").args(words).args(more);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn lines(name: &str) -> Vec<String> {
    let text = std::fs::read_to_string(DEMO.file("drive/sequences/00").join(name)).unwrap();
    text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
}

#[test]
fn each_image_is_answered_before_the_next_with_what_the_whole_drive_gives() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let fixes = DEMO.file("drive/sequences/00/gnss.txt");
    let (map, drive) = (DEMO.file("street.csm"), DEMO.file("drive"));
    let labels = drive.join("sequences/00/labels_2");
    let words = ["run", "--map", text(&map), "--kitti", text(&drive), "--sequence", "00", "--labels", text(&labels)];
    crate::support::run("localizer", &[&words[..], &["--gps", text(&fixes), "--out", text(&out)]].concat()).ok();
    let whole = std::fs::read_to_string(out.join("estimates.csv")).unwrap();
    let mut vehicle = live(&[]);
    let mut says = vehicle.stdin.take().unwrap();
    let mut answers = BufReader::new(vehicle.stdout.take().unwrap()).lines();
    let mut fixes = lines("gnss.txt").into_iter().peekable();
    let mut heard = vec![answers.next().unwrap().unwrap()];
    for (frame, time_s) in lines("times.txt").iter().enumerate() {
        let now_s: f64 = time_s.parse().unwrap();
        let is_due = |fix: &String| fix.split(' ').next().unwrap().parse::<f64>().unwrap() <= now_s + 1e-6;
        while let Some(fix) = fixes.next_if(is_due) {
            writeln!(says, "gps {fix}").unwrap();
        }
        writeln!(says, "image {time_s} {frame}").unwrap();
        // The input is still open: nothing waits for its end.
        heard.push(answers.next().unwrap().unwrap());
    }
    drop(says);
    assert!(answers.next().is_none() && vehicle.wait().unwrap().success());
    assert_eq!(heard.join("\n") + "\n", whole);
}

#[test]
fn what_cannot_be_taken_in_is_told_and_passed_over_and_its_reader_may_go() {
    let [first, second] = [0, 1].map(|frame| lines("times.txt")[frame].clone());
    let fix = lines("gnss.txt")[0].clone();
    let said = [
        format!("image {first} 0"),
        "# a comment, and an empty line".to_owned(),
        String::new(),
        "imagine 0 1".to_owned(),
        "odometry 0 1 2".to_owned(),
        "gps 0 1 2".to_owned(),
        format!("gps {second} {}", fix.split_once(' ').unwrap().1),
        format!("image {second} 999"),
        format!("image {second} 1"),
        format!("image {second} 1000 nowhere.png"),
    ];
    let mut vehicle = live(&[]);
    vehicle.stdin.take().unwrap().write_all((said.join("\n") + "\n").as_bytes()).unwrap();
    let output = vehicle.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let answers = String::from_utf8(output.stdout).unwrap();
    let answers: Vec<&str> = answers.lines().collect();
    assert!(answers[1].starts_with("# frame 0, ") && answers[1].ends_with("no position came yet"), "{answers:?}");
    assert!(answers[2].starts_with("# ") && answers[2].contains("999"), "{answers:?}");
    assert!(answers[3].starts_with("# line 9 ") && answers[4].contains("nowhere.png"), "{answers:?}");
    assert_eq!(answers.len(), 5, "{answers:?}");
    let errors = String::from_utf8(output.stderr).unwrap();
    let errors: Vec<&str> = errors.lines().collect();
    for (error, part) in errors.iter().zip([
        "line 4 of the standard input is `imagine 0 1`; give `image T FRAME [PATH]`",
        "line 5 of the standard input is of wheels",
        "line 6 of the standard input",
        "999",
        "line 9 of the standard input is of frame 1, no later",
        "nowhere.png: No such file",
        "6 lines of the standard input were passed over",
    ]) {
        assert!(error.starts_with("error: ") && error.contains(part), "no `{part}` in: {error}");
    }
    assert_eq!(errors.len(), 7, "{errors:?}");
    // Nobody listens any more: it ends, and well.
    let mut vehicle = live(&["--wheels"]);
    drop(vehicle.stdout.take());
    let mut says = vehicle.stdin.take().unwrap();
    let _ = says.write_all(format!("image {first} 0\nimage {second} 1\n").as_bytes());
    assert_eq!(vehicle.wait().unwrap().code(), Some(0));
}
