//! Lists that are written at the end, in order of time.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use schemas::Stamp;

/// Rows of text by stamp.
#[derive(Debug, Default)]
pub(super) struct Rows(pub BTreeMap<Stamp, String>);

impl Rows {
    pub fn add(&mut self, stamp: Stamp, row: String) {
        self.0.insert(stamp, row);
    }

    /// `head`, then the rows, a line each.
    pub fn text(&self, head: &str) -> String {
        let mut text = head.to_owned();
        for row in self.0.values() {
            text.push_str(row);
            text.push('\n');
        }
        text
    }
}

/// Numbers in the shortest form that reads back as the same 64 bits.
pub(super) fn numbers(values: &[f64], separator: char) -> String {
    let mut text = String::new();
    for (i, value) in values.iter().enumerate() {
        if i > 0 {
            text.push(separator);
        }
        let _ = write!(text, "{value}"); // writing to a String cannot fail
    }
    text
}
