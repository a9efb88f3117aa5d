//! Results on standard output.

use serde::Serialize;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write as _};

/// Prints a result as it is. A reader that has seen enough (`pslam info LOG | head -1`) is no error.
pub fn text(result: &dyn Display) -> anyhow::Result<()> {
    let written = write!(io::stdout().lock(), "{result}").and_then(|()| io::stdout().flush());
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// Prints a result as JSON with a newline at the end.
pub fn json(result: &impl Serialize) -> anyhow::Result<()> {
    text(&format_args!("{}\n", serde_json::to_string_pretty(result)?))
}

/// As JSON or as the text that its `Display` gives.
pub fn either(as_json: bool, result: &(impl Serialize + Display)) -> anyhow::Result<()> {
    if as_json { json(result) } else { text(result) }
}
