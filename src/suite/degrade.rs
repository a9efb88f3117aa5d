//! Harder versions of a log: what goes wrong on a robot, done to a sequence with known truth.

use super::kidnap::write_kidnapped;
use anyhow::Context as _;
use recorder::picture::encode_rgb8;
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec};
use replayer::log::{DecodedFrame, Log, RgbImage, Timeline, decode};
use schemas::calibration::CameraModel;
use schemas::msg::format;
use schemas::{Stamp, topics};
use serde::{Deserialize, Serialize};
use slam_math::Rng;
use std::ops::Range;
use std::path::Path;

/// What is done to a sequence. Every choice is a pure function of the frame's index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Degrade {
    /// Each frame is left out with a chance of 10 %.
    DropTenth,
    /// Only every fifth frame is kept.
    EveryFifth,
    /// Two seconds in the middle have no depth image.
    NoDepth,
    /// Brightness jumps between 55, 100 and 160 % every second.
    ExposureSteps,
    /// Every other second is blurred along the rows, as by a fast turn.
    MotionBlur,
    /// A printed board half a metre away moves before the camera for three seconds in the middle and hides 70 % of the
    /// picture; its pixels are unknown to the segmentation.
    Cover,
    /// The camera is taken away and put down where it has not been, from where it comes back over what it saw.
    Kidnapped,
}

/// Seed of all draws here.
const SEED: u64 = 0x64_65_67_72;
/// Columns over which [`Degrade::MotionBlur`] spreads a pixel: a turn of 40 degrees a second at 1/60 s shutter and
/// 525 px focal length is 6 px; this is twice that.
const BLUR_PX: usize = 13;
/// Distance of the board, metres.
const COVER_DEPTH_M: f64 = 0.5;
/// Width of the board, share of the picture.
const COVER_SHARE: f64 = 0.7;
/// Side of one printed square of the board, pixels.
const SQUARE_PX: usize = 12;

impl Degrade {
    /// Writes the degraded log; `progress` hears (frames done, frames in all).
    ///
    /// # Errors
    /// The source is no readable colour-depth log, or the result cannot be written.
    pub fn apply(self, source: &Path, out: &Path, progress: &mut dyn FnMut(usize, usize)) -> anyhow::Result<()> {
        let log = Log::open(source)?;
        let camera = log.camera()?;
        let layer = log.default_layer();
        let timeline = log.timeline(layer)?;
        let layers = layer.map(|name| LayerSpec {
            name: topics::DEFAULT_LAYER.to_owned(),
            origin: format!("layer {name} of {}", source.display()),
            categories: log.categories(name).to_vec(),
        });
        let spec = RgbdSpec {
            depth_units_per_metre: timeline.units_per_metre.to_string(),
            layers: layers.into_iter().collect(),
            ..RgbdSpec::new("degraded", &format!("{self:?}"), camera)
        };
        let options = LogOptions { force: true, ..LogOptions::default() };
        let mut writer = RgbdLog::create(out, &options, &spec)?;
        if self == Self::Kidnapped {
            write_kidnapped((&log, layer, source), &camera, &mut writer, progress)?;
        } else {
            self.write_changed((&log, source), (&timeline, &camera), &mut writer, progress)?;
        }
        writer.finish()?;
        Ok(())
    }

    /// Frame by frame in the order of the source, stamps as they are.
    fn write_changed(
        self,
        (log, source): (&Log, &Path),
        (timeline, camera): (&Timeline, &CameraModel),
        writer: &mut RgbdLog,
        progress: &mut dyn FnMut(usize, usize),
    ) -> anyhow::Result<()> {
        let mut truth = log.ground_truth().poses.iter().peekable();
        let scene = Scene::new(timeline.frames().iter().map(|frame| frame.stamp));
        for raw in timeline.stream(0..timeline.frames().len())? {
            let raw = raw?;
            while let Some(pose) = truth.next_if(|pose| pose.stamp <= raw.stamp) {
                let world = &pose.world_from_camera;
                writer.ground_truth(pose.stamp, world.translation.into(), world.quaternion_xyzw())?;
            }
            progress(raw.index + 1, timeline.frames().len());
            if !self.keeps(raw.index) {
                continue;
            }
            let mut frame = decode(&raw, camera).with_context(|| source.display().to_string())?;
            self.change(&mut frame, &scene);
            write(writer, frame)?;
        }
        for pose in truth {
            let world = &pose.world_from_camera;
            writer.ground_truth(pose.stamp, world.translation.into(), world.quaternion_xyzw())?;
        }
        Ok(())
    }

    fn keeps(self, index: usize) -> bool {
        match self {
            Self::DropTenth => Rng::at(SEED, index as u32, 0, 0).uniform() >= 0.1,
            Self::EveryFifth => index.is_multiple_of(5),
            _ => true,
        }
    }

    fn change(self, frame: &mut DecodedFrame, scene: &Scene) {
        match self {
            Self::DropTenth | Self::EveryFifth | Self::Kidnapped => {}
            Self::NoDepth if scene.middle(2.0).contains(&frame.stamp) => frame.depth = None,
            Self::Cover if scene.middle(3.0).contains(&frame.stamp) => cover(frame, scene.seconds(frame.stamp)),
            Self::NoDepth | Self::Cover => {}
            Self::ExposureSteps => {
                let percent = [100, 55, 100, 160][scene.seconds(frame.stamp) as usize % 4];
                frame.rgb.data.iter_mut().for_each(|v| *v = (u32::from(*v) * percent / 100).clamp(0, 255) as u8);
            }
            Self::MotionBlur => {
                if scene.seconds(frame.stamp) as usize % 2 == 1 {
                    blur_rows(&mut frame.rgb);
                }
            }
        }
    }
}

/// The time line of the source.
struct Scene {
    start: Stamp,
    end: Stamp,
}

impl Scene {
    fn new(mut stamps: impl DoubleEndedIterator<Item = Stamp>) -> Self {
        let start = stamps.next().unwrap_or(Stamp(0));
        Self { start, end: stamps.next_back().unwrap_or(start) }
    }

    fn seconds(&self, stamp: Stamp) -> f64 {
        (stamp.0 - self.start.0) as f64 * 1e-9
    }

    /// So many seconds around the middle.
    fn middle(&self, length_s: f64) -> Range<Stamp> {
        let (middle, half) = (self.start.0.midpoint(self.end.0), (length_s * 0.5e9) as i64);
        Stamp(middle - half)..Stamp(middle + half)
    }
}

fn blur_rows(rgb: &mut RgbImage) {
    for row in rgb.data.chunks_exact_mut(3 * rgb.width) {
        let source = row.to_vec();
        for x in 0..rgb.width {
            let window = x.saturating_sub(BLUR_PX / 2)..(x + BLUR_PX / 2 + 1).min(rgb.width);
            for channel in 0..3 {
                let sum: usize = window.clone().map(|x| usize::from(source[3 * x + channel])).sum();
                row[3 * x + channel] = (sum / window.len()) as u8;
            }
        }
    }
}

/// Draws the board: it swings from side to side, about 12 px a frame at its fastest.
fn cover(frame: &mut DecodedFrame, seconds: f64) {
    let (width, height) = (frame.rgb.width, frame.rgb.height);
    let free = (1.0 - COVER_SHARE) * width as f64;
    // A triangle wave with a period of one second.
    let phase = seconds - seconds.floor();
    let swing = if phase < 0.5 { 2.0 * phase } else { 2.0 - 2.0 * phase };
    let left = (free * swing) as usize;
    let board = (COVER_SHARE * width as f64) as usize;
    for y in 0..height {
        for x in left..(left + board).min(width) {
            let pixel = y * width + x;
            let (column, row) = ((x - left) / SQUARE_PX, y / SQUARE_PX);
            let mut print = Rng::at(SEED, column as u32, row as u32, 1);
            frame.rgb.data[3 * pixel..3 * pixel + 3].fill_with(|| print.below(256) as u8);
            if let Some(depth) = &mut frame.depth {
                depth.units[pixel] = (COVER_DEPTH_M * depth.units_per_metre) as u16;
            }
            if let Some(mask) = &mut frame.mask {
                (mask.class[pixel], mask.instance[pixel]) = (0, 0);
            }
        }
    }
}

/// Writes a decoded frame.
pub(super) fn write(log: &mut RgbdLog, frame: DecodedFrame) -> anyhow::Result<()> {
    let DecodedFrame { stamp, rgb, depth, mask, .. } = frame;
    log.log().flush_if_due(stamp)?;
    let (earlier, later): (Vec<_>, Vec<_>) = depth.iter().partition(|depth| depth.stamp < stamp);
    for depth in earlier {
        log.depth(depth.stamp, &depth.units)?;
    }
    log.color(stamp, format::PNG, &encode_rgb8(rgb.width as u32, rgb.height as u32, &rgb.data)?)?;
    for depth in later {
        log.depth(depth.stamp, &depth.units)?;
    }
    if let Some(mask) = mask {
        log.mask(0, stamp, &Mask { class: mask.class, instance: mask.instance, segments: mask.segments })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shortest world there is.
    fn source(folder: &Path) -> std::path::PathBuf {
        let world =
            fixtures::World::new(&fixtures::WorldConfig { frame_count: 20, ..fixtures::scenario::tiny() }).unwrap();
        let path = folder.join("source.mcap");
        crate::synthetic::write_log(&world, "tiny", &path, false, &mut |_| {}, &mut |_, _| {}).unwrap();
        path
    }

    fn frames(path: &Path) -> Vec<DecodedFrame> {
        let log = Log::open(path).unwrap();
        let (camera, timeline) = (log.camera().unwrap(), log.timeline(log.default_layer()).unwrap());
        let frames = timeline.stream(0..timeline.frames().len()).unwrap();
        frames.map(|raw| decode(&raw.unwrap(), &camera).unwrap()).collect()
    }

    #[test]
    fn each_way_changes_what_it_says_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let source = source(folder.path());
        let before = frames(&source);
        for way in [
            Degrade::DropTenth,
            Degrade::EveryFifth,
            Degrade::NoDepth,
            Degrade::ExposureSteps,
            Degrade::MotionBlur,
            Degrade::Cover,
        ] {
            let out = folder.path().join("harder.mcap");
            way.apply(&source, &out, &mut |_, _| {}).unwrap();
            let after = frames(&out);
            let truth = |path| Log::open(path).unwrap().ground_truth().poses.len();
            assert_eq!(truth(&out), truth(&source), "{way:?}: the truth stays");
            let kept = |frame: &DecodedFrame| before.iter().find(|old| old.stamp == frame.stamp).unwrap();
            let changed =
                |f: fn(&DecodedFrame, &DecodedFrame) -> bool| after.iter().filter(|new| f(kept(new), new)).count();
            let found = (
                before.len() - after.len(),
                changed(|old, new| old.rgb != new.rgb),
                changed(|old, new| old.depth.as_ref().map(|d| &d.units) != new.depth.as_ref().map(|d| &d.units)),
            );
            // 20 frames at 5 Hz: two seconds are 10 frames, three are 15.
            match way {
                Degrade::DropTenth => assert!((1..=5).contains(&found.0) && found.1 + found.2 == 0, "{found:?}"),
                Degrade::EveryFifth => assert_eq!(found, (16, 0, 0)),
                Degrade::NoDepth => assert_eq!(found, (0, 0, 10)),
                Degrade::ExposureSteps | Degrade::MotionBlur => assert_eq!(found, (0, 10, 0)),
                Degrade::Cover => assert_eq!(found, (0, 15, 15)),
                Degrade::Kidnapped => unreachable!("it has stamps of its own"),
            }
        }
    }

    #[test]
    fn a_kidnapped_camera_sees_the_source_in_another_order() {
        let folder = tempfile::tempdir().unwrap();
        let (source, out) = (source(folder.path()), folder.path().join("harder.mcap"));
        Degrade::Kidnapped.apply(&source, &out, &mut |_, _| {}).unwrap();
        let (before, after) = (frames(&source), frames(&out));
        let order: Vec<usize> = (0..8).chain((4..20).rev()).collect();
        assert_eq!(after.len(), order.len());
        for (new, index) in after.iter().zip(order) {
            let old = &before[index];
            assert_eq!((&new.rgb, &new.mask), (&old.rgb, &old.mask), "frame {index}");
            assert_eq!(new.depth.as_ref().map(|d| &d.units), old.depth.as_ref().map(|d| &d.units), "frame {index}");
        }
        let truth = |path, stamp| {
            let log = Log::open(path).unwrap();
            let near = log.ground_truth().poses.iter().min_by_key(|pose| pose.stamp.0.abs_diff(stamp));
            near.unwrap().world_from_camera
        };
        let [put_down, end] = [truth(&out, after[8].stamp.0), truth(&source, before[19].stamp.0)];
        assert_eq!(put_down.translation, end.translation);
        assert!((put_down.rotation - end.rotation).norm() < 1e-12, "through a quaternion and back");
    }
}
