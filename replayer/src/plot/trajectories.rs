//! Trajectories seen from their flat side, the third axis over time, and the error over time.

use schemas::Stamp;
use slam_math::float::{max, min};

use super::axis::{Axis, Scale};
use super::panel::Panel;
use super::svg::{Anchor, Svg};
use super::theme::PAPER;
use crate::eval::{ErrorSample, Evaluation, StampedPose, Trajectory};

/// One estimate to draw.
#[derive(Debug, Clone, Copy)]
pub struct PlotEstimate<'a> {
    /// Name in the legend.
    pub name: &'a str,
    /// Poses in the world of the truth.
    pub aligned: &'a Trajectory,
    /// Errors of the paired poses.
    pub samples: &'a [ErrorSample],
    /// Absolute trajectory error, metres.
    pub ate_rmse_m: f64,
}

impl<'a> PlotEstimate<'a> {
    /// An evaluated estimate.
    #[must_use]
    pub fn new(name: &'a str, evaluation: &'a Evaluation) -> Self {
        let Evaluation { aligned, samples, ate_m, .. } = evaluation;
        Self { name, aligned, samples, ate_rmse_m: ate_m.rmse }
    }
}

const WIDTH: f64 = 1280.0;
const HEIGHT: f64 = 760.0;
/// Left, right, top, bottom of the plan; the other two panels stand right of it.
const PLAN: [f64; 4] = [80.0, 640.0, 130.0, 690.0];
const SIDE: [f64; 2] = [740.0, 1250.0];
const TRUTH: &str = PAPER.truth;
/// Okabe and Ito's colours: told apart by colour-blind readers too.
const COLORS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];
/// Errors below this are drawn as this on a logarithmic axis.
const SMALLEST_ERROR_M: f64 = 1e-4;

/// The plot as SVG text. Lines are broken, and the error's ground tinted, where an estimate has no pose.
#[must_use]
pub fn trajectories_svg(title: &str, truth: &Trajectory, estimates: &[PlotEstimate<'_>]) -> String {
    let span = time_span(truth, estimates);
    let shown: Vec<StampedPose> =
        truth.poses.iter().filter(|p| span.0 <= p.stamp && p.stamp <= span.1).copied().collect();
    let truth = Trajectory { poses: shown };
    let all = || std::iter::once(&truth).chain(estimates.iter().map(|e| e.aligned));
    let ranges: [(f64, f64); 3] = std::array::from_fn(|axis| range(all(), axis));
    let (across, up, side) = views(&ranges);

    let mut svg = Svg::file(WIDTH, HEIGHT);
    svg.text((PLAN[0], 40.0), Anchor::Start, "fill=\"#111111\" font-size=\"20\" font-weight=\"bold\"", title);
    legend(&mut svg, !truth.poses.is_empty(), estimates);
    let clock = Clock { start: span.0 };
    plan(&mut svg, (across, up), &ranges, &truth, estimates);
    let time = Axis::linear(0.0, clock.seconds(span.1), (SIDE[0], SIDE[1]));
    elevation(&mut svg, side, ranges[side], &clock, time, &truth, estimates);
    errors(&mut svg, &clock, time, estimates);
    svg.finish()
}

/// The axes to draw: the two longest make the plan (across, up) in their own order, the shortest is left for the side.
pub(crate) fn views(ranges: &[(f64, f64); 3]) -> (usize, usize, usize) {
    let extent = |axis: usize| ranges[axis].1 - ranges[axis].0;
    let side = (0..3).fold(0, |least, axis| if extent(axis) <= extent(least) { axis } else { least });
    let (across, up) = [(1, 2), (0, 2), (0, 1)][side];
    (across, up, side)
}

/// Seconds since the first estimated pose.
struct Clock {
    start: Stamp,
}

impl Clock {
    fn seconds(&self, stamp: Stamp) -> f64 {
        (i128::from(stamp.0) - i128::from(self.start.0)) as f64 / 1e9
    }
}

/// From the first to the last estimated pose; of the truth, when nothing is estimated.
fn time_span(truth: &Trajectory, estimates: &[PlotEstimate<'_>]) -> (Stamp, Stamp) {
    let stamps = || estimates.iter().flat_map(|e| e.aligned.poses.iter()).map(|p| p.stamp);
    let of_truth = || truth.poses.iter().map(|p| p.stamp);
    let first = stamps().min().or_else(|| of_truth().min()).unwrap_or_default();
    (first, stamps().max().or_else(|| of_truth().max()).unwrap_or_default())
}

/// Least and greatest coordinate on an axis; 0 without poses.
pub(crate) fn range<'a>(trajectories: impl Iterator<Item = &'a Trajectory>, axis: usize) -> (f64, f64) {
    let values = trajectories.flat_map(|t| t.poses.iter()).map(|p| p.world_from_camera.translation[axis]);
    let found = values.fold(None, |range: Option<(f64, f64)>, v| {
        Some(range.map_or((v, v), |(least, most)| (min(least, v), max(most, v))))
    });
    found.unwrap_or((0.0, 0.0))
}

/// Values pose by pose, cut where poses are missing.
pub(crate) fn runs(poses: &[StampedPose], value: impl Fn(&StampedPose) -> (f64, f64)) -> Vec<Vec<(f64, f64)>> {
    let limit = gap_limit_ns(poses);
    let cut = poses.chunk_by(|a, b| b.stamp.abs_diff(a.stamp) <= limit);
    cut.map(|run| run.iter().map(&value).collect()).collect()
}

/// A longer step than this, three times the median, is a gap; nanoseconds.
pub(crate) fn gap_limit_ns(poses: &[StampedPose]) -> u64 {
    let mut steps: Vec<u64> = poses.windows(2).map(|pair| pair[1].stamp.abs_diff(pair[0].stamp)).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() { 0 } else { steps.select_nth_unstable(middle).1.saturating_mul(3) }
}

/// Stretches without a pose: index of the estimate, from, to (seconds).
fn gaps(index: usize, estimate: &PlotEstimate<'_>, clock: &Clock) -> Vec<(usize, f64, f64)> {
    let poses = &estimate.aligned.poses;
    let limit = gap_limit_ns(poses);
    let wide = poses.windows(2).filter(|pair| pair[1].stamp.abs_diff(pair[0].stamp) > limit);
    wide.map(|pair| (index, clock.seconds(pair[0].stamp), clock.seconds(pair[1].stamp))).collect()
}

fn color(index: usize) -> &'static str {
    COLORS[index % COLORS.len()]
}

fn legend(svg: &mut Svg, has_truth: bool, estimates: &[PlotEstimate<'_>]) {
    let mut entries: Vec<(String, &str, f64)> = Vec::new();
    if has_truth {
        entries.push(("ground truth".to_owned(), TRUTH, 5.0));
    }
    for (index, estimate) in estimates.iter().enumerate() {
        entries.push((format!("{}: ATE {}", estimate.name, length(estimate.ate_rmse_m)), color(index), 2.2));
    }
    let (mut x, mut y) = (PLAN[0], 70.0);
    for (text, color, width) in entries {
        let room = 50.0 + text.chars().count() as f64 * 7.3;
        if x + room > WIDTH && x > PLAN[0] {
            (x, y) = (PLAN[0], y + 20.0);
        }
        svg.line([x, y - 4.0, x + 26.0, y - 4.0], color, width);
        svg.text((x + 34.0, y), Anchor::Start, "fill=\"#333333\"", &text);
        x += room;
    }
}

/// A length with three digits in a fitting unit.
pub(crate) fn length(metres: f64) -> String {
    match metres {
        m if m < 0.01 => format!("{:.2} mm", m * 1e3),
        m if m < 1.0 => format!("{:.2} cm", m * 1e2),
        m => format!("{m:.2} m"),
    }
}

fn plan(
    svg: &mut Svg,
    (across, up): (usize, usize),
    ranges: &[(f64, f64); 3],
    truth: &Trajectory,
    estimates: &[PlotEstimate<'_>],
) {
    let [left, right, top, bottom] = PLAN;
    // One scale for both axes, or the shape would lie; some air around.
    let extent = |axis: usize| (ranges[axis].1 - ranges[axis].0) * 1.12;
    let metres_per_pixel = max(max(extent(across) / (right - left), extent(up) / (bottom - top)), 1e-6);
    let around = |axis: usize, pixels: f64| {
        let (middle, half) = ((ranges[axis].0 + ranges[axis].1) / 2.0, pixels * metres_per_pixel / 2.0);
        (middle - half, middle + half)
    };
    let (x, y) = (around(across, right - left), around(up, bottom - top));
    let panel = Panel {
        id: "plan".to_owned(),
        title: format!("Path in the {}{} plane", AXES[across], AXES[up]),
        x_label: format!("{} [m]", AXES[across]),
        y_label: format!("{} [m]", AXES[up]),
        x: Axis::linear(x.0, x.1, (left, right)),
        y: Axis::linear(y.0, y.1, (bottom, top)),
    };
    let value = |p: &StampedPose| (p.world_from_camera.translation[across], p.world_from_camera.translation[up]);
    panel.begin(svg);
    panel.curve(svg, &runs(&truth.poses, value), TRUTH, 5.0);
    for (index, estimate) in estimates.iter().enumerate() {
        panel.curve(svg, &runs(&estimate.aligned.poses, value), color(index), 1.8);
    }
    let marked = if truth.poses.is_empty() { estimates.first().map(|e| e.aligned) } else { Some(truth) };
    if let Some((first, last)) = marked.and_then(|t| t.poses.first().zip(t.poses.last())) {
        for (pose, fill, name) in [(first, "#ffffff", "start"), (last, "#444444", "end")] {
            let at = panel.pixel(value(pose));
            svg.circle(at, 5.0, fill, "#444444");
            svg.text_on_curves((at.0, at.1 - 12.0), Anchor::Middle, name);
        }
    }
    panel.end(svg);
}

fn elevation(
    svg: &mut Svg,
    axis: usize,
    range: (f64, f64),
    clock: &Clock,
    time: Axis,
    truth: &Trajectory,
    estimates: &[PlotEstimate<'_>],
) {
    let pad = (range.1 - range.0) * 0.08;
    let panel = Panel {
        id: "elevation".to_owned(),
        title: format!("{} over time", AXES[axis]),
        x_label: "time [s]".to_owned(),
        y_label: format!("{} [m]", AXES[axis]),
        x: time,
        y: Axis::linear(range.0 - pad, range.1 + pad, (350.0, PLAN[2])),
    };
    let value = |p: &StampedPose| (clock.seconds(p.stamp), p.world_from_camera.translation[axis]);
    panel.begin(svg);
    panel.curve(svg, &runs(&truth.poses, value), TRUTH, 5.0);
    for (index, estimate) in estimates.iter().enumerate() {
        panel.curve(svg, &runs(&estimate.aligned.poses, value), color(index), 1.8);
    }
    panel.end(svg);
}

fn errors(svg: &mut Svg, clock: &Clock, time: Axis, estimates: &[PlotEstimate<'_>]) {
    let (y, unit, metres) = error_axis(estimates);
    let gaps: Vec<(usize, f64, f64)> = (0..).zip(estimates).flat_map(|(index, e)| gaps(index, e, clock)).collect();
    let panel = Panel {
        id: "error".to_owned(),
        title: format!("Position error over time{}", if gaps.is_empty() { "" } else { " (tinted: no pose)" }),
        x_label: "time [s]".to_owned(),
        y_label: format!("error{unit}"),
        x: time,
        y,
    };
    panel.begin(svg);
    for (index, from, to) in gaps {
        panel.band(svg, from, to, color(index));
    }
    for (index, estimate) in estimates.iter().enumerate() {
        let limit = gap_limit_ns(&estimate.aligned.poses);
        let cut = estimate.samples.chunk_by(|a, b| b.stamp.abs_diff(a.stamp) <= limit);
        let value = |s: &ErrorSample| (clock.seconds(s.stamp), s.translation_m / metres);
        let runs: Vec<Vec<_>> = cut.map(|run| run.iter().map(value).collect()).collect();
        panel.curve(svg, &runs, color(index), 1.8);
    }
    panel.end(svg);
}

/// Axis, unit and its metres. Logarithmic when estimates differ so much that the better one would lie on the ground.
fn error_axis(estimates: &[PlotEstimate<'_>]) -> (Axis, &'static str, f64) {
    let pixels = (PLAN[3], 450.0);
    let errors = || estimates.iter().flat_map(|e| e.samples.iter()).map(|s| s.translation_m);
    let largest = errors().fold(SMALLEST_ERROR_M, max);
    let worst = estimates.iter().fold(0.0, |most, e| max(most, e.ate_rmse_m));
    let best = estimates.iter().fold(f64::INFINITY, |least, e| min(least, e.ate_rmse_m));
    if estimates.len() > 1 && worst > best * 8.0 {
        let smallest = max(errors().fold(f64::INFINITY, min), SMALLEST_ERROR_M);
        let values = (min(smallest * 0.9, 1e-3), largest * 1.2);
        return (Axis { scale: Scale::Log, values, pixels }, "", 1.0);
    }
    let (unit, metres) = match largest {
        m if m < 0.02 => (" [mm]", 1e-3),
        m if m < 1.0 => (" [cm]", 1e-2),
        _ => (" [m]", 1.0),
    };
    (Axis::linear(0.0, largest * 1.08 / metres, pixels), unit, metres)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::{EvalOptions, evaluate};
    use nalgebra::{Vector3, Vector6};
    use slam_math::Se3;

    fn circle(n: i64) -> Trajectory {
        let pose = |i: i64| {
            let turn = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, i as f64 * 0.1));
            let translation = turn.rotation * Vector3::new(2.0, 0.0, 0.1 * i as f64 / n as f64);
            StampedPose { stamp: Stamp(i * 50_000_000), world_from_camera: Se3 { translation, ..turn } }
        };
        Trajectory { poses: (0..n).map(pose).collect() }
    }

    #[test]
    fn every_estimate_is_drawn_and_gaps_stay_open() {
        let truth = circle(60);
        let mut lost = truth.clone();
        lost.poses.drain(20..35);
        let evaluation = evaluate(&truth, &lost, None, &EvalOptions::default()).unwrap();
        let estimates = [PlotEstimate::new("full", &evaluation), PlotEstimate::new("a<b", &evaluation)];
        let svg = trajectories_svg("Test & more", &truth, &estimates);
        // Truth in one piece in two panels; each estimate in two pieces in three.
        assert_eq!(svg.matches("<polyline").count(), 2 + 2 * 2 * 3);
        assert_eq!(svg.matches("fill-opacity=\"0.13\"").count(), 2);
        assert!(svg.contains("a&lt;b: ATE") && svg.contains("Test &amp; more") && svg.contains("xy plane"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg, trajectories_svg("Test & more", &truth, &estimates));
    }

    #[test]
    fn nothing_and_a_single_pose_are_drawable() {
        for n in [0, 1] {
            let svg = trajectories_svg("", &circle(n), &[]);
            assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"));
        }
    }

    #[test]
    fn very_different_errors_get_a_logarithmic_axis() {
        let truth = circle(60);
        let estimate = |ate_rmse_m| PlotEstimate { name: "", aligned: &truth, samples: &[], ate_rmse_m };
        assert_eq!(error_axis(&[estimate(0.01), estimate(0.3)]).0.scale, Scale::Log);
        assert_eq!(error_axis(&[estimate(0.01), estimate(0.02)]).0.scale, Scale::Linear);
    }
}
