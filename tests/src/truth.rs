//! The truth of generated drives.

use std::path::Path;

use fixtures::truth::Truth;

/// Reads `truth.json` of a drive.
///
/// # Errors
/// One sentence that names the file and says what is wrong with it.
pub fn read(drive: &Path) -> Result<Truth, String> {
    let path = drive.join("truth.json");
    let hint = "give the folder that `fixtures generate --out` wrote";
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}; {hint}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}; {hint}", path.display()))
}
