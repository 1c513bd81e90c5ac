//! What programs say to people.

use std::io::Write as _;

/// Writes a text to the standard output. A reader that is gone (`| head`) is no
/// fault: the work goes on, and files are written.
pub fn print(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// Writes why a program ends early to the error stream, as one sentence after
/// `error: `, in all programs alike. As with [`print()`], a reader may be gone.
pub fn print_error(error: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "error: {error}");
}

/// As `println!`, by [`output::print`]($crate::output::print).
#[macro_export]
macro_rules! say {
    ($($part:tt)*) => { $crate::output::print(&(format!($($part)*) + "\n")) };
}
