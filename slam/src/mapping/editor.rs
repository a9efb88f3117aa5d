//! Changes the map and remembers how.

use slam_math::MapPointId;

use crate::context::Context;
use crate::map::{EditCounts, Map, MapEdit};

/// Applies edits to a map one after the other and keeps them: the journal is the record of the stage, and what a
/// background job would hand over.
pub struct Editor<'a> {
    map: &'a mut Map,
    /// The edits in order.
    pub journal: Vec<MapEdit>,
    /// How many took effect.
    pub counts: EditCounts,
}

impl<'a> Editor<'a> {
    /// An editor with an empty journal.
    pub fn new(map: &'a mut Map) -> Self {
        Self { map, journal: Vec::new(), counts: EditCounts::default() }
    }

    /// The map as it is now.
    #[must_use]
    pub fn map(&self) -> &Map {
        self.map
    }

    /// Applies an edit; false when its subject is gone.
    pub fn apply(&mut self, edit: MapEdit) -> bool {
        let applied = self.map.apply(&edit);
        self.counts.applied += u64::from(applied);
        self.counts.void += u64::from(!applied);
        self.journal.push(edit);
        applied
    }

    /// Recomputes descriptor, normal and range of a point. The range follows the keyframe that made the point, or the
    /// oldest that still sees it.
    pub fn refresh(&mut self, ctx: &Context, id: MapPointId) {
        let Some(point) = self.map.point(id) else { return };
        let sighting = point.sighting(point.created_in).or(point.seen_in.first());
        let keyframe = sighting.and_then(|s| self.map.keyframe(s.keyframe).map(|k| (k, s.index as usize)));
        let Some((keyframe, index)) = keyframe else { return };
        let distance = (point.position - keyframe.center()).norm();
        self.apply(MapEdit::Refresh(id, ctx.range_of(distance, keyframe.obs.octave[index])));
    }
}
