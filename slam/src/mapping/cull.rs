//! What does not earn its place leaves the map.

use serde::{Deserialize, Serialize};
use slam_math::{KeyFrameId, MapPointId};

use super::Editor;
use crate::context::Context;
use crate::map::{MapEdit, Renaming};

/// Points on probation, oldest first.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct YoungPoints(Vec<MapPointId>);

impl YoungPoints {
    /// A point was made.
    pub fn push(&mut self, id: MapPointId) {
        self.0.push(id);
    }

    /// After a job was applied: its new points have other ids in the live map.
    pub fn rename(&mut self, renaming: &Renaming) {
        self.0 = self.0.iter().filter_map(|id| renaming.now(*id)).collect();
    }

    /// Removes young points that are seldom found or that no second keyframe sees; the others grow up. `current` is
    /// the newest keyframe. Returns the number removed.
    pub fn cull(&mut self, ctx: &Context, editor: &mut Editor<'_>, current: KeyFrameId) -> u32 {
        let m = &ctx.config.mapping;
        let min_weight = if ctx.is_monocular() { ctx.config.monocular.min_weight } else { m.min_weight };
        let (mut kept, mut culled) = (Vec::with_capacity(self.0.len()), 0);
        for id in std::mem::take(&mut self.0) {
            let Some(point) = editor.map().point(id) else { continue };
            let age = current.0.saturating_sub(point.created_in.0);
            let lonely = age + 1 >= m.young_keyframes && point.weight() < min_weight;
            if point.found_ratio() < m.min_found_ratio || lonely {
                editor.apply(MapEdit::CullPoint(id));
                culled += 1;
            } else if age < m.young_keyframes {
                kept.push(id);
            }
        }
        self.0 = kept;
        culled
    }
}

/// Observers that make a point's observation in one more keyframe superfluous.
const ENOUGH_OBSERVERS: usize = 3;

/// Removes neighbours of a keyframe whose close points are nearly all seen by others at the same or a finer scale.
pub(super) fn cull_keyframes(ctx: &Context, editor: &mut Editor<'_>, current: KeyFrameId) -> u32 {
    let Some(keyframe) = editor.map().keyframe(current) else { return 0 };
    let mut neighbours: Vec<KeyFrameId> = keyframe.covisible.iter().map(|(id, _)| *id).collect();
    neighbours.sort_unstable();
    let mut culled = 0;
    for id in neighbours {
        if is_redundant(ctx, editor, id) && editor.apply(MapEdit::CullKeyFrame(id)) {
            culled += 1;
        }
    }
    culled
}

fn is_redundant(ctx: &Context, editor: &Editor<'_>, id: KeyFrameId) -> bool {
    let map = editor.map();
    let Some(keyframe) = map.keyframe(id) else { return false };
    if keyframe.parent.is_none() {
        return false;
    }
    let share = ctx.config.mapping.redundant_share;
    let at_most = keyframe.points.iter().flatten().count();
    let (mut close, mut redundant) = (0, 0);
    for (i, point) in keyframe.points.iter().enumerate() {
        // Most keyframes are soon seen to be needed: the rest of their points can not make up for these.
        if ((at_most - (close - redundant)) as f64) <= share * at_most as f64 {
            return false;
        }
        let near = ctx.is_monocular() || keyframe.obs.depth(i).is_some_and(|z| z <= ctx.close_m);
        let Some(point) = point.filter(|_| near).and_then(|p| map.point(p)) else { continue };
        close += 1;
        let octave = keyframe.obs.octave[i];
        let others = point.seen_in.iter().filter(|s| {
            let other = map.keyframe(s.keyframe).filter(|k| k.id != id);
            other.is_some_and(|k| k.obs.octave[s.index as usize] <= octave + 1)
        });
        redundant += usize::from(others.take(ENOUGH_OBSERVERS).count() == ENOUGH_OBSERVERS);
    }
    close > 0 && redundant as f64 > share * close as f64
}
