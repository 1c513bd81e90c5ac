//! What a build used: time, memory, and the least that it could have taken.

use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use crate::drive::Drive;

/// Time and memory of a build.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Usage {
    /// From opening the drive to the written map, seconds.
    pub wall_s: f64,
    /// Reading the bytes of the same scans once more, on the same threads,
    /// seconds: no build can be faster.
    pub read_s: f64,
    /// Most memory that this process held at a time, bytes; none where the
    /// system does not say.
    pub peak_bytes: Option<u64>,
}

impl Usage {
    /// The usage of a build that began at `started` and has just ended.
    pub fn of(started: Instant, drive: &Drive) -> Self {
        let wall_s = started.elapsed().as_secs_f64();
        let peak_bytes = peak_bytes();
        Self { wall_s, read_s: read_s(drive), peak_bytes }
    }

    /// The usage as a line of text.
    pub fn text(&self) -> String {
        let memory = self.peak_bytes.map_or_else(
            || "peak memory unknown".to_owned(),
            |bytes| format!("peak memory {:.0} MB", bytes as f64 / 1e6),
        );
        format!("{:.2} s, {memory}; just reading the scans' bytes takes {:.3} s\n", self.wall_s, self.read_s)
    }
}

fn read_s(drive: &Drive) -> f64 {
    let started = Instant::now();
    // Scans that were readable a moment ago; if one is not, there is nothing
    // to compare with.
    let bytes: usize =
        drive.frames.par_iter().map(|&f| std::fs::read(drive.scan_path(f)).map_or(0, |bytes| bytes.len())).sum();
    std::hint::black_box(bytes);
    started.elapsed().as_secs_f64()
}

/// The high-water mark of this process's memory as Linux counts it.
pub fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_that_of_this_process() {
        if !std::path::Path::new("/proc/self/status").exists() {
            return;
        }
        let held = vec![1_u8; 64 << 20];
        std::hint::black_box(&held);
        assert!(peak_bytes().unwrap() >= 64 << 20);
    }
}
