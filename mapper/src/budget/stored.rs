//! A map on the disk, as a reduction starts from it.

use std::path::Path;

use common::map::{SemanticMap, decode_with_layout};

use super::{BudgetConfig, Known};
use crate::config::Config;
use crate::error::Result;
use crate::evidence::MapEvidence;
use crate::report::{Beside, BuildReport, read_beside};

/// A map file with what its report says about it.
#[derive(Debug, Clone)]
pub struct Stored {
    /// The map.
    pub map: SemanticMap,
    /// How well its landmarks are known, or is assumed.
    pub evidence: MapEvidence,
    /// Step of its coordinates, metres.
    pub quantum_m: f64,
    /// Length of its file, bytes.
    pub bytes: usize,
    /// The report beside it.
    pub report: Option<BuildReport>,
    /// Why the report beside it is passed over, for people.
    pub note: Option<String>,
    /// The settings of the budget.
    pub config: BudgetConfig,
}

impl Stored {
    /// Reads a map and the report beside it, for what is done by these settings.
    ///
    /// # Errors
    /// A file that cannot be read or is not what it should be.
    pub fn read(path: &Path, settings: &Config) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
        let (map, layout) = decode_with_layout(&bytes).map_err(common::Error::in_file(path))?;
        let Beside { own: report, note } = read_beside(path, &bytes)?;
        let evidence = report
            .as_ref()
            .map(|report| report.evidence.clone())
            .filter(|evidence| evidence.fits(&map))
            .unwrap_or_else(|| MapEvidence::assumed(&map, &settings.evidence));
        let (quantum_m, bytes, config) = (layout.quantum_m, bytes.len(), settings.budget.clone());
        Ok(Self { map, evidence, quantum_m, bytes, report, note, config })
    }

    /// What a reduction starts from.
    pub fn known(&self) -> Known<'_> {
        Known { map: &self.map, evidence: &self.evidence, quantum_m: self.quantum_m }
    }
}
