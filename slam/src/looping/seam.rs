//! Where the two ends of a loop, or two maps, lie upon each other: moved together and sewn up.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use slam_math::{Buffers, KeyFrameId, MapId, MapPointId, Se3, Sim3};

use super::detect::LoopFound;
use super::guided::Place;
use crate::context::Context;
use crate::map::{Correction, Join, KeyFrame, Map, MapEdit};
use crate::mapping::{Editor, fuse_into};

/// A snapshot on which the end of a loop has been moved and fused with the place as it was known.
pub(super) struct Seam {
    /// The map with the window moved and fused; the rest is where it was.
    pub map: Map,
    /// The keyframe that found the place and its neighbours, sorted: what was moved as one.
    pub window: Vec<KeyFrameId>,
    /// The place as it was known.
    pub place: Place,
    /// Edits after the move.
    pub journal: Vec<MapEdit>,
    /// Scale of the move, and the part that moved as a whole when two are joined.
    scale: f64,
    joining: Option<MapId>,
}

impl Seam {
    /// Moves the neighbourhood of the keyframe that found the place - the whole part when it joins another one - and
    /// fuses what both ends see.
    pub fn sew(ctx: &Context, before: &Map, found: &LoopFound) -> Option<Self> {
        let keyframe = before.keyframe(found.keyframe)?;
        let middle = before.keyframe(found.matched)?;
        let place = Place::around(before, middle, ctx.config.looping.weld_keyframes);
        let mut window: Vec<KeyFrameId> = keyframe.covisible.iter().map(|(id, _)| *id).collect();
        window.push(keyframe.id);
        window.sort_unstable();
        // A keyframe that already sees both ends is held: it ties them as they are.
        window.retain(|id| place.keyframes.binary_search(id).is_err());

        let mut map = before.clone();
        map.apply(&MapEdit::Correct(Box::new(first_move(before, keyframe, middle, &window, found))));
        let mut editor = Editor::new(&mut map, &ctx.buffers);
        for (index, point) in &found.pairs {
            pair(&mut editor, keyframe.id, *index, *point);
        }
        let targets = window.clone();
        for target in &targets {
            fuse_into(ctx, &mut editor, *target, &place.points);
        }
        for &point in &editor.map().points_seen_by(&[keyframe.id], &ctx.buffers) {
            editor.refresh(ctx, point);
        }
        for id in &targets {
            editor.apply(MapEdit::Connect(*id));
        }
        editor.apply(MapEdit::LinkLoop(found.keyframe, found.matched));
        let journal = editor.finish().0.into_edits().to_vec();
        let joining = found.joins.then_some(keyframe.map);
        Some(Self { map, window, place, journal, scale: found.corrected_from_world.scale, joining })
    }

    /// Pose of a keyframe in the seam's world, with the scale of its own old world: `camera_from_corrected`.
    pub fn pose(&self, before: &Map, id: KeyFrameId) -> Option<Sim3> {
        let se3 = self.map.keyframe(id)?.camera_from_world;
        let has_moved = match self.joining {
            Some(part) => before.keyframe(id)?.map == part,
            None => self.window.binary_search(&id).is_ok(),
        };
        let scale = if has_moved { 1.0 / self.scale } else { 1.0 };
        Some(Sim3 { scale, se3: Se3 { translation: se3.translation * scale, ..se3 } })
    }

    /// Edges between the window and the rest that fusing has made, each with the older keyframe first.
    pub fn new_edges(&self, before: &Map) -> Vec<(KeyFrameId, KeyFrameId)> {
        let mut edges = Vec::new();
        for keyframe in self.window.iter().filter_map(|id| self.map.keyframe(*id)) {
            let old = before.keyframe(keyframe.id).map(|k| k.covisible.as_slice()).unwrap_or_default();
            let fresh = keyframe.covisible.iter().map(|(id, _)| *id).chain(keyframe.loops.iter().copied());
            let is_new =
                |id: &KeyFrameId| self.window.binary_search(id).is_err() && !old.iter().any(|(other, _)| other == id);
            edges.extend(fresh.filter(is_new).map(|other| (keyframe.id.min(other), keyframe.id.max(other))));
        }
        edges.sort_unstable();
        edges.dedup();
        edges
    }
}

/// The rough move: the window by what was found, all else not at all; of two parts the whole part.
fn first_move(
    before: &Map,
    keyframe: &KeyFrame,
    middle: &KeyFrame,
    window: &[KeyFrameId],
    found: &LoopFound,
) -> Correction {
    let by = found.corrected_from_world;
    let moves = |id: KeyFrameId| found.joins || window.binary_search(&id).is_ok();
    let part = before.keyframes().filter(|k| k.map == keyframe.map);
    let keyframes = part.map(|k| (k.id, if moves(k.id) { by } else { Sim3::identity() })).collect();
    // What is seen moves along, whoever made it and whether that keyframe lives or not.
    let seen: Vec<MapPointId> = match found.joins {
        true => before.points().filter(|p| p.map == keyframe.map).map(|p| p.id).collect(),
        false => before.points_seen_by(window, &Buffers::default()).to_vec(),
    };
    let away = |id: &MapPointId| before.point(*id).map(|p| (*id, by.transform(&p.position) - p.position));
    let join = Join { map: keyframe.map, into: middle.map, at: (keyframe.id, middle.id) };
    Correction {
        based_on: before.corrections(),
        keyframes,
        points: seen.iter().filter_map(away).collect(),
        join: found.joins.then_some(join),
        then: Vec::new(),
    }
}

/// A keypoint of the keyframe shows a point of the place.
fn pair(editor: &mut Editor<'_>, keyframe: KeyFrameId, index: u32, point: MapPointId) {
    let holder = editor.map().keyframe(keyframe).and_then(|k| k.points[index as usize]);
    let Some(point) = editor.map().current_point(point) else { return };
    match holder {
        None => editor.apply(MapEdit::Observe(point, keyframe, index)),
        Some(holder) if holder != point => editor.apply(MapEdit::MergePoints { keep: point, drop: holder }),
        Some(_) => false,
    };
}

/// The final correction: every keyframe of the part from where `before` has it to where `poses` put it, points by what
/// `positions` say.
pub(super) fn correction(
    before: &Map,
    poses: &BTreeMap<KeyFrameId, Sim3>,
    positions: &BTreeMap<MapPointId, Vector3<f64>>,
) -> Correction {
    let moved = |(id, pose): (&KeyFrameId, &Sim3)| {
        let was = before.keyframe(*id)?.camera_from_world;
        Some((*id, pose.inverse() * Sim3::from(was)))
    };
    let away = |(id, position): (&MapPointId, &Vector3<f64>)| before.point(*id).map(|p| (*id, position - p.position));
    Correction {
        based_on: before.corrections(),
        keyframes: poses.iter().filter_map(moved).collect(),
        points: positions.iter().filter_map(away).collect(),
        join: None,
        then: Vec::new(),
    }
}
