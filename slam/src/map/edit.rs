//! The only way to change a [`Map`].

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use slam_math::{DigestWriter, FrameId, KeyFrameId, MapPointId, Se3};

use super::{Appearance, Correction, KeyFrame, Map, MapPoint, Sighting, Sightings};
use crate::report::KeypointClass;

/// A point to be added, with the observation that made it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NewPoint {
    /// Position in the world, metres.
    #[serde(with = "slam_math::vector")]
    pub position: Vector3<f64>,
    /// Keyframe that sees it.
    pub keyframe: KeyFrameId,
    /// Its keypoint.
    pub index: u32,
    /// Frame of creation.
    pub frame: FrameId,
    /// What the keypoints lie on that it is made of.
    pub class: KeypointClass,
}

/// One change. Changes to something that died meanwhile do nothing and are counted.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum MapEdit {
    /// Adds a keyframe; its id must be [`Map::next_keyframe`]. Its `points` become observations.
    AddKeyFrame(Box<KeyFrame>),
    /// Adds a point, seen with a keypoint that was free; its id is [`Map::next_point`].
    AddPoint(NewPoint),
    /// A keyframe observes a point with a keypoint that was free.
    Observe(MapPointId, KeyFrameId, u32),
    /// A keyframe no longer observes a point.
    Unobserve(MapPointId, KeyFrameId),
    /// Two points are one: observations and counters of `drop` go to `keep`.
    MergePoints {
        /// The point that stays.
        keep: MapPointId,
        /// The point that goes.
        drop: MapPointId,
    },
    /// Moves a keyframe.
    SetPose(KeyFrameId, Se3),
    /// Moves a point.
    SetPosition(MapPointId, #[serde(with = "slam_math::vector")] Vector3<f64>),
    /// The point should have been seen in a frame, and was found or not.
    CountSight(MapPointId, bool),
    /// Sets the doubt counter of a point.
    SetDoubts(MapPointId, u32),
    /// Sets what a point looks like, see `Map::appearance`.
    Refresh(MapPointId, Appearance),
    /// Recomputes the covisibility edges of a keyframe.
    Connect(KeyFrameId),
    /// Removes a point.
    CullPoint(MapPointId),
    /// Removes a keyframe.
    CullKeyFrame(KeyFrameId),
    /// Two keyframes see the same place after a loop.
    LinkLoop(KeyFrameId, KeyFrameId),
    /// Moves the map, or a part of it, as a whole.
    Correct(Box<Correction>),
}

/// How many edits were applied and how many did nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EditCounts {
    /// Edits that changed the map.
    pub applied: u64,
    /// Edits on something that was gone.
    pub void: u64,
}

impl Map {
    /// Applies one edit; false when its subject is gone.
    pub fn apply(&mut self, edit: &MapEdit) -> bool {
        match edit {
            MapEdit::AddKeyFrame(keyframe) => self.add_keyframe(keyframe),
            MapEdit::AddPoint(new) => self.add_point(new),
            MapEdit::Observe(point, keyframe, index) => self.observe(*point, *keyframe, *index),
            MapEdit::Unobserve(point, keyframe) => self.unobserve(*point, *keyframe),
            MapEdit::MergePoints { keep, drop } => self.merge(*keep, *drop),
            MapEdit::SetPose(id, pose) => self.with_keyframe(*id, |k| k.camera_from_world = *pose),
            MapEdit::SetPosition(id, position) => self.with_point(*id, |p| p.position = *position),
            MapEdit::CountSight(id, found) => self.with_point(*id, |p| {
                p.visible += 1;
                p.found += u32::from(*found);
            }),
            MapEdit::SetDoubts(id, doubts) => self.with_point(*id, |p| p.doubts = *doubts),
            MapEdit::Refresh(id, appearance) => self.with_point(*id, |p| {
                (p.descriptor, p.described) = (appearance.descriptor, appearance.described);
                (p.normal, p.range_m) = (appearance.normal, appearance.range_m);
            }),
            MapEdit::Connect(id) => self.connect(*id),
            MapEdit::CullPoint(id) => self.cull_point(*id),
            MapEdit::CullKeyFrame(id) => self.remove_keyframe(*id),
            MapEdit::LinkLoop(a, b) => self.link_loop(*a, *b),
            MapEdit::Correct(correction) => self.correct(correction),
        }
    }

    pub(super) fn keyframe_mut(&mut self, id: KeyFrameId) -> &mut KeyFrame {
        self.keyframes.get_mut(id.index()).expect("graph edges and sightings name live keyframes")
    }

    pub(super) fn with_keyframe(&mut self, id: KeyFrameId, f: impl FnOnce(&mut KeyFrame)) -> bool {
        self.keyframes.get_mut(id.index()).map(f).is_some()
    }

    pub(super) fn with_point(&mut self, id: MapPointId, f: impl FnOnce(&mut MapPoint)) -> bool {
        self.points.get_mut(id.index()).map(f).is_some()
    }

    fn add_keyframe(&mut self, keyframe: &KeyFrame) -> bool {
        assert_eq!(keyframe.id, self.next_keyframe(), "keyframe ids count up");
        let mut keyframe = keyframe.clone();
        let points = keyframe.points.clone();
        keyframe.points.fill(None);
        let id = KeyFrameId::from(self.keyframes.push(keyframe));
        for (index, point) in points.iter().enumerate() {
            if let Some(point) = point {
                self.observe(*point, id, index as u32);
            }
        }
        true
    }

    fn add_point(&mut self, new: &NewPoint) -> bool {
        let Some(keyframe) = self.keyframe(new.keyframe) else { return false };
        if keyframe.points[new.index as usize].is_some() {
            return false;
        }
        let to_point = new.position - keyframe.center();
        let id = self.next_point();
        let point = MapPoint {
            id,
            map: keyframe.map,
            position: new.position,
            seen_in: Sightings::new(),
            descriptor: keyframe.obs.descriptor[new.index as usize],
            described: 0,
            normal: to_point / to_point.norm(),
            range_m: [0.0, f64::INFINITY],
            created_in: new.keyframe,
            created_at: new.frame,
            class: new.class,
            visible: 1,
            found: 1,
            doubts: 0,
        };
        self.points.push(point);
        self.observe(id, new.keyframe, new.index)
    }

    fn observe(&mut self, point: MapPointId, keyframe: KeyFrameId, index: u32) -> bool {
        let Some(k) = self.keyframe(keyframe) else { return false };
        if self.point(point).is_none() || k.points[index as usize].is_some() {
            return false;
        }
        let sighting = Sighting {
            keyframe,
            index: u16::try_from(index).expect("the configuration allows no more keypoints"),
            with_depth: k.obs.depth(index as usize).is_some(),
        };
        let seen_in = &mut self.points.get_mut(point.index()).expect("checked above").seen_in;
        let Err(position) = seen_in.binary_search_by_key(&keyframe, |s| s.keyframe) else { return false };
        seen_in.insert(position, sighting);
        self.keyframe_mut(keyframe).points[index as usize] = Some(point);
        true
    }

    /// Removes one observation; a point that nobody sees any more goes too.
    pub(super) fn unobserve(&mut self, point: MapPointId, keyframe: KeyFrameId) -> bool {
        let Some(p) = self.points.get_mut(point.index()) else { return false };
        let Ok(position) = p.seen_in.binary_search_by_key(&keyframe, |s| s.keyframe) else { return false };
        let sighting = p.seen_in.remove(position);
        let orphan = p.seen_in.is_empty();
        self.keyframe_mut(keyframe).points[sighting.index as usize] = None;
        if orphan {
            self.points.remove(point.index());
        }
        true
    }

    fn cull_point(&mut self, id: MapPointId) -> bool {
        let Some(sightings) = self.point(id).map(|p| p.seen_in.clone()) else { return false };
        for sighting in sightings {
            self.keyframe_mut(sighting.keyframe).points[sighting.index as usize] = None;
        }
        self.points.remove(id.index())
    }

    fn merge(&mut self, keep: MapPointId, drop: MapPointId) -> bool {
        if keep == drop || self.point(keep).is_none() {
            return false;
        }
        let Some(dropped) = self.point(drop).cloned() else { return false };
        self.cull_point(drop);
        for sighting in &dropped.seen_in {
            self.observe(keep, sighting.keyframe, u32::from(sighting.index));
        }
        self.with_point(keep, |p| {
            p.visible += dropped.visible;
            p.found += dropped.found;
        });
        self.merged.insert(drop, keep);
        true
    }
}

impl MapEdit {
    /// Name of the kind of edit.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::AddKeyFrame(_) => "add keyframe",
            Self::AddPoint(_) => "add point",
            Self::Observe(..) => "observe",
            Self::Unobserve(..) => "unobserve",
            Self::MergePoints { .. } => "merge points",
            Self::SetPose(..) => "set pose",
            Self::SetPosition(..) => "set position",
            Self::CountSight(..) => "count sight",
            Self::SetDoubts(..) => "set doubts",
            Self::Refresh(..) => "refresh",
            Self::Connect(_) => "connect",
            Self::CullPoint(_) => "cull point",
            Self::CullKeyFrame(_) => "cull keyframe",
            Self::LinkLoop(..) => "link loop",
            Self::Correct(_) => "correct",
        }
    }

    /// The same edit with the ids of points replaced; none if one of them has no replacement.
    #[must_use]
    pub fn renamed(self, now: impl Fn(MapPointId) -> Option<MapPointId>) -> Option<Self> {
        Some(match self {
            Self::AddKeyFrame(mut keyframe) => {
                keyframe.points.iter_mut().for_each(|point| *point = point.and_then(&now));
                Self::AddKeyFrame(keyframe)
            }
            Self::Observe(point, keyframe, index) => Self::Observe(now(point)?, keyframe, index),
            Self::Unobserve(point, keyframe) => Self::Unobserve(now(point)?, keyframe),
            Self::MergePoints { keep, drop } => Self::MergePoints { keep: now(keep)?, drop: now(drop)? },
            Self::SetPosition(id, position) => Self::SetPosition(now(id)?, position),
            Self::CountSight(id, found) => Self::CountSight(now(id)?, found),
            Self::SetDoubts(id, doubts) => Self::SetDoubts(now(id)?, doubts),
            Self::Refresh(id, appearance) => Self::Refresh(now(id)?, appearance),
            Self::CullPoint(id) => Self::CullPoint(now(id)?),
            // A correction makes no points and speaks of none that a job has made.
            Self::AddPoint(_)
            | Self::SetPose(..)
            | Self::Connect(_)
            | Self::CullKeyFrame(_)
            | Self::LinkLoop(..)
            | Self::Correct(_) => self,
        })
    }

    /// Canonical bytes.
    pub fn digest(&self, w: &mut DigestWriter) {
        w.str(self.name());
        match self {
            Self::AddKeyFrame(k) => {
                w.u32(k.id.0);
                w.f64s(&k.camera_from_world.rows());
                for point in &k.points {
                    w.u32(point.map_or(u32::MAX, |p| p.0));
                }
            }
            Self::AddPoint(p) => {
                w.u32(p.keyframe.0);
                w.u32(p.index);
                w.f64s(p.position.as_slice());
                w.u8(p.class as u8);
            }
            Self::Observe(point, keyframe, index) => [point.0, keyframe.0, *index].iter().for_each(|v| w.u32(*v)),
            Self::Unobserve(point, keyframe) => [point.0, keyframe.0].iter().for_each(|v| w.u32(*v)),
            Self::MergePoints { keep, drop } => [keep.0, drop.0].iter().for_each(|v| w.u32(*v)),
            Self::SetPose(id, pose) => {
                w.u32(id.0);
                w.f64s(&pose.rows());
            }
            Self::SetPosition(id, position) => {
                w.u32(id.0);
                w.f64s(position.as_slice());
            }
            Self::CountSight(id, found) => [id.0, u32::from(*found)].iter().for_each(|v| w.u32(*v)),
            Self::SetDoubts(id, doubts) => [id.0, *doubts].iter().for_each(|v| w.u32(*v)),
            Self::Refresh(id, appearance) => {
                w.u32(id.0);
                appearance.descriptor.iter().for_each(|word| w.u64(*word));
                w.f64s(appearance.normal.as_slice());
                w.f64s(&appearance.range_m);
            }
            Self::Connect(id) | Self::CullKeyFrame(id) => w.u32(id.0),
            Self::CullPoint(id) => w.u32(id.0),
            Self::LinkLoop(a, b) => [a.0, b.0].iter().for_each(|v| w.u32(*v)),
            Self::Correct(correction) => correction.digest(w),
        }
    }
}
