//! A replay that hands out every report whole.

use std::path::Path;
use std::sync::Arc;

use replayer::log::{DecodedFrame, Log, MaskPixels, decode};
use schemas::calibration::Distortion as Lens;
use slam::observation::Observation;
use slam::{
    Category, Config, DepthImage, FrameInput, FrameReport, Inline, Observer, PanopticMask, Segment, Sensor, Setup,
    Slam, Unobserved,
};
use slam_math::{FrameId, Stamp};
use slam_vision::{Camera, Distortion, Workspace, gray_from_rgb};

use super::Result;

/// Takes a frame's report, the frame, its features, and the picture's width and height in pixels.
pub type Each<'a> = &'a mut dyn FnMut(&FrameReport, &FrameInput, &Observation, (u32, u32)) -> Result<()>;

/// Is told of the steps of a frame that the slam does not tell of.
pub trait Watch: Observer {
    /// A frame has been decoded.
    fn frame_begins(&mut self) {}
    /// Its features are known.
    fn features_done(&mut self) {}
}

impl Watch for Unobserved {}

/// Frames of the log with its default segmentation layer.
#[allow(dead_code, reason = "not every example counts")]
pub fn frame_count(log: &Path) -> Result<usize> {
    let log = Log::open(log)?;
    Ok(log.timeline(log.default_layer())?.frames().len())
}

/// Replays the log with its default segmentation layer and shows every frame to `each`.
#[allow(dead_code, reason = "not every example is satisfied with reports")]
pub fn for_each_report(log: &Path, config: &Config, each: Each<'_>) -> Result<()> {
    watch_each_report(log, config, &mut Unobserved, &mut |report, input, obs, size, _| each(report, input, obs, size))
}

/// What [`Each`] takes, and who watches.
pub type EachWatched<'a, W> =
    &'a mut dyn FnMut(&FrameReport, &FrameInput, &Observation, (u32, u32), &mut W) -> Result<()>;

/// The same, watched.
pub fn watch_each_report<W: Watch>(log: &Path, config: &Config, watch: &mut W, each: EachWatched<'_, W>) -> Result<()> {
    let log = Log::open(log)?;
    let timeline = log.timeline(log.default_layer())?;
    let model = log.camera()?;
    let categories = log.default_layer().map_or(&[][..], |layer| log.categories(layer)).iter();
    let categories = categories.map(|c| Category { id: c.id, name: c.name.clone(), is_thing: c.is_thing }).collect();
    let distortion = match model.distortion {
        Lens::None => Distortion::None,
        Lens::Radtan { k1, k2, p1, p2, k3 } => Distortion::Radtan { k1, k2, p1, p2, k3 },
        Lens::ModifiedRadtan { k1, k2, p1, p2, k3 } => Distortion::ModifiedRadtan { k1, k2, p1, p2, k3 },
    };
    let (size, [fx, fy, cx, cy]) = ((model.width, model.height), [model.fx, model.fy, model.cx, model.cy]);
    let camera = Camera { fx, fy, cx, cy, width: size.0, height: size.1, distortion };
    let mut slam = Slam::new(config, &Setup { camera, sensor: Sensor::Rgbd, categories })?;
    let mut workspace = Workspace::default();
    for raw in timeline.stream(0..timeline.frames().len())? {
        let frame = decode(&raw?, &model)?;
        let (stamp, input) = (frame.stamp, input(frame)?);
        watch.frame_begins();
        let observation = Arc::new(slam.front_end().observe(&input, &mut workspace)?);
        watch.features_done();
        let report = slam.step(&input, observation.clone(), &mut Inline, watch)?;
        each(&report, &input, &observation, size, watch)
            .map_err(|error| format!("picture {} at {stamp} s: {error}", report.id))?;
    }
    Ok(())
}

fn input(frame: DecodedFrame) -> Result<FrameInput> {
    let (width, height) = (frame.rgb.width, frame.rgb.height);
    let depth = frame.depth.map(|depth| DepthImage {
        width,
        height,
        units: depth.units,
        metres_per_unit: 1.0 / depth.units_per_metre,
    });
    Ok(FrameInput {
        id: FrameId::from(frame.index),
        stamp: Stamp(frame.stamp.0),
        gray: gray_from_rgb(&frame.rgb.data, width, height)?,
        right: None,
        depth: depth.map(Arc::new),
        panoptic: frame.mask.map(|mask| Arc::new(panoptic(mask, width, height))),
    })
}

fn panoptic(mask: MaskPixels, width: usize, height: usize) -> PanopticMask {
    // What is no confidence tells nothing.
    let score = |score: f32| if (0.0..=1.0).contains(&score) { score } else { 1.0 };
    let segment = |s: schemas::msg::Segment| Segment { id: s.id, category: s.category_id, score: score(s.score) };
    PanopticMask { width, height, ids: mask.instance, segments: mask.segments.into_iter().map(segment).collect() }
}
