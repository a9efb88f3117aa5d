//! Turns rows into chunks with counted ids: the smallest unit the viewer stores.

use std::collections::BTreeMap;

use re_chunk::{Chunk, ChunkId, RowId};
use re_log_types::{ArrowMsg, TimePoint};
use re_sdk_types::SerializedComponentBatch;
use re_tuid::Tuid;

use crate::RrdError;

/// Rows of one entity gathered before they are written: small ones (poses, scalars) share a chunk, which keeps the file
/// lean and quick to open.
const MAX_ROWS: usize = 64;

/// Bytes of one entity gathered before they are written. An image exceeds it alone and thus goes out at once.
const MAX_BYTES: usize = 16 * 1024;

/// Hands out ids in order of the calls. One serves the whole file, so no two stores, chunks or rows share an id.
#[derive(Default)]
pub struct Ids(u64);

impl Ids {
    /// The next id.
    pub fn next(&mut self) -> Tuid {
        self.0 += 1;
        Tuid::from_nanos_and_inc(self.0, self.0)
    }
}

/// One log call: components of one entity at one time.
struct Row {
    id: RowId,
    time: TimePoint,
    components: Vec<SerializedComponentBatch>,
}

/// Rows of one entity that wait for company.
#[derive(Default)]
struct Pending {
    rows: Vec<Row>,
    bytes: usize,
}

/// Gathers rows by entity and gives back chunks when they are worth writing.
#[derive(Default)]
pub struct Chunks {
    pending: BTreeMap<String, Pending>,
}

impl Chunks {
    /// Takes one row; returns a chunk when enough of the entity's rows have come together. A static row (no time) is a
    /// chunk of its own, since a chunk's rows share their timelines.
    pub fn push(
        &mut self,
        ids: &mut Ids,
        entity: &str,
        time: TimePoint,
        components: Vec<SerializedComponentBatch>,
    ) -> Result<Option<ArrowMsg>, RrdError> {
        let row = Row { id: RowId::from_tuid(ids.next()), time, components };
        if row.time.is_static() {
            return build(ids, entity, vec![row]).map(Some);
        }
        if !self.pending.contains_key(entity) {
            self.pending.insert(entity.to_owned(), Pending::default());
        }
        let Some(pending) = self.pending.get_mut(entity) else { return Ok(None) };
        pending.bytes += row.components.iter().map(|c| c.array.get_buffer_memory_size()).sum::<usize>();
        pending.rows.push(row);
        if pending.rows.len() < MAX_ROWS && pending.bytes < MAX_BYTES {
            return Ok(None);
        }
        let full = std::mem::take(pending);
        build(ids, entity, full.rows).map(Some)
    }

    /// One row as a chunk of its own, for a viewer that waits for it.
    pub fn single(
        ids: &mut Ids,
        entity: &str,
        time: TimePoint,
        components: Vec<SerializedComponentBatch>,
    ) -> Result<ArrowMsg, RrdError> {
        let row = Row { id: RowId::from_tuid(ids.next()), time, components };
        build(ids, entity, vec![row])
    }

    /// The chunks of all rows still waiting, entity by entity in alphabetical order.
    pub fn drain(&mut self, ids: &mut Ids) -> Result<Vec<ArrowMsg>, RrdError> {
        std::mem::take(&mut self.pending)
            .into_iter()
            .filter(|(_, pending)| !pending.rows.is_empty())
            .map(|(entity, pending)| build(ids, &entity, pending.rows))
            .collect()
    }
}

/// Writes rows of one entity into one chunk.
fn build(ids: &mut Ids, entity: &str, rows: Vec<Row>) -> Result<ArrowMsg, RrdError> {
    let mut builder = Chunk::builder_with_id(ChunkId::from_tuid(ids.next()), entity);
    for row in rows {
        builder = builder.with_serialized_batches(row.id, row.time, row.components);
    }
    let chunk = builder.build().map_err(|e| RrdError::encode(entity, &e))?;
    chunk.to_arrow_msg().map_err(|e| RrdError::encode(entity, &e))
}
