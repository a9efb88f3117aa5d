//! What stands on the page, in order.

mod depth;
mod errors;
mod frames;
mod manifest;
mod tracking;

use slam::report::Verdict;

use super::html::{Page, escape};
use super::moments::Seen;
use super::rows::lost;
use super::{ReportError, Story};
use crate::plot::trajectories::length;

/// The whole document.
pub fn page(story: &Story) -> Result<String, ReportError> {
    let mut page = Page::default();
    errors::path(&mut page, story);
    errors::errors(&mut page, story);
    tracking::tracking(&mut page, story);
    tracking::filter(&mut page, story);
    tracking::map(&mut page, story);
    depth::depth(&mut page, story);
    tracking::times(&mut page, story);
    frames::frames(&mut page, story)?;
    if let Some(other) = &story.other {
        manifest::comparison(&mut page, story, other);
    }
    manifest::configuration(&mut page, story);
    manifest::manifest(&mut page, story);
    Ok(page.finish(&format!("Run {}", story.name), &header(story)))
}

/// Name, the numbers to know first, and notices.
fn header(story: &Story) -> String {
    let log = story.summary.log.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut text = format!(
        "<h1>Run {}</h1>\n<p class=\"sub\">{} · {} · configuration {} · layer {}</p>\n<dl class=\"tiles\">",
        escape(&story.name),
        escape(&log),
        escape(&story.summary.result.sensor),
        escape(&story.summary.config_name),
        escape(story.summary.header.layer.as_deref().unwrap_or("none")),
    );
    for (name, value, more) in tiles(story) {
        text.push_str(&format!(
            "<div><dt>{}</dt><dd>{}<small>{}</small></dd></div>",
            escape(name),
            escape(&value),
            escape(&more)
        ));
    }
    text.push_str("</dl>\n");
    for notice in &story.notices {
        text.push_str(&format!("<p class=\"notice\">{}</p>\n", escape(notice)));
    }
    text
}

fn tiles(story: &Story) -> Vec<(&'static str, String, String)> {
    let result = &story.summary.result;
    let mut tiles = Vec::new();
    if let Some(evaluation) = &story.evaluation {
        let aligned = match evaluation.alignment {
            crate::eval::Alignment::Sim3 => format!("after Sim3 alignment, scale {:.4}", evaluation.scale),
            alignment => format!("after {alignment} alignment"),
        };
        tiles.push(("ATE RMSE", length(evaluation.ate_m.rmse), aligned));
        let second = evaluation.rpe.iter().find(|rpe| rpe.options.to_string() == "RPE 1 s");
        if let Some(statistics) = second.and_then(|rpe| rpe.translation_m.as_ref()) {
            tiles.push(("RPE over 1 s", length(statistics.rmse), format!("{} pairs", statistics.count)));
        }
        tiles.push(("True path", length(evaluation.true_length_m), format!("{} paired poses", evaluation.pairs)));
    }
    let share = percent(result.in_trajectory as f64, result.frames as f64);
    let more = format!("{} of {} frames", result.in_trajectory, result.frames);
    tiles.push(("In the trajectory", share, more));
    if let Some(row) = story.rows.last() {
        tiles.push(("Duration", format!("{:.1} s", row.at_s), format!("{} frames", story.rows.len())));
    }
    let more = format!("{} keyframes, {} points on things", result.keyframes, result.map_points_on_things);
    tiles.push(("Map", format!("{} points", result.map_points), more));
    if let Some(seen) = &story.seen {
        let [moving, all] = moving_share(seen);
        tiles.push(("Moving keypoints", percent(moving, all), "filtered as seen moving".to_owned()));
    }
    tiles
}

/// Keypoints judged as moving, and all of them.
fn moving_share(seen: &Seen) -> [f64; 2] {
    let total =
        |verdict: Verdict| seen.verdicts.iter().fold(0.0, |sum, frame| sum + f64::from(frame[verdict as usize]));
    let sum = |wanted: fn(&Verdict) -> bool| Verdict::ALL.into_iter().filter(wanted).fold(0.0, |sum, v| sum + total(v));
    [sum(|verdict| verdict.is_dynamic()), sum(|_| true)]
}

fn percent(part: f64, whole: f64) -> String {
    if whole > 0.0 { format!("{:.1} %", 100.0 * part / whole) } else { "none".to_owned() }
}

/// Stretches without a pose as seconds; each reaches to the frames around it.
fn lost_bands(story: &Story) -> Vec<(f64, f64)> {
    let rows = &story.rows;
    let at = |frame: usize| rows[frame.min(rows.len() - 1)].at_s;
    lost(rows).into_iter().map(|(from, to)| (at(from.saturating_sub(1)), at(to))).collect()
}

/// End of every time axis.
fn end_s(story: &Story) -> f64 {
    story.rows.last().map_or(0.0, |row| row.at_s)
}
