//! The same input gives the same bytes, on any number of threads.

use std::path::Path;

use crate::support::{DEMO, build, text};

/// Everything that a build writes.
fn outputs(folder: &Path, threads: &str) -> Vec<Vec<u8>> {
    let file = |name: &str| folder.join(name);
    let (map, trajectory, cloud) = (file("a.csm"), file("a.txt"), file("a.laz"));
    let more = ["--threads", threads, "--trajectory", text(&trajectory), "--cloud", text(&cloud)];
    build(&DEMO.file("drive"), "00", &map, &more).ok();
    [map, trajectory, cloud, file("a.build.json")].map(|path| std::fs::read(path).unwrap()).into()
}

#[test]
fn one_thread_two_threads_and_a_second_run_write_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let one = outputs(folder.path(), "1");
    let two = outputs(folder.path(), "2");
    let again = outputs(folder.path(), "2");
    for (what, of) in ["map", "trajectory", "cloud", "report"].iter().enumerate() {
        assert!(one[what] == two[what], "the {of} depends on the threads");
        assert!(two[what] == again[what], "the {of} depends on the run");
    }
}
