//! A point of the static world.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use slam_math::{FrameId, KeyFrameId, MapId, MapPointId};
use slam_vision::{Descriptor, hamming_many};
use smallvec::{SmallVec, smallvec};

use super::Map;
use crate::context::Context;
use crate::report::KeypointClass;

/// One observation of a point by a keyframe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sighting {
    /// Who sees it.
    pub keyframe: KeyFrameId,
    /// With which keypoint; a picture has no more, see `orb.features`.
    pub index: u16,
    /// Whether the keypoint has depth.
    pub with_depth: bool,
}

/// Observations of a point; so many fit without memory of their own, which most points need no more of.
pub type Sightings = SmallVec<[Sighting; 18]>;

/// How to recognise a point: fields of [`MapPoint`] that follow from its observations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Appearance {
    /// See [`MapPoint::descriptor`].
    pub descriptor: Descriptor,
    /// See [`MapPoint::described`].
    pub described: u64,
    /// See [`MapPoint::normal`].
    #[serde(with = "slam_math::vector")]
    pub normal: Vector3<f64>,
    /// See [`MapPoint::range_m`].
    pub range_m: [f64; 2],
}

/// A point of the static world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapPoint {
    /// Its id, in creation order.
    pub id: MapPointId,
    /// Part of the atlas.
    pub map: MapId,
    /// Position in the world, metres.
    #[serde(with = "slam_math::vector")]
    pub position: Vector3<f64>,
    /// Observations, sorted by keyframe.
    pub seen_in: Sightings,
    /// The descriptor nearest to all others of its observations.
    pub descriptor: Descriptor,
    /// Digest of the observations that the descriptor was chosen from: while they stay the same, so does the choice,
    /// which costs the square of their number.
    pub described: u64,
    /// Mean direction from the cameras to the point, unit length.
    #[serde(with = "slam_math::vector")]
    pub normal: Vector3<f64>,
    /// Nearest and farthest distance in metres at which it appears on some pyramid level.
    pub range_m: [f64; 2],
    /// Keyframe it was made in.
    pub created_in: KeyFrameId,
    /// Frame it was made in.
    pub created_at: FrameId,
    /// What the keypoints lay on that the point was made of.
    pub class: KeypointClass,
    /// Frames in which it should have been visible.
    pub visible: u32,
    /// Frames in which it was found.
    pub found: u32,
    /// Consecutive evidence that it is gone or on a mover; reset when it is found static.
    pub doubts: u32,
}

impl MapPoint {
    /// Number of observations, one with depth counting twice (it fixes the point alone).
    #[must_use]
    pub fn weight(&self) -> u32 {
        self.seen_in.iter().map(|s| 1 + u32::from(s.with_depth)).sum()
    }

    /// The keypoint of a keyframe that observes it.
    #[must_use]
    pub fn sighting(&self, keyframe: KeyFrameId) -> Option<&Sighting> {
        self.seen_in.binary_search_by_key(&keyframe, |s| s.keyframe).ok().map(|i| &self.seen_in[i])
    }

    /// Share of the frames it should be seen in that found it.
    #[must_use]
    pub fn found_ratio(&self) -> f64 {
        f64::from(self.found) / f64::from(self.visible.max(1))
    }
}

impl Map {
    /// What a point looks like by its observations. The range follows the keyframe that made the point, or the oldest
    /// that still sees it.
    pub(super) fn appearance(&self, ctx: &Context, id: MapPointId) -> Option<Appearance> {
        let point = self.point(id)?;
        let sighting = point.sighting(point.created_in).or(point.seen_in.first())?;
        let keyframe = self.keyframe(sighting.keyframe)?;
        let distance = (point.position - keyframe.center()).norm();
        let range_m = ctx.range_of(distance, keyframe.obs.octave[sighting.index as usize]);
        let mut normal = Vector3::zeros();
        for sighting in &point.seen_in {
            let to_point = point.position - self.keyframe(sighting.keyframe)?.center();
            normal += to_point / to_point.norm();
        }
        let length = normal.norm();
        let normal = if length > 0.0 { normal / length } else { point.normal };
        let described = digest(&point.seen_in);
        let descriptor = if described == point.described { point.descriptor } else { self.most_typical(point)? };
        Some(Appearance { descriptor, described, normal, range_m })
    }

    /// The descriptor nearest to all others of a point's observations.
    fn most_typical(&self, point: &MapPoint) -> Option<Descriptor> {
        let descriptor = |s: &Sighting| self.keyframe(s.keyframe).map(|k| k.obs.descriptor[s.index as usize]);
        distinctive(&point.seen_in.iter().map(descriptor).collect::<Option<SmallVec<[_; 32]>>>()?)
    }
}

/// Digest of who sees a point with which keypoints.
fn digest(sightings: &[Sighting]) -> u64 {
    // Multiply and fold; the odd number is 2^64 over the golden ratio.
    sightings.iter().fold(0, |digest, s| {
        let mixed = (digest ^ (u64::from(s.keyframe.0) << 32 | u64::from(s.index))).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ mixed >> 29
    })
}

/// The descriptor with the least median Hamming distance to the others; the first one wins ties.
fn distinctive(descriptors: &[Descriptor]) -> Option<Descriptor> {
    let mut distances: SmallVec<[u32; 32]> = smallvec![0; descriptors.len()];
    let mut best: Option<(u32, &Descriptor)> = None;
    for descriptor in descriptors {
        hamming_many(descriptor, descriptors, &mut distances);
        let middle = (distances.len() - 1) / 2;
        // Counting is cheaper than selecting, and most medians are not less than the least so far.
        let is_less = |least: u32| distances.iter().filter(|d| **d < least).count() > middle;
        if best.is_none_or(|(least, _)| is_less(least)) {
            best = Some((*distances.select_nth_unstable(middle).1, descriptor));
        }
    }
    best.map(|(_, descriptor)| *descriptor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distinctive_descriptor_is_in_the_middle() {
        let ones = |n: u32| [(1u64 << n) - 1, 0, 0, 0];
        assert_eq!(distinctive(&[ones(0), ones(20), ones(9), ones(10), ones(11)]), Some(ones(10)));
        assert_eq!(distinctive(&[ones(3), ones(5)]), Some(ones(3)), "the first one wins ties");
        assert_eq!(distinctive(&[]), None);
    }
}
