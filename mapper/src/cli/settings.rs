//! `--config` and `--print-config`.

use std::path::{Path, PathBuf};

use clap::Args;
use common::config::to_toml;
use serde::Serialize;

use super::print;
use crate::error::Result;

/// Where the settings come from.
#[derive(Debug, Clone, Default, Args)]
pub struct ConfigArgs {
    /// Settings that differ from the defaults, as TOML.
    #[arg(long, value_name = "FILE.toml")]
    pub(super) config: Option<PathBuf>,
    /// Print all settings as TOML and end.
    #[arg(long)]
    pub(super) print_config: bool,
}

impl ConfigArgs {
    /// The settings as `read` has them, of the file if there is one; none where they were to
    /// be printed, and are.
    ///
    /// # Errors
    /// As `read`.
    pub fn load<T: Serialize>(&self, read: impl FnOnce(Option<&Path>) -> Result<T>) -> Result<Option<T>> {
        let settings = read(self.file())?;
        if self.print_config {
            print(&to_toml(&settings)?);
            return Ok(None);
        }
        Ok(Some(settings))
    }

    /// The file, if there is one.
    pub fn file(&self) -> Option<&Path> {
        self.config.as_deref()
    }
}
