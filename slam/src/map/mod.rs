//! The map: keyframes and map points, changed only through [`MapEdit`]s.

mod check;
mod correction;
mod covisibility;
mod edit;
mod editor;
mod keyframe;
mod point;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, Buffers, IdVec, KeyFrameId, MapId, MapPointId, Se3};

pub use check::MapProblem;
pub use correction::{Correction, Join, moved_pose};
pub use edit::{EditCounts, MapEdit, NewPoint};
pub use editor::{Editor, Journal, Renaming};
pub use keyframe::KeyFrame;
pub use point::{Appearance, MapPoint, Sighting, Sightings};

/// Map points that are copied together when one of them is written to while a snapshot shares them. A keyframe's points
/// have neighbouring ids and are mostly written together; a block is then a few kilobytes.
const POINTS_IN_BLOCK: usize = 16;

/// All maps of a run. Keyframes and points carry the [`MapId`] of the part they belong to; parts have no common frame
/// until they are joined by a [`Correction`].
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Map {
    keyframes: IdVec<KeyFrame>,
    points: IdVec<MapPoint, POINTS_IN_BLOCK>,
    /// Where a removed keyframe went: its spanning-tree parent and `removed_from_parent`, so that frames that refer to
    /// it keep their place.
    removed: BTreeMap<KeyFrameId, (KeyFrameId, Se3)>,
    /// Point that a merged point became, since [`Map::take_merges`].
    merged: BTreeMap<MapPointId, MapPointId>,
    /// Corrections so far.
    corrections: u32,
}

impl Map {
    /// A live keyframe.
    #[must_use]
    pub fn keyframe(&self, id: KeyFrameId) -> Option<&KeyFrame> {
        self.keyframes.get(id.index())
    }

    /// A live map point.
    #[must_use]
    pub fn point(&self, id: MapPointId) -> Option<&MapPoint> {
        self.points.get(id.index())
    }

    /// What a job needs of the map: keyframes and points, shared until either side writes. Not where removed keyframes
    /// and merged points went, which grows with the length of a run.
    #[must_use]
    pub fn snapshot(&self) -> Self {
        let (keyframes, points) = (self.keyframes.clone(), self.points.clone());
        let corrections = self.corrections;
        Self { keyframes, points, removed: BTreeMap::new(), merged: BTreeMap::new(), corrections }
    }

    /// What merged points became since this was last asked, forgotten from now on. For when nobody else holds ids from
    /// before the merges any more.
    #[must_use]
    pub fn take_merges(&mut self) -> BTreeMap<MapPointId, MapPointId> {
        std::mem::take(&mut self.merged)
    }

    /// The live point that this id stands for now: itself, or the point it was merged into.
    #[must_use]
    pub fn current_point(&self, id: MapPointId) -> Option<MapPointId> {
        let mut id = id;
        while let Some(next) = self.merged.get(&id) {
            id = *next;
        }
        self.point(id).map(|_| id)
    }

    /// Whether a keypoint of a live keyframe shows a point of the map: one that is static as far as is known.
    #[must_use]
    pub fn has_point(&self, keyframe: KeyFrameId, keypoint: u32) -> bool {
        self.keyframe(keyframe).and_then(|k| k.points.get(keypoint as usize)).is_some_and(Option::is_some)
    }

    /// Live keyframes, oldest first.
    pub fn keyframes(&self) -> impl DoubleEndedIterator<Item = &KeyFrame> {
        self.keyframes.iter().map(|(_, k)| k)
    }

    /// Live map points, oldest first.
    pub fn points(&self) -> impl DoubleEndedIterator<Item = &MapPoint> {
        self.points.iter().map(|(_, p)| p)
    }

    /// Points that any of some keyframes observes, by id.
    #[must_use]
    pub fn points_seen_by(&self, keyframes: &[KeyFrameId], buffers: &Buffers) -> Buffer<MapPointId> {
        // A bit a point: the lists of neighbours name mostly the same points, and to sort them all would cost more.
        let mut seen: Buffer<u64> = buffers.filled(self.points.next_index().div_ceil(64), 0);
        for keyframe in keyframes.iter().filter_map(|id| self.keyframe(*id)) {
            for point in keyframe.points.iter().flatten() {
                seen[point.index() / 64] |= 1 << (point.index() % 64);
            }
        }
        let mut points = buffers.empty();
        for (i, bits) in seen.iter_mut().enumerate() {
            while *bits != 0 {
                points.push(MapPointId::from(i * 64 + bits.trailing_zeros() as usize));
                *bits &= *bits - 1;
            }
        }
        points
    }

    /// Number of live keyframes.
    #[must_use]
    pub fn keyframe_count(&self) -> usize {
        self.keyframes.len()
    }

    /// Number of live keyframes of one part.
    #[must_use]
    pub fn keyframe_count_of(&self, map: MapId) -> usize {
        self.keyframes().filter(|k| k.map == map).count()
    }

    /// Number of live map points.
    #[must_use]
    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// How many corrections the map has seen: what was computed on a snapshot with another number speaks of a world that
    /// has moved since.
    #[must_use]
    pub fn corrections(&self) -> u32 {
        self.corrections
    }

    /// The id that the next keyframe gets.
    #[must_use]
    pub fn next_keyframe(&self) -> KeyFrameId {
        KeyFrameId::from(self.keyframes.next_index())
    }

    /// The id that the next map point gets.
    #[must_use]
    pub fn next_point(&self) -> MapPointId {
        MapPointId::from(self.points.next_index())
    }

    /// Pose of a keyframe, also of a removed one (through its parent): `camera_from_world` and its part of the atlas.
    #[must_use]
    pub fn pose_of(&self, id: KeyFrameId) -> Option<(Se3, MapId)> {
        let mut from_ancestor = Se3::identity();
        let mut id = id;
        loop {
            if let Some(keyframe) = self.keyframe(id) {
                return Some((from_ancestor * keyframe.camera_from_world, keyframe.map));
            }
            let (parent, removed_from_parent) = self.removed.get(&id)?;
            from_ancestor = from_ancestor * *removed_from_parent;
            id = *parent;
        }
    }
}
