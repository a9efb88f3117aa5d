//! Changes of a sequence that must not matter.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use nalgebra::Matrix3;
use slam::{Config, FrameInput, Sensor};
use slam_math::{FrameId, Stamp};
use slam_vision::{Camera, Distortion};

use super::{Sequence, labels};

/// What is done to a sequence or its configuration before it is replayed. A good result stays as good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Perturbation {
    /// Nothing.
    AsRecorded,
    /// The first frames are left out.
    Start(u32),
    /// Seen in a mirror.
    Mirrored,
    /// The last frame first.
    Backwards,
    /// Every second frame alone.
    EverySecond,
    /// Pictures of this brightness, percent.
    Brightness(u32),
    /// `orb.features`.
    Features(u32),
    /// `seed`.
    Seed(u32),
    /// The masks of one second in the middle are missing.
    MasksDropped,
    /// Each picture has the mask of five frames earlier.
    MasksLate,
    /// Borders wander, segments are missed, split off and renamed, blobs are unknown: about as much again as a network
    /// errs.
    LabelNoise,
    /// There are no masks at all.
    NoMasks,
}

/// How late masks are, frames.
const LATE_FRAMES: usize = 5;
/// For how long masks are missing, nanoseconds.
const DROPPED_NS: i64 = 1_000_000_000;

impl Perturbation {
    /// All that a suite applies, the unchanged sequence first.
    pub const ALL: [Self; 18] = [
        Self::AsRecorded,
        Self::Start(7),
        Self::Start(15),
        Self::Start(23),
        Self::Mirrored,
        Self::Backwards,
        Self::EverySecond,
        Self::Brightness(80),
        Self::Brightness(120),
        Self::Features(900),
        Self::Features(2000),
        Self::Seed(2),
        Self::Seed(3),
        Self::Seed(4),
        Self::MasksDropped,
        Self::MasksLate,
        Self::LabelNoise,
        Self::NoMasks,
    ];

    /// Whether the labels are made worse, so that a filter has less to go by.
    #[must_use]
    pub fn spoils_labels(self) -> bool {
        matches!(self, Self::MasksDropped | Self::MasksLate | Self::LabelNoise | Self::NoMasks)
    }

    /// The configuration to replay with.
    #[must_use]
    pub fn config(self, config: &Config) -> Config {
        let mut config = config.clone();
        match self {
            Self::Features(n) => config.orb.features = n as usize,
            Self::Seed(seed) => config.seed = u64::from(seed),
            _ => {}
        }
        config
    }

    /// The sequence to replay; `None` where it makes no sense: a mirror swaps the cameras of a stereo pair, where no masks are
    /// none can be spoilt, and a sequence that ends before it begins has no frames.
    #[must_use]
    pub fn apply(self, sequence: &Sequence) -> Option<Sequence> {
        if self == Self::Mirrored && matches!(sequence.setup.sensor, Sensor::Stereo { .. })
            || self.spoils_labels() && sequence.frames.iter().all(|frame| frame.panoptic.is_none())
        {
            return None;
        }
        let mut changed = sequence.clone();
        let frames = &mut changed.frames;
        match self {
            Self::AsRecorded | Self::Features(_) | Self::Seed(_) => {}
            Self::Start(first) => drop(frames.drain(..(first as usize).min(frames.len()))),
            Self::Mirrored => mirror(&mut changed),
            Self::Backwards => turn_back(&mut changed),
            Self::EverySecond => {
                let mut index = 0;
                frames.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
            }
            Self::Brightness(percent) => frames.iter_mut().for_each(|frame| brighten(frame, percent)),
            Self::MasksDropped => drop_masks(frames),
            Self::MasksLate => {
                let masks: Vec<_> = frames.iter().map(|frame| frame.panoptic.clone()).collect();
                for (i, frame) in frames.iter_mut().enumerate() {
                    frame.panoptic = masks[i.saturating_sub(LATE_FRAMES)].clone();
                }
            }
            Self::LabelNoise => {
                for (i, frame) in frames.iter_mut().enumerate() {
                    frame.panoptic = frame.panoptic.as_ref().map(|mask| Arc::new(labels::with_noise(mask, i as u32)));
                }
            }
            Self::NoMasks => frames.iter_mut().for_each(|frame| frame.panoptic = None),
        }
        for (i, frame) in changed.frames.iter_mut().enumerate() {
            frame.id = FrameId::from(i);
        }
        (!changed.frames.is_empty()).then_some(changed)
    }
}

fn mirror(sequence: &mut Sequence) {
    let camera = &mut sequence.setup.camera;
    *camera =
        Camera { cx: f64::from(camera.width) - 1.0 - camera.cx, distortion: mirrored(camera.distortion), ..*camera };
    for frame in &mut sequence.frames {
        flip(&mut frame.gray.data, frame.gray.width);
        if let Some(depth) = &mut frame.depth {
            let depth = Arc::make_mut(depth);
            flip(&mut depth.units, depth.width);
        }
        if let Some(mask) = &mut frame.panoptic {
            let mask = Arc::make_mut(mask);
            flip(&mut mask.ids, mask.width);
        }
    }
    // x changes its sign in the world and in the camera.
    let mirror = Matrix3::from_diagonal(&nalgebra::Vector3::new(-1.0, 1.0, 1.0));
    for pose in &mut sequence.truth.poses {
        let world_from_camera = &mut pose.world_from_camera;
        world_from_camera.rotation = mirror * world_from_camera.rotation * mirror;
        world_from_camera.translation[0] = -world_from_camera.translation[0];
    }
}

/// Only the tangential term along x knows left from right.
fn mirrored(distortion: Distortion) -> Distortion {
    match distortion {
        Distortion::None => Distortion::None,
        Distortion::Radtan { k1, k2, p1, p2, k3 } => Distortion::Radtan { k1, k2, p1, p2: -p2, k3 },
        Distortion::ModifiedRadtan { k1, k2, p1, p2, k3 } => Distortion::ModifiedRadtan { k1, k2, p1, p2: -p2, k3 },
    }
}

fn flip<T>(pixels: &mut [T], width: usize) {
    pixels.chunks_exact_mut(width).for_each(<[T]>::reverse);
}

/// Time runs backwards too, for the frames and for the truth.
fn turn_back(sequence: &mut Sequence) {
    let end = sequence.frames.iter().map(|frame| frame.stamp.0).max().unwrap_or_default();
    let start = sequence.frames.iter().map(|frame| frame.stamp.0).min().unwrap_or_default();
    sequence.frames.reverse();
    for frame in &mut sequence.frames {
        frame.stamp = Stamp(start + end - frame.stamp.0);
    }
    sequence.truth.poses.reverse();
    for pose in &mut sequence.truth.poses {
        pose.stamp = schemas::Stamp(start + end - pose.stamp.0);
    }
}

fn brighten(frame: &mut FrameInput, percent: u32) {
    let brighten = |v: &mut u8| *v = (u32::from(*v) * percent / 100).min(255) as u8;
    frame.gray.data.iter_mut().for_each(brighten);
    frame.right.iter_mut().for_each(|right| right.data.iter_mut().for_each(brighten));
}

fn drop_masks(frames: &mut [FrameInput]) {
    let Some(middle) = frames.get(frames.len() / 2).map(|frame| frame.stamp.0) else { return };
    for frame in frames.iter_mut().filter(|frame| (frame.stamp.0 - middle).abs() <= DROPPED_NS / 2) {
        frame.panoptic = None;
    }
}

impl fmt::Display for Perturbation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AsRecorded => f.write_str("as-recorded"),
            Self::Start(first) => write!(f, "start-{first}"),
            Self::Mirrored => f.write_str("mirrored"),
            Self::Backwards => f.write_str("backwards"),
            Self::EverySecond => f.write_str("every-second"),
            Self::Brightness(percent) => write!(f, "brightness-{percent}"),
            Self::Features(n) => write!(f, "features-{n}"),
            Self::Seed(seed) => write!(f, "seed-{seed}"),
            Self::MasksDropped => f.write_str("masks-dropped"),
            Self::MasksLate => f.write_str("masks-late"),
            Self::LabelNoise => f.write_str("label-noise"),
            Self::NoMasks => f.write_str("no-masks"),
        }
    }
}

impl FromStr for Perturbation {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(|known| known.to_string()).join(", ");
        Self::ALL
            .into_iter()
            .find(|known| known.to_string() == name)
            .ok_or_else(|| format!("there is no perturbation {name:?}; choose from {}", known()))
    }
}
