//! The layout the viewer opens with.

use nalgebra::Vector3;
use rrd::{Blueprint, Container, Eye, Layout, Node, Panel, Play, Spatial2d, Spatial3d, TimePanel, View, ViewKind};
use slam_math::float;

use super::truth::ERROR;
use super::world::point;
use crate::eval::Trajectory;

/// How to read the file; shown in a tab.
pub const ABOUT: &str = "\
# How to read this

**Space.** Blue: the way as known at each frame. Gold: the true way, laid over the final estimate. Pale: the final \
estimate. The camera's frustum is green while tracked and red while lost. Small pyramids are keyframes, the lines \
between them tell how many points they share. Pink ties keyframes that saw the same place in a loop or where two maps were \
joined; orange lines show for one frame how far a correction moved each keyframe. Points: green are seen now, pale are settled, blue are young, yellow lie \
on Things that stand still, magenta on unknown areas that stand still, orange are in doubt.

**Keypoints.** The colour is the panoptic filter's verdict; large ones are matched to the map. The plot *keypoints by \
verdict* is the legend. A blue halo: the keypoint lies on a segment, and on a map point that has stood still for long, which \
vouches for it. A white box: the map points of the segment, all together, move otherwise than the background.

**Segments.** Boxes name class, track and verdict of a segment, and the larger share of its samples that speaks for \
motion (keypoints that moved, depth in formerly free space).

**Residuals.** Green fits a static world, red does not. *Epipolar*: pixels from the line, red from 4. *Motion*: \
standard deviations under the static hypothesis, red from 6.

Click an item to see its values. Views hold more than they show: open the left panel and switch entities on.";

/// The layout for pictures of this size and this way of the camera; `has_error` when there is a truth to compare with.
pub fn layout([width, height]: [u32; 2], fps: f64, estimate: &Trajectory, has_error: bool) -> Blueprint {
    let columns = Container::new(
        Layout::Horizontal,
        "inspection",
        vec![space(eye(estimate)).into(), pictures(width, height).into(), curves(has_error).into()],
    );
    let time = TimePanel { fps, play: Play::Playing, panel: Panel::Collapsed, ..TimePanel::default() };
    Blueprint { time, ..Blueprint::new(columns.with_shares(&[1.25, 1.25, 1.0]).into()) }
}

/// Behind and above the camera's way, so that all of it shows, and what lies before it. The world has the axes of the
/// first camera: y points down, or nearly so.
fn eye(estimate: &Trajectory) -> Eye {
    /// Distance at which things that the camera looks at are taken to be, metres.
    const AHEAD_M: f64 = 1.6;
    /// Smallest scene, metres.
    const MIN_RADIUS_M: f64 = 0.7;
    let mut corners: Option<(Vector3<f64>, Vector3<f64>)> = None;
    let mut forward = Vector3::zeros();
    for pose in &estimate.poses {
        let ahead = pose.world_from_camera.rotation.column(2).into_owned();
        forward += ahead;
        let center = pose.world_from_camera.translation;
        for point in [center, center + ahead * AHEAD_M] {
            let (low, high) = corners.unwrap_or((point, point));
            corners = Some((low.zip_map(&point, float::min), high.zip_map(&point, float::max)));
        }
    }
    forward.y = 0.0;
    let length = forward.norm();
    let forward = if length > 0.0 { forward / length } else { Vector3::z() };
    let (low, high) = corners.unwrap_or((Vector3::zeros(), Vector3::z()));
    let (target, radius) = ((low + high) / 2.0, float::max((high - low).norm() / 2.0, MIN_RADIUS_M));
    let left = Vector3::new(-forward.z, 0.0, forward.x);
    let position = target + (left * 0.7 - Vector3::y() * 1.1 - forward * 1.5) * radius;
    Eye { position: point(&position), target: point(&target), up: [0.0, -1.0, 0.0] }
}

/// The world, with the log below.
fn space(eye: Eye) -> Container {
    let world = View::new(ViewKind::Spatial3d(Spatial3d { eye: Some(eye), grid: false }), "map and cameras", "/world")
        .with_contents(&["+ /world/**", "- /world/camera/**", "+ /world/camera", "+ /world/camera/color"])
        .with_hidden(&["/world/trajectory/final"]);
    let texts = vec![
        View::new(ViewKind::TextLog, "events", "/log").into(),
        View::new(ViewKind::TextDocument, "how to read this", "/about").into(),
    ];
    let texts = Container::new(Layout::Tabs, "texts", texts);
    Container::new(Layout::Vertical, "space", vec![world.into(), texts.into()]).with_shares(&[2.6, 1.0])
}

/// One large picture, four small ones.
fn pictures(width: u32, height: u32) -> Container {
    let bounds = Some([0.0, 0.0, f64::from(width), f64::from(height)]);
    let view = |name: &str, layers: &[&str]| -> Node {
        let mut contents = vec!["+ $origin/color"];
        contents.extend(layers);
        View::new(ViewKind::Spatial2d(Spatial2d { bounds }), name, "/world/camera").with_contents(&contents).into()
    };
    let large = vec![
        view(
            "keypoints by verdict",
            &["+ $origin/keypoints", "+ $origin/vouched", "+ $origin/regions/moving", "+ $origin/regions/disagree"],
        ),
        view("epipolar residual", &["+ $origin/epipolar"]),
        view("motion residual", &["+ $origin/motion"]),
    ];
    let small = vec![
        view("segmentation", &["+ $origin/segmentation"]),
        view("depth, or right picture", &["- $origin/color", "+ $origin/depth", "+ $origin/right"]),
        view("segment tracks", &["+ $origin/regions/**"]),
        view("unknown area", &["+ $origin/unknown"]),
    ];
    let large = Container::new(Layout::Tabs, "keypoints", large);
    let small = Container::new(Layout::Grid(2), "inputs and regions", small);
    Container::new(Layout::Vertical, "pictures", vec![large.into(), small.into()]).with_shares(&[1.0, 1.15])
}

/// Four plots, the less asked-for ones behind them in tabs.
fn curves(has_error: bool) -> Container {
    let plot =
        |name: &str, entity: &str| -> Node { View::new(ViewKind::TimeSeries { y_range: None }, name, entity).into() };
    let tabs = |name: &str, plots| -> Node { Container::new(Layout::Tabs, name, plots).into() };
    let mut rows = vec![
        tabs("filter", vec![plot("keypoints by verdict", "/plots/verdicts"), plot("segment tracks", "/plots/regions")]),
        tabs(
            "residuals",
            vec![
                plot("epipolar residual, px", "/plots/epipolar"),
                plot("motion residual, sigmas", "/plots/motion"),
                plot("fundamental matrix", "/plots/epipolar_support"),
            ],
        ),
        tabs("tracking", vec![plot("matches", "/plots/matches")]),
        tabs(
            "mapping",
            vec![
                plot("map points", "/plots/map"),
                plot("keyframes", "/plots/keyframes"),
                plot("map edits", "/plots/edits"),
            ],
        ),
    ];
    if has_error {
        rows.push(plot("error against truth, mm", ERROR));
    }
    // The first plot is the legend of the keypoints' colours and needs room for its eight names.
    let shares: Vec<f32> = (0..rows.len()).map(|row| if row == 0 { 1.7 } else { 1.0 }).collect();
    Container::new(Layout::Vertical, "curves", rows).with_shares(&shares)
}
