//! Lines of neighbouring windows joined into chains.

use super::{LaneConfig, WindowLine};

/// A lane line as the lines of consecutive windows.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// In order of their stations.
    pub lines: Vec<WindowLine>,
}

impl Chain {
    /// Offset of the chain at a station, between the nearest windows, metres.
    pub fn offset_m(&self, station_m: f64) -> f64 {
        let after = self.lines.partition_point(|l| l.centre_m <= station_m);
        match (after.checked_sub(1).map(|i| &self.lines[i]), self.lines.get(after)) {
            (Some(a), Some(b)) => {
                let share = (station_m - a.centre_m) / (b.centre_m - a.centre_m);
                a.offset_m(station_m) * (1.0 - share) + b.offset_m(station_m) * share
            }
            (Some(a), None) => a.offset_m(station_m),
            (None, Some(b)) => b.offset_m(station_m),
            (None, None) => f64::NAN,
        }
    }
}

/// Joins the lines of windows: each chain goes on with the line that agrees
/// best with it half-way between the windows, in place and in direction: where
/// a line forks, its straight branch is the same line.
pub fn join(windows: &[Vec<WindowLine>], config: &LaneConfig) -> Vec<Chain> {
    let mut open: Vec<Chain> = Vec::new();
    let mut done: Vec<Chain> = Vec::new();
    for lines in windows {
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (c, chain) in open.iter().enumerate() {
            let Some(last) = chain.lines.last() else { continue };
            for (l, line) in lines.iter().enumerate() {
                let half = f64::midpoint(last.centre_m, line.centre_m);
                let apart = (last.offset_m(half) - line.offset_m(half)).abs();
                let limit = config.half_line_m * (1.0 + (line.centre_m - last.centre_m) / config.window_m);
                if apart < limit {
                    let bend = (last.slope - line.slope).abs() * (half - last.centre_m);
                    pairs.push((apart + bend, c, l));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut taken_chain = vec![false; open.len()];
        let mut taken_line = vec![false; lines.len()];
        for (_, c, l) in pairs {
            if !taken_chain[c] && !taken_line[l] {
                taken_chain[c] = true;
                taken_line[l] = true;
                open[c].lines.push(lines[l]);
            }
        }
        for (line, taken) in lines.iter().zip(taken_line) {
            if !taken {
                open.push(Chain { lines: vec![*line] });
            }
        }
        // A chain that found nothing over the longest gap is at its end.
        let here = lines.first().map(|l| l.centre_m);
        if let Some(here) = here {
            let ended = |c: &Chain| c.lines.last().is_none_or(|l| here - l.centre_m > config.longest_gap_m);
            let (old, still): (Vec<_>, Vec<_>) = open.into_iter().partition(ended);
            done.extend(old);
            open = still;
        }
    }
    done.extend(open);
    done
}
