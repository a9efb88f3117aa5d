//! What is known to be wrong with a log, and what was done to hide people.

use std::collections::BTreeMap;

use schemas::metadata;

use crate::log::{CheckReport, Finding, Log};

/// The audit record of the last `pslam redact`; `None` for a log that was never redacted.
pub(super) fn redaction(log: &Log) -> Option<BTreeMap<String, String>> {
    let record = log.metadata().get(metadata::REDACTION)?;
    Some(record.iter().filter(|(key, _)| *key != metadata::CHECKSUM_KEY).map(|(k, v)| (k.clone(), v.clone())).collect())
}

/// What was done to the log since it was first written, oldest first: operation and arguments.
pub(super) fn edits(log: &Log) -> Vec<String> {
    let number = |name: &str| name.strip_prefix(metadata::PROVENANCE_PREFIX)?.parse::<u32>().ok();
    let records = log.metadata().iter().filter_map(|(name, values)| Some((number(name)?, values)));
    let word = |values: &BTreeMap<String, String>, key: &str| values.get(key).cloned().unwrap_or_default();
    let edits: BTreeMap<u32, String> = records
        .map(|(at, values)| (at, format!("{} {}", word(values, "operation"), word(values, "arguments"))))
        .collect();
    edits.into_values().collect()
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
