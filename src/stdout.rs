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

/// A result with the name of its form in front.
#[derive(Serialize)]
struct Named<'a, T> {
    schema: &'a str,
    #[serde(flatten)]
    result: &'a T,
}

/// As JSON whose field `schema` is `schema`, or as the text that its `Display` gives. A schema is the command's name and a
/// version, `info/1`, which grows when a field goes away or changes its meaning; docs/json.md lists every field, and
/// tests/it/json.rs compares.
pub fn either(as_json: bool, schema: &str, result: &(impl Serialize + Display)) -> anyhow::Result<()> {
    if as_json { json(schema, result) } else { text(result) }
}

/// As JSON, for results that are no text.
pub fn json(schema: &str, result: &impl Serialize) -> anyhow::Result<()> {
    text(&serde_json::to_string_pretty(&Named { schema, result })?)
}

/// One line of JSON, for streams of results.
pub fn json_line(schema: &str, result: &impl Serialize) -> anyhow::Result<()> {
    text(&serde_json::to_string(&Named { schema, result })?)
}
