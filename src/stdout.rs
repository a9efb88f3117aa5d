//! Results on standard output.

use serde::Serialize;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write as _};

/// Prints a result, its last line closed. A reader that has seen enough (`pslam info LOG | head -1`) is no error.
pub fn text(result: &dyn Display) -> anyhow::Result<()> {
    let text = result.to_string();
    let end = if text.ends_with('\n') { "" } else { "\n" };
    let mut out = io::stdout().lock();
    let written = write!(out, "{text}{end}").and_then(|()| out.flush());
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// Prints a result as JSON.
pub fn json(result: &impl Serialize) -> anyhow::Result<()> {
    text(&serde_json::to_string_pretty(result)?)
}

/// As JSON or as the text that its `Display` gives.
pub fn either(as_json: bool, result: &(impl Serialize + Display)) -> anyhow::Result<()> {
    if as_json { json(result) } else { text(result) }
}
