//! Where the camera was, and how wrong that is.

use schemas::Stamp;

use super::super::chart::{Chart, Series};
use super::super::html::Page;
use super::super::path::Paths;
use super::super::{Other, Story};
use super::{end_s, lost_bands};
use crate::eval::{ErrorSample, Evaluation, Statistics};
use crate::plot::trajectories::gap_limit_ns;

pub fn path(page: &mut Page, story: &Story) {
    page.section("path", "Path");
    if story.estimate.poses.is_empty() {
        page.paragraph("No frame has a pose: there is no path to draw.");
        return;
    }
    // Without the truth two runs have no common frame.
    let aligned = |other: &'_ Other| other.evaluation.is_some() && story.evaluation.is_some();
    let other = story.other.as_ref().filter(|other| aligned(other));
    let paths = Paths {
        truth: &story.truth,
        estimate: story.evaluation.as_ref().map_or(&story.estimate, |evaluation| &evaluation.aligned),
        evaluation: story.evaluation.as_ref(),
        other: other.and_then(|other| Some((other.name.as_str(), &other.evaluation.as_ref()?.aligned))),
        unit: unit(story),
    };
    // Truth before and after the run would make the run small.
    let around = paths.estimate.poses.first().zip(paths.estimate.poses.last()).map(|(a, b)| (a.stamp, b.stamp));
    let within = |stamp: Stamp| around.is_some_and(|(first, last)| first <= stamp && stamp <= last);
    let poses = story.truth.poses.iter().filter(|pose| within(pose.stamp)).copied().collect();
    page.raw(Paths { truth: &crate::eval::Trajectory { poses }, ..paths }.html());
    let of_other_maps =
        story.summary.result.tracked - story.summary.result.in_trajectory.min(story.summary.result.tracked);
    if of_other_maps > 0 {
        page.paragraph(&format!(
            "{of_other_maps} more frames have poses in other maps, which have no common frame with this path."
        ));
    }
}

/// What lengths are in.
fn unit(story: &Story) -> &'static str {
    let has_no_scale = story.summary.result.sensor == slam::Sensor::Monocular.name();
    if has_no_scale && story.evaluation.is_none() { "map units" } else { "m" }
}

pub fn errors(page: &mut Page, story: &Story) {
    page.section("errors", "Errors");
    let Some(evaluation) = &story.evaluation else {
        page.paragraph("Nothing to compare the path with: see the notices at the top.");
        return;
    };
    let chart = |id, title, label, unit, series| Chart {
        id,
        title,
        label,
        unit,
        series,
        stacked: false,
        lost: &[],
        marks: Vec::new(),
        end_s: end_s(story),
    };
    let lost = lost_bands(story);
    let others = [story.other.as_ref().and_then(|other| other.evaluation.as_ref()), story.online.as_ref()];
    let (label, unit, per_metre) = scale(evaluation, others);
    let mut position = vec![curve(story, &story.name, "var(--s1)", evaluation, |s| s.translation_m * per_metre)];
    if let Some(other) = &story.other
        && let Some(of_other) = &other.evaluation
    {
        position.push(curve(story, &other.name, "var(--s3)", of_other, |s| s.translation_m * per_metre));
    }
    if let Some(online) = &story.online {
        position.push(curve(story, ONLINE, "var(--s2)", online, |s| s.translation_m * per_metre));
    }
    let figure = Chart { lost: &lost, ..chart("position", "Position error", label, unit, position) };
    page.raw(figure.html());
    let axes = [("x", "var(--s1)"), ("y", "var(--s2)"), ("z", "var(--s3)")].into_iter().enumerate();
    let axes = axes
        .map(|(axis, (name, color))| curve(story, name, color, evaluation, move |s| s.difference_m[axis] * per_metre));
    let title = "Position error along the axes of the ground truth's world (estimate minus truth)";
    page.raw(Chart { lost: &lost, ..chart("axes", title, label, unit, axes.collect()) }.html());
    let rotation = vec![curve(story, "angle", "var(--s4)", evaluation, |s| s.rotation_deg)];
    let figure = chart("rotation", "Orientation error", "error [degrees]", "°", rotation);
    page.raw(Chart { lost: &lost, ..figure }.html());
    let colors = ["var(--s1)", "var(--s2)", "var(--s3)"].into_iter().cycle();
    let relative = evaluation.rpe.iter().zip(colors).filter(|(rpe, _)| !rpe.samples.is_empty());
    let relative = relative.map(|(rpe, color)| {
        let values = rpe.samples.iter().map(|(stamp, error)| (seconds(story, *stamp), error * per_metre));
        Series::new(&rpe.options.to_string(), color, values)
    });
    let title = "Relative pose error, at the end of each stretch";
    page.raw(chart("relative", title, label, unit, relative.collect()).html());
    table(page, evaluation, story.online.as_ref());
}

/// What poses are called that no later frame has changed.
const ONLINE: &str = "as known at each frame";

/// The unit in which the largest error reads well.
fn scale(evaluation: &Evaluation, others: [Option<&Evaluation>; 2]) -> (&'static str, &'static str, f64) {
    let of_others = others.into_iter().flatten().map(|e| e.ate_m.max);
    match of_others.fold(evaluation.ate_m.max, slam_math::float::max) {
        m if m < 0.02 => ("error [mm]", " mm", 1e3),
        m if m < 1.0 => ("error [cm]", " cm", 1e2),
        _ => ("error [m]", " m", 1.0),
    }
}

fn seconds(story: &Story, stamp: Stamp) -> f64 {
    let first = story.rows.first().map_or(0, |row| row.stamp.0);
    (i128::from(stamp.0) - i128::from(first)) as f64 / 1e9
}

/// A value a pair; cut where poses are missing.
fn curve(
    story: &Story,
    name: &str,
    color: &'static str,
    evaluation: &Evaluation,
    value: impl Fn(&ErrorSample) -> f64,
) -> Series {
    let limit = gap_limit_ns(&evaluation.aligned.poses);
    let mut values = Vec::with_capacity(evaluation.samples.len());
    let mut before: Option<Stamp> = None;
    for sample in &evaluation.samples {
        if let Some(before) = before.filter(|before| sample.stamp.abs_diff(*before) > limit) {
            values.push((seconds(story, before) + limit as f64 / 1e9, f64::NAN));
        }
        values.push((seconds(story, sample.stamp), value(sample)));
        before = Some(sample.stamp);
    }
    Series { name: name.to_owned(), color, values }
}

fn table(page: &mut Page, evaluation: &Evaluation, online: Option<&Evaluation>) {
    let cells = |name: String, unit: &str, statistics: Option<&Statistics>| {
        let mut row = vec![name, unit.to_owned()];
        match statistics {
            Some(s) => {
                row.extend([s.rmse, s.mean, s.median, s.std, s.min, s.max].map(|value| format!("{value:.5}")));
                row.push(s.count.to_string());
            }
            None => row.push("no such pair: the path is too short".to_owned()),
        }
        row
    };
    let mut rows = vec![
        cells("ATE".to_owned(), "m", Some(&evaluation.ate_m)),
        cells("ATE, orientation".to_owned(), "degrees", Some(&evaluation.ate_rotation_deg)),
    ];
    if let Some(online) = online {
        rows.insert(1, cells(format!("ATE, {ONLINE}"), "m", Some(&online.ate_m)));
    }
    for rpe in &evaluation.rpe {
        rows.push(cells(rpe.options.to_string(), "m", rpe.translation_m.as_ref()));
        rows.push(cells(format!("{}, orientation", rpe.options), "degrees", rpe.rotation_deg.as_ref()));
    }
    let head = ["error", "unit", "RMSE", "mean", "median", "std", "min", "max", "pairs"];
    page.table("Errors as pslam eval prints them", &head, &rows);
    let axes = ["x", "y", "z"].iter().zip(&evaluation.axes_m).map(|(name, axis)| {
        let values =
            [axis.rmse, axis.mean, axis.max_abs].map(|v| format!("{:.5}", if v.abs() < 5e-6 { 0.0 } else { v }));
        std::iter::once((*name).to_owned()).chain(values).collect()
    });
    page.table("ATE by axis, metres", &["axis", "RMSE", "mean", "largest"], &axes.collect::<Vec<_>>());
}
