//! The camera's path from above and from the side, as an engineer draws it: one scale, the side below the plan.

use slam_math::float::{max, min};

use super::html::{Key, escape, legend};
use crate::eval::{Evaluation, StampedPose, Trajectory};
use crate::plot::axis::Axis;
use crate::plot::panel::Panel;
use crate::plot::svg::{Anchor, Svg};
use crate::plot::trajectories::{AXES, gap_limit_ns, length, range, runs, views};

const WIDTH: f64 = 920.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 905.0;
/// Heights of the two views, pixels: what their extents need, within limits.
const PLAN_HEIGHT: (f64, f64) = (180.0, 560.0);
const SIDE_HEIGHT: (f64, f64) = (90.0, 300.0);
/// From the end of one view to the next: room for numbers and a title.
const BETWEEN: f64 = 74.0;
/// Small to large errors; told apart by colour-blind readers, and seen on white and on black.
const ERRORS: [&str; 5] = ["#5b4fd6", "#9a3fc0", "#d0498e", "#f0755a", "#e8a317"];

/// What is drawn.
pub struct Paths<'a> {
    pub truth: &'a Trajectory,
    /// The estimate, in the world of the truth if there is one.
    pub estimate: &'a Trajectory,
    pub evaluation: Option<&'a Evaluation>,
    /// Another run, with its name.
    pub other: Option<(&'a str, &'a Trajectory)>,
    /// `m`, or what stands for it.
    pub unit: &'a str,
}

impl Paths<'_> {
    /// The figure.
    pub fn html(&self) -> String {
        let mut keys: Vec<Key> = Vec::new();
        let mut key = |name: String, color: &str| keys.push(Key { name, color: color.to_owned() });
        if !self.truth.poses.is_empty() {
            key("ground truth".to_owned(), "var(--truth)");
        }
        match self.evaluation {
            Some(evaluation) => {
                if evaluation.pairs < evaluation.estimated_poses {
                    key("estimate without truth".to_owned(), "var(--ink)");
                }
                let step = evaluation.ate_m.max / ERRORS.len() as f64;
                for (i, color) in ERRORS.iter().enumerate() {
                    key(format!("error up to {}", length(step * (i + 1) as f64)), color);
                }
            }
            None => key("estimate".to_owned(), "var(--s1)"),
        }
        if let Some((name, _)) = self.other {
            key(name.to_owned(), "var(--s3)");
        }
        format!(
            "<figure><figcaption>{}</figcaption>{}<div class=\"plot\">{}</div></figure>",
            escape("Path in plan and elevation; dotted: no pose in between"),
            legend(&keys),
            self.svg()
        )
    }

    fn svg(&self) -> String {
        let all = || {
            let other = self.other.map(|(_, path)| path);
            [Some(self.truth), Some(self.estimate), other].into_iter().flatten()
        };
        let ranges: [(f64, f64); 3] = std::array::from_fn(|axis| range(all(), axis));
        let (across, up, side) = views(&ranges);
        let extent = |axis: usize| max((ranges[axis].1 - ranges[axis].0) * 1.12, 1e-3);
        // One scale for all, as small as the tallest view needs.
        let per_pixel = max(extent(across) / (RIGHT - LEFT), extent(up) / PLAN_HEIGHT.1);
        let per_pixel = max(per_pixel, extent(side) / SIDE_HEIGHT.1);
        let height = |axis: usize, (least, most)| min(max(extent(axis) / per_pixel, least), most);
        let (plan_height, side_height) = (height(up, PLAN_HEIGHT), height(side, SIDE_HEIGHT));
        let plan_bottom = 30.0 + plan_height;
        let side_bottom = plan_bottom + BETWEEN + side_height;
        let around = |axis: usize, pixels: f64| {
            let (middle, half) = ((ranges[axis].0 + ranges[axis].1) / 2.0, pixels * per_pixel / 2.0);
            (middle - half, middle + half)
        };
        let alt = format!(
            "Camera path in the {0}{1} plane and, below, in the {0}{2} plane; {3} poses",
            AXES[across],
            AXES[up],
            AXES[side],
            self.estimate.poses.len()
        );
        let mut svg = Svg::inline(WIDTH, side_bottom + 48.0, &alt);
        for (id, name, vertical, top, bottom) in [
            ("plan", "Plan", up, 30.0, plan_bottom),
            ("side", "Elevation", side, side_bottom - side_height, side_bottom),
        ] {
            let (x, y) = (around(across, RIGHT - LEFT), around(vertical, bottom - top));
            let panel = Panel {
                id: format!("clip-{id}"),
                title: format!("{name}: {}{} plane", AXES[across], AXES[vertical]),
                x_label: format!("{} [{}]", AXES[across], self.unit),
                y_label: format!("{} [{}]", AXES[vertical], self.unit),
                x: Axis::linear(x.0, x.1, (LEFT, RIGHT)),
                y: Axis::linear(y.0, y.1, (bottom, top)),
            };
            self.view(&panel, &mut svg, across, vertical);
        }
        svg.finish()
    }

    fn view(&self, panel: &Panel, svg: &mut Svg, across: usize, up: usize) {
        let value = |p: &StampedPose| (p.world_from_camera.translation[across], p.world_from_camera.translation[up]);
        panel.begin(svg);
        let theme = svg.theme();
        panel.curve(svg, &runs(&self.truth.poses, value), theme.truth, 5.0);
        if let Some((_, other)) = self.other {
            panel.curve(svg, &runs(&other.poses, value), "var(--s3)", 1.5);
        }
        let poses = &self.estimate.poses;
        let limit = gap_limit_ns(poses);
        for pair in poses.windows(2).filter(|pair| pair[1].stamp.abs_diff(pair[0].stamp) > limit) {
            let ((x1, y1), (x2, y2)) = (panel.pixel(value(&pair[0])), panel.pixel(value(&pair[1])));
            svg.dashes([x1, y1, x2, y2], "var(--s2)");
        }
        match self.evaluation {
            None => panel.curve(svg, &runs(poses, value), "var(--s1)", 2.2),
            Some(evaluation) => {
                // What has no truth beside it shows from below.
                panel.curve(svg, &runs(poses, value), theme.ink, 1.0);
                for (level, color) in ERRORS.iter().enumerate() {
                    panel.curve(svg, &self.pieces(evaluation, level, limit, value), color, 2.6);
                }
            }
        }
        if let (Some(first), Some(last)) = (poses.first(), poses.last()) {
            for (pose, fill, name, drop) in [(first, theme.ground, "start", -11.0), (last, theme.ink, "end", 21.0)] {
                let (x, y) = panel.pixel(value(pose));
                svg.circle((x, y), 5.0, fill, theme.ink);
                // Within the view, whichever edge the pose stands at.
                let (bottom, top) = panel.y.pixels;
                let drop = if y + drop > bottom - 3.0 || y + drop < top + 10.0 { 10.0 - drop } else { drop };
                svg.text_on_curves((x, y + drop), Anchor::Middle, name);
            }
        }
        panel.end(svg);
    }

    /// Stretches of the estimate whose error falls into a level; each reaches to the pose after it.
    fn pieces(
        &self,
        evaluation: &Evaluation,
        level: usize,
        limit: u64,
        value: impl Fn(&StampedPose) -> (f64, f64),
    ) -> Vec<Vec<(f64, f64)>> {
        let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
        let mut open = false;
        let mut before: Option<&StampedPose> = None;
        for pose in &self.estimate.poses {
            let sample = evaluation.samples.binary_search_by_key(&pose.stamp, |s| s.stamp).ok();
            let here =
                sample.is_some_and(|i| level_of(evaluation.samples[i].translation_m, evaluation.ate_m.max) == level);
            let joined = before.filter(|before| pose.stamp.abs_diff(before.stamp) <= limit);
            match (here, open, joined) {
                (true, true, Some(_)) => pieces.last_mut().into_iter().for_each(|piece| piece.push(value(pose))),
                (true, _, joined) => pieces.push(joined.into_iter().chain([pose]).map(&value).collect()),
                _ => {}
            }
            (open, before) = (here, Some(pose));
        }
        pieces
    }
}

fn level_of(error: f64, largest: f64) -> usize {
    ((error / max(largest, 1e-12) * ERRORS.len() as f64) as usize).min(ERRORS.len() - 1)
}
