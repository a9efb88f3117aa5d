//! What the run was made from, and how it differs from another.

use slam::Config;

use super::super::html::{Page, escape};
use super::super::{Other, Story};
use crate::eval::Evaluation;
use crate::run::records::digest_of;
use crate::run::{RunSummary, config_differences};

pub fn comparison(page: &mut Page, story: &Story, other: &Other) {
    page.section("comparison", "Comparison");
    page.paragraph(&match (&other.diff.first, other.diff.same()) {
        (_, true) => "Both runs are the same, bit for bit.".to_owned(),
        (None, _) => "All frames and the trajectories are the same; what they were made from is not.".to_owned(),
        (Some(first), _) => format!("{} frames are the same; then {first}", other.diff.equal_frames),
    });
    let error = |evaluation: Option<&Evaluation>, f: fn(&Evaluation) -> f64| {
        evaluation.map_or("none".to_owned(), |evaluation| format!("{:.5}", f(evaluation)))
    };
    let both = |name: &str, f: fn(&Evaluation) -> f64| {
        let values = [story.evaluation.as_ref(), other.evaluation.as_ref()].map(|evaluation| error(evaluation, f));
        std::iter::once(name.to_owned()).chain(values).collect::<Vec<_>>()
    };
    let count = |name: &str, f: fn(&RunSummary) -> String| vec![name.to_owned(), f(&story.summary), f(&other.summary)];
    let rows = [
        both("ATE RMSE, m", |e| e.ate_m.rmse),
        both("ATE largest, m", |e| e.ate_m.max),
        both("ATE orientation RMSE, degrees", |e| e.ate_rotation_deg.rmse),
        both("scale", |e| e.scale),
        count("frames in the trajectory", |s| format!("{} of {}", s.result.in_trajectory, s.result.frames)),
        count("keyframes", |s| s.result.keyframes.to_string()),
        count("map points", |s| s.result.map_points.to_string()),
        count("map points on things", |s| s.result.map_points_on_things.to_string()),
        count("map points on unknown areas", |s| s.result.map_points_on_unknown.to_string()),
        count("warnings", |s| s.result.warnings.to_string()),
        count("tracking, mean ms a frame", |s| format!("{:.2}", s.timing.tracking_ms())),
        count("fingerprint", |s| s.fingerprint.clone()),
    ];
    page.table("Side by side", &["", &story.name, &other.name], &rows);
    let header = other.diff.header.iter().map(|difference| {
        let [a, b] = difference.values.clone();
        vec![difference.field.clone(), a, b]
    });
    let header: Vec<Vec<String>> = header.collect();
    if header.is_empty() {
        page.paragraph("Both were made from the same log with the same configuration.");
    } else {
        page.table("Made from", &["what", &story.name, &other.name], &header);
    }
}

pub fn configuration(page: &mut Page, story: &Story) {
    page.section("configuration", "Configuration");
    let config = &story.summary.header.config;
    let differences = config_differences(&Config::default().to_toml(), config);
    if differences.is_empty() {
        page.paragraph("The defaults of this program.");
    } else {
        let rows = differences.into_iter().map(|(key, default, here)| vec![key, default, here]);
        page.table("Keys that differ from the default", &["key", "default", "here"], &rows.collect::<Vec<_>>());
    }
    page.raw(format_args!("<details><summary>All keys</summary><pre>{}</pre></details>", escape_lines(config)));
}

/// Text with its lines.
fn escape_lines(text: &str) -> String {
    text.lines().map(escape).collect::<Vec<_>>().join("\n")
}

pub fn manifest(page: &mut Page, story: &Story) {
    page.section("manifest", "Manifest");
    let RunSummary { fingerprint, header, result, log, config_name, .. } = &story.summary;
    let file = log.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let rows = [
        ("fingerprint", fingerprint.clone()),
        ("program", header.program.clone()),
        ("log", file),
        ("BLAKE3 of the log", header.log_blake3.clone()),
        ("frames of the log", format!("{}..{}", header.frames.start, header.frames.end)),
        ("segmentation layer", header.layer.clone().unwrap_or_else(|| "none".to_owned())),
        ("sensor", result.sensor.clone()),
        ("configuration", config_name.clone()),
        ("xxh3-128 of the configuration", digest_of(header.config.as_bytes()).to_string()),
        ("this page by", crate::run::PROGRAM.to_owned()),
    ];
    let rows: Vec<Vec<String>> = rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect();
    page.table("Same log, configuration and program give the same fingerprint", &["what", "value"], &rows);
    page.paragraph("pslam verify RUN proves it on any machine.");
}
