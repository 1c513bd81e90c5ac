//! What a merge did, for people and for programs.

use std::fmt::Write as _;

use serde::Serialize;

use super::align::State;

/// What a merge did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MergeReport {
    /// The maps that were merged, in their own order.
    pub sources: Vec<SourceReport>,
    /// Step of all coordinates of the merged map, metres: the finest of the
    /// sources.
    pub quantum_m: f64,
    /// The sources have steps of different lengths.
    pub mixed_quanta: bool,
    /// How far the same landmarks lay apart (root mean square of the distance
    /// from their mean, seen from above, metres), as given.
    pub apart_given_m: f64,
    /// The same after the maps were aligned.
    pub apart_aligned_m: f64,
    /// Poles.
    pub poles: Counts,
    /// Signs and lights.
    pub signs: Counts,
    /// Lane lines, in metres.
    pub lanes_m: Counts,
    /// Roads of all sources.
    pub roads_given: usize,
    /// Roads of the merged map.
    pub roads: usize,
}

/// One source of a merged map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SourceReport {
    /// Checksum of the map file, as its last four bytes have it.
    pub crc32c: String,
    /// What its frame is, for people.
    pub frame_note: String,
    /// How it was aligned: `alone`, `aligned`, or `unaligned`.
    pub state: &'static str,
    /// Root mean square of the shift of its landmarks, metres.
    pub moved_rms_m: f64,
}

/// How many landmarks came in, and what became of them. `single + fused +
/// contested` is what the merged map has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Counts {
    /// In all sources.
    pub given: f64,
    /// Kept as the only source that came near has them.
    pub single: f64,
    /// Kept out of two or more sources.
    pub fused: f64,
    /// Kept though one of two sources that came near does not have them: new,
    /// or gone, or missed.
    pub contested: f64,
    /// Dropped, for most sources that came near do not have them.
    pub dropped: f64,
}

impl Counts {
    /// Counts a landmark of the merged map, or one that it does not have; true
    /// if it has.
    pub fn count(&mut self, amount: f64, seen: usize, missed: usize) -> bool {
        let slot = if missed > seen {
            &mut self.dropped
        } else if seen > 1 {
            &mut self.fused
        } else if missed > 0 {
            &mut self.contested
        } else {
            &mut self.single
        };
        *slot += amount;
        missed <= seen
    }

    fn text(&self, name: &str, unit: &str) -> String {
        format!(
            "{name}: {:.0}{unit} given; kept {:.0}{unit} that one map has, {:.0}{unit} out of several, \
             {:.0}{unit} new or gone (one of two has them); dropped {:.0}{unit} that most do not have\n",
            self.given, self.single, self.fused, self.contested, self.dropped
        )
    }
}

impl State {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Alone => "alone",
            Self::Aligned => "aligned",
            Self::Unaligned => "unaligned",
        }
    }
}

impl MergeReport {
    /// The report as lines of text.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let count = |state: State| self.sources.iter().filter(|source| source.state == state.name()).count();
        // Writing to a string cannot fail.
        let _ = writeln!(
            out,
            "{} maps: {} aligned, {} without another near, {} could not be aligned",
            self.sources.len(),
            count(State::Aligned),
            count(State::Alone),
            count(State::Unaligned)
        );
        for source in self.sources.iter().filter(|source| source.state == State::Unaligned.name()) {
            let _ = writeln!(
                out,
                "kept as given, for other maps do not have its landmarks: {} ({})",
                source.frame_note, source.crc32c
            );
        }
        if self.apart_given_m > 0.0 {
            let (given, aligned) = (self.apart_given_m, self.apart_aligned_m);
            let _ = writeln!(out, "the same landmarks lay {given:.3} m rms off their mean, and aligned {aligned:.3} m");
        }
        if self.mixed_quanta {
            let _ = writeln!(out, "the maps have different quanta: the finest, {} m, is taken", self.quantum_m);
        }
        out += &self.poles.text("poles", "");
        out += &self.signs.text("signs", "");
        out += &self.lanes_m.text("lanes", " m");
        let _ = writeln!(out, "roads: {} given, {} kept", self.roads_given, self.roads);
        out
    }
}
