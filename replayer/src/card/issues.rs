//! What is known to be wrong with a log, and what was done to hide people.

use std::collections::BTreeMap;

use schemas::metadata;
use serde::Serialize;

use crate::log::{CheckReport, Finding, Log};

/// Who was hidden and how, as the audit record of `pslam redact` tells it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Redaction {
    /// The record's name.
    pub record: String,
    /// Its content.
    pub values: BTreeMap<String, String>,
}

/// Redactions in the order in which they were made; empty for a log as recorded.
pub(super) fn redactions(log: &Log) -> Vec<Redaction> {
    let records = log.metadata().iter().filter(|(name, values)| {
        name.starts_with(metadata::PROVENANCE_PREFIX) && values.get("operation").is_some_and(|o| o == "redact")
    });
    let content = |values: &BTreeMap<String, String>| {
        values.iter().filter(|(key, _)| *key != metadata::CHECKSUM_KEY).map(|(k, v)| (k.clone(), v.clone())).collect()
    };
    let mut found: Vec<Redaction> =
        records.map(|(name, values)| Redaction { record: name.clone(), values: content(values) }).collect();
    found.sort_by_key(|r| r.record.rsplit('/').next().and_then(|number| number.parse::<u32>().ok()));
    found
}

/// Everything that `pslam check` found, a line each; losses of a recording (its drop ledger) are among them.
pub(super) fn known(report: &CheckReport) -> Vec<String> {
    let line = |finding: &Finding| {
        let Finding { severity, kind, count, examples } = finding;
        let example = examples.first().map_or(String::new(), |example| format!(", first: {example}"));
        format!("{severity:?}: {} ({count} x{example})", kind.replace('_', " "))
    };
    report.findings.iter().map(line).collect()
}
