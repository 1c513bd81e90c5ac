//! What programs say to people.

use std::io::{ErrorKind, Write as _};
use std::process::ExitCode;
use std::sync::OnceLock;

/// Why something that was to be said is lost.
static LOST: OnceLock<String> = OnceLock::new();

/// Writes a text to the standard output. A reader that is gone (`| head`) is no
/// fault: the work goes on, and files are written. Where it goes to a file that
/// cannot take it, [`ended`] says so.
pub fn print(text: &str) {
    print_to_reader(text);
}

/// The same; false where nobody can read any more, for who works for a reader alone.
pub fn print_to_reader(text: &str) -> bool {
    let mut output = std::io::stdout();
    let Err(error) = output.write_all(text.as_bytes()).and_then(|()| output.flush()) else { return true };
    if error.kind() != ErrorKind::BrokenPipe {
        LOST.get_or_init(|| error.to_string());
    }
    false
}

/// Takes note of what became of a text that another has written to the standard output,
/// such as the help of a command line: as [`print()`] does of its own.
pub fn written(result: std::io::Result<()>) {
    if let Err(error) = result.and_then(|()| std::io::stdout().flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        LOST.get_or_init(|| error.to_string());
    }
}

/// The exit code of a program that ends with this one: 2, and one sentence, where
/// it went well but for what it had to say.
pub fn ended(code: ExitCode) -> ExitCode {
    match LOST.get() {
        Some(why) if code != ExitCode::from(2) => {
            print_error(format_args!("what was to be said could not be written ({why}); send it where there is room"));
            ExitCode::from(2)
        }
        _ => code,
    }
}

/// Writes why a program ends early to the error stream, as one sentence after
/// `error: `, in all programs alike. As with [`print()`], a reader may be gone.
pub fn print_error(error: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "error: {error}");
}

/// Writes what people should know to the error stream, as one sentence after `note: `:
/// where the standard output is a document that has no place for it.
pub fn print_note(note: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "note: {note}");
}

/// As `println!`, by [`output::print`]($crate::output::print).
#[macro_export]
macro_rules! say {
    ($($part:tt)*) => { $crate::output::print(&(format!($($part)*) + "\n")) };
}
