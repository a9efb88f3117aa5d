//! Changes a map and remembers how.

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, Buffers, MapPointId};

use super::{EditCounts, Map, MapEdit};
use crate::context::Context;

/// Applies edits to a map one after the other and keeps those that had an effect: the record of a stage on the live
/// map, the result of a job on a snapshot.
pub struct Editor<'a> {
    map: &'a mut Map,
    journal: Journal,
    counts: EditCounts,
}

impl<'a> Editor<'a> {
    /// An editor with an empty journal.
    pub fn new(map: &'a mut Map, buffers: &Buffers) -> Self {
        let journal = Journal { edits: buffers.empty(), first_new: map.next_point() };
        Self { map, journal, counts: EditCounts::default() }
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
        if applied {
            self.journal.edits.push(edit);
        }
        applied
    }

    /// Recomputes descriptor, normal and range of a point from its observations.
    pub fn refresh(&mut self, ctx: &Context, id: MapPointId) {
        if let Some(appearance) = self.map.appearance(ctx, id) {
            self.apply(MapEdit::Refresh(id, appearance));
        }
    }

    /// Does to this map what a job did to a snapshot of it. What died since the snapshot stays dead: edits of it are
    /// counted as void. Points that the job made get the next free ids here.
    pub fn replay(&mut self, mut journal: Journal) -> Renaming {
        let mut renaming = Renaming { first_new: journal.first_new, now: Vec::new() };
        for edit in journal.edits.drain(..) {
            let next = self.map.next_point();
            let makes_point = matches!(edit, MapEdit::AddPoint(_));
            let applied = match edit.renamed(|id| renaming.now(id)) {
                Some(edit) => self.apply(edit),
                None => {
                    self.counts.void += 1;
                    false
                }
            };
            if makes_point {
                renaming.now.push(applied.then_some(next));
            }
        }
        renaming
    }

    /// The edits that had an effect, and how many there were.
    #[must_use]
    pub fn finish(self) -> (Journal, EditCounts) {
        (self.journal, self.counts)
    }
}

/// Edits in order, all of which had an effect on the map they were made for.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Journal {
    edits: Buffer<MapEdit>,
    /// The id that the map gave to the first new point.
    first_new: MapPointId,
}

impl Journal {
    /// The edits in order.
    #[must_use]
    pub fn edits(&self) -> &[MapEdit] {
        &self.edits
    }

    /// The edits themselves.
    #[must_use]
    pub fn into_edits(self) -> Buffer<MapEdit> {
        self.edits
    }
}

/// Which points of the live map the points of a job are.
#[derive(Debug, Clone)]
pub struct Renaming {
    first_new: MapPointId,
    /// What became of each point that the job made.
    now: Vec<Option<MapPointId>>,
}

impl Renaming {
    /// The id in the live map; none for a point that could not be made there.
    #[must_use]
    pub fn now(&self, id: MapPointId) -> Option<MapPointId> {
        match id.0.checked_sub(self.first_new.0) {
            None => Some(id),
            Some(made) => self.now.get(made as usize).copied().flatten(),
        }
    }
}
