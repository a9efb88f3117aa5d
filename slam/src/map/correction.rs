//! One consistent move of many keyframes and points: what closing a loop, joining two parts of the atlas and global
//! bundle adjustment come to.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use slam_math::{DigestWriter, KeyFrameId, MapId, MapPointId, Se3, Sim3};

use super::{Map, MapEdit};

/// A move computed on a snapshot of the map, applied to the map as it is by then.
///
/// It says how far things move, not where they are: what local bundle adjustment did in the meantime is kept. What is
/// newer than the snapshot follows: keyframes their nearest ancestor in the spanning tree, points the keyframe that made
/// them.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Correction {
    /// [`Map::corrections`] of the snapshot. A correction of a map that was corrected since does nothing: it speaks of a
    /// world that is gone.
    pub based_on: u32,
    /// `corrected_from_world` of keyframes of the snapshot, sorted by id. Those that are in no list and have no ancestor
    /// in it stay.
    pub keyframes: Vec<(KeyFrameId, Sim3)>,
    /// Points that do not just follow their keyframe: how far each one moves, metres; sorted by id.
    #[serde(with = "slam_math::vector::keyed")]
    pub points: Vec<(MapPointId, Vector3<f64>)>,
    /// Two parts of the atlas become one.
    pub join: Option<Join>,
    /// What makes sense only after the move: points that turn out to be one, new edges of the graph.
    pub then: Vec<MapEdit>,
}

/// Two parts of the atlas become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Join {
    /// The part that ends.
    pub map: MapId,
    /// The part that it becomes.
    pub into: MapId,
    /// A keyframe of each, of `map` and of `into`, that see the same place: there the spanning trees are tied.
    pub at: (KeyFrameId, KeyFrameId),
}

impl Correction {
    /// `corrected_from_world` for what hangs on a keyframe, alive or removed; `None` when it does not move.
    #[must_use]
    pub fn of(&self, map: &Map, id: KeyFrameId) -> Option<Sim3> {
        let mut id = id;
        loop {
            if let Ok(i) = self.keyframes.binary_search_by_key(&id, |(id, _)| *id) {
                return Some(self.keyframes[i].1);
            }
            id = match map.keyframe(id) {
                Some(keyframe) => keyframe.parent?,
                None => map.removed.get(&id)?.0,
            };
        }
    }

    /// Canonical bytes.
    pub(super) fn digest(&self, w: &mut DigestWriter) {
        w.u32(self.based_on);
        for (id, by) in &self.keyframes {
            w.u32(id.0);
            w.f64(by.scale);
            w.f64s(&by.se3.rows());
        }
        for (id, by) in &self.points {
            w.u32(id.0);
            w.f64s(by.as_slice());
        }
        if let Some(join) = &self.join {
            [join.map.0, join.into.0, join.at.0.0, join.at.1.0].iter().for_each(|v| w.u32(*v));
        }
        self.then.iter().for_each(|edit| edit.digest(w));
    }
}

/// The pose that sees a world moved by `corrected_from_world` as `camera_from_world` saw it before. The camera's own unit
/// of length follows the scale, so that the result is rigid.
#[must_use]
pub fn moved_pose(camera_from_world: &Se3, corrected_from_world: &Sim3) -> Se3 {
    (Sim3::from(*camera_from_world) * corrected_from_world.inverse()).to_se3().normalized()
}

impl Map {
    pub(super) fn correct(&mut self, correction: &Correction) -> bool {
        if correction.based_on != self.corrections {
            return false;
        }
        // Keyframes first to last decide before any of them moves or changes its parent.
        let ids = 0..self.next_keyframe().0;
        let moves: Vec<Option<Sim3>> = ids.map(|id| correction.of(self, KeyFrameId(id))).collect();
        let of = |id: KeyFrameId| moves.get(id.index()).copied().flatten();

        let points: Vec<MapPointId> = self.points().map(|p| p.id).collect();
        for id in points {
            let own = correction.points.binary_search_by_key(&id, |(id, _)| *id).ok();
            let by = self.point(id).and_then(|p| of(p.created_in));
            self.with_point(id, |p| {
                p.position = match (own, by) {
                    (Some(i), _) => p.position + correction.points[i].1,
                    (None, Some(by)) => by.transform(&p.position),
                    (None, None) => return,
                };
                if let Some(by) = by {
                    p.normal = by.se3.rotation * p.normal;
                    p.range_m = p.range_m.map(|d| d * by.scale);
                }
            });
        }
        for (id, by) in (0..).map(KeyFrameId).zip(&moves) {
            let Some(by) = by.filter(|by| *by != Sim3::identity()) else { continue };
            if let Some((_, from_parent)) = self.removed.get_mut(&id) {
                from_parent.translation *= by.scale;
            }
            self.with_keyframe(id, |k| k.camera_from_world = moved_pose(&k.camera_from_world, &by));
        }
        if let Some(join) = &correction.join {
            self.join(join);
        }
        self.corrections += 1;
        for edit in &correction.then {
            self.apply(edit);
        }
        true
    }

    fn join(&mut self, join: &Join) {
        let keyframes: Vec<_> = self.keyframes().filter(|k| k.map == join.map).map(|k| k.id).collect();
        let points: Vec<_> = self.points().filter(|p| p.map == join.map).map(|p| p.id).collect();
        for id in keyframes {
            self.with_keyframe(id, |k| k.map = join.into);
        }
        for id in points {
            self.with_point(id, |p| p.map = join.into);
        }
        self.hang(join.at.0, join.at.1);
    }
}
