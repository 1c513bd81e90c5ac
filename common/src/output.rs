//! What programs say to people.

use std::io::Write as _;

/// Writes a text to the standard output. A reader that is gone (`| head`) is no
/// fault: the work goes on, and files are written.
pub fn print(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// As `println!`, by [`output::print`]($crate::output::print).
#[macro_export]
macro_rules! say {
    ($($part:tt)*) => { $crate::output::print(&(format!($($part)*) + "\n")) };
}
