//! The kidnapped robot: the camera is taken away and put down where it has not been, and comes back from there.

use super::degrade::write;
use anyhow::Context as _;
use recorder::RgbdLog;
use replayer::log::{Log, decode};
use schemas::Stamp;
use schemas::calibration::CameraModel;
use std::path::Path;

/// Share of the sequence before the camera is taken away ...
const BEFORE: f64 = 0.4;
/// ... and share of it that the camera, going backwards from the end, does not see again.
const NOT_AGAIN: f64 = 0.24;
/// Truth farther from a picture than this is none, nanoseconds: the pairing of `pslam eval`, 20 ms.
const MAX_APART_NS: u64 = 20_000_000;

/// Frames of the source in the order in which they are shown.
fn order(len: usize) -> impl ExactSizeIterator<Item = usize> {
    let share = |part: f64| (part * len as f64) as usize;
    let (before, back) = (share(BEFORE), len - share(NOT_AGAIN));
    (0..before + back).map(move |shown| if shown < before { shown } else { len - 1 - (shown - before) })
}

/// Writes the frames of `layer` as they are, on an even time line with the source's mean period; each with the true pose next to
/// it in time.
pub(super) fn write_kidnapped(
    (log, layer, path): (&Log, Option<&str>, &Path),
    camera: &CameraModel,
    writer: &mut RgbdLog,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<()> {
    let timeline = log.timeline(layer)?;
    let stamps: Vec<Stamp> = timeline.frames().iter().map(|frame| frame.stamp).collect();
    let (Some(start), Some(end)) = (stamps.first(), stamps.last()) else { return Ok(()) };
    let period_ns = (end.0 - start.0) / (stamps.len().max(2) as i64 - 1);
    let order = order(stamps.len());
    let frames = order.len();
    for (shown, index) in order.enumerate() {
        let stamp = Stamp(start.0 + shown as i64 * period_ns);
        let raw = timeline.stream(index..index + 1)?.next().context("a frame of the timeline")??;
        let mut frame = decode(&raw, camera).with_context(|| path.display().to_string())?;
        let near = log.ground_truth().poses.iter().min_by_key(|pose| pose.stamp.0.abs_diff(frame.stamp.0));
        if let Some(pose) = near.filter(|pose| pose.stamp.0.abs_diff(frame.stamp.0) <= MAX_APART_NS) {
            let world = &pose.world_from_camera;
            writer.ground_truth(stamp, world.translation.into(), world.quaternion_xyzw())?;
        }
        frame.stamp = stamp;
        frame.depth.iter_mut().for_each(|depth| depth.stamp = stamp);
        write(writer, frame)?;
        progress(shown + 1, frames);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::order;

    #[test]
    fn it_goes_away_and_comes_back_over_what_it_saw() {
        let shown: Vec<usize> = order(250).collect();
        assert_eq!((shown.len(), shown[99], shown[100], *shown.last().unwrap()), (290, 99, 249, 60));
        assert_eq!(order(0).len(), 0);
        assert!(order(1).all(|index| index == 0));
    }
}
