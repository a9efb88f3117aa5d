//! Place recognition without a vocabulary: which keyframes show the same descriptors as a query?
//!
//! Multi-index hashing (Norouzi, Punjani, Fleet, "Fast search in Hamming space with multi-index hashing", CVPR 2012):
//! two descriptors that differ in few bits agree exactly in at least one of several 16-bit samples of their bits.
//! Entries that share a sample are compared in full, and a keyframe gets one vote for each query descriptor that has
//! a close counterpart in it. Nothing has to be trained, and results depend only on what is stored, not on the order in
//! which it was added.
//!
//! Chosen by measurement over a [`WordIndex`](crate::WordIndex) with k = 10, L = 4 (`cargo run --release -p replayer
//! --example places -- static.mcap moving_box.mcap placing_box.mcap robots_people.mcap`, 353 keyframes; three candidates a
//! keyframe, which each method filled, 859 in all, without other checks):
//!
//! | | see a fifth of the same | overlap by half | found, of 20 with a match | ms at 100 / 1,000 / 10,000 keyframes |
//! |---|---|---|---|---|
//! | this index | 564 (66 %) | 21 | 19 | 0.53 / 2.75 / 3.91 |
//! | words trained on the synthetic world | 526 (61 %) | 18 | 18 | 0.09 / 0.44 / 2.76 |
//! | words trained on these same logs | 598 (70 %) | 17 | 17 | 0.09 / 0.27 / 1.60 |
//!
//! The only words that could be shipped are slightly worse, and only one log has true matches: 19 against 18 decides
//! nothing. Words are up to six times (the logs' own, ten times) as fast and take 12 bytes a descriptor instead of 80, but
//! their time grows with the map while that of the index is bounded, and a few milliseconds a keyframe in the background do
//! not matter. So the index stays: not because it is faster, but because it needs no training data that resembles the place.

use std::collections::BTreeMap;

use crate::{Descriptor, hamming};

/// Bit samples per descriptor. At 12 % differing bits (typical for the same corner seen again) a counterpart is found
/// with probability 1 - (1 - 0.88^16)^8 = 67 %.
const TABLES: usize = 8;
const BUCKETS: usize = 1 << 16;
/// Two descriptors count as the same corner up to this distance (of 256 bits).
const MAX_DISTANCE: u32 = 64;
/// Entries that a query compares in full at most: what bounds its time however many keyframes there are. The fullest
/// buckets, which say least about the place, are left out first. A bit less than a hundred keyframes lose nothing.
const MAX_COMPARED: u32 = 20_000;
/// Descriptors kept per keyframe, spread evenly over the given list; 80 bytes each.
const MAX_DESCRIPTORS: usize = 500;
/// End of a chain.
const NIL: u32 = u32::MAX;

/// Index over the descriptors of keyframes. Takes 80 bytes a descriptor (at most 500 a keyframe) plus 4 MiB.
#[derive(Debug, Clone)]
pub struct PlaceIndex {
    /// Keyframe id -> its entries.
    keyframes: BTreeMap<u32, Vec<u32>>,
    entries: Vec<Entry>,
    free: Vec<u32>,
    tables: Vec<Table>,
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    descriptor: Descriptor,
    keyframe: u32,
    /// Which of the keyframe's keypoints.
    keypoint: u32,
    /// Next entry of the same bucket, a table each.
    next: [u32; TABLES],
}

/// First entry and number of entries of every bucket.
#[derive(Debug, Clone)]
struct Table {
    head: Vec<u32>,
    len: Vec<u32>,
}

impl Default for PlaceIndex {
    fn default() -> Self {
        Self::new()
    }
}

impl PlaceIndex {
    /// An empty index.
    #[must_use]
    pub fn new() -> Self {
        let table = Table { head: vec![NIL; BUCKETS], len: vec![0; BUCKETS] };
        Self { keyframes: BTreeMap::new(), entries: Vec::new(), free: Vec::new(), tables: vec![table; TABLES] }
    }

    /// Number of keyframes in the index.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keyframes.len()
    }

    /// Whether the index holds no keyframe.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keyframes.is_empty()
    }

    /// Stores descriptors of a keyframe (ids count up: a query takes 8 bytes for each below the largest), each with the number of its keypoint, in place of what the same id held before.
    pub fn add(&mut self, keyframe_id: u32, keypoints: &[(u32, Descriptor)]) {
        self.remove(keyframe_id);
        let slots = spread(keypoints).map(|(keypoint, d)| self.insert(keyframe_id, *keypoint, d)).collect();
        self.keyframes.insert(keyframe_id, slots);
    }

    /// Forgets a keyframe; false when it was not there.
    pub fn remove(&mut self, keyframe_id: u32) -> bool {
        let Some(slots) = self.keyframes.remove(&keyframe_id) else { return false };
        for slot in slots {
            self.unlink(slot);
            self.free.push(slot);
        }
        true
    }

    /// The keyframes that share most with `descriptors`: (id, number of query descriptors with a counterpart there),
    /// best first, equal scores by ascending id. Keyframes without a vote are left out. At most 500 of the query's
    /// descriptors, spread evenly, are looked up.
    ///
    /// `votes(keyframe, keypoint)` says whether a stored keypoint may vote: what has turned out to move since has no say.
    #[must_use]
    pub fn query(
        &self,
        descriptors: &[Descriptor],
        max_results: usize,
        votes: impl Fn(u32, u32) -> bool,
    ) -> Vec<(u32, u32)> {
        let ids = self.keyframes.last_key_value().map_or(0, |(id, _)| *id as usize + 1);
        // Per keyframe: votes, and the last query descriptor that voted for it.
        let mut count: Vec<(u32, u32)> = vec![(0, u32::MAX); ids];
        let wanted: Vec<&Descriptor> = spread(descriptors).collect();
        for (turn, table) in self.affordable(&wanted) {
            let descriptor = wanted[turn as usize];
            let mut slot = self.tables[table].head[key(descriptor, table)];
            while slot != NIL {
                let entry = &self.entries[slot as usize];
                slot = entry.next[table];
                let (count, last) = &mut count[entry.keyframe as usize];
                let new = *last != turn && hamming(descriptor, &entry.descriptor) <= MAX_DISTANCE;
                if new && votes(entry.keyframe, entry.keypoint) {
                    (*count, *last) = (*count + 1, turn);
                }
            }
        }
        let mut ranked: Vec<(u32, u32)> =
            (0..).zip(count).map(|(id, (n, _))| (id, n)).filter(|(_, n)| *n > 0).collect();
        ranked.sort_by_key(|&(id, count)| (std::cmp::Reverse(count), id));
        ranked.truncate(max_results);
        ranked
    }

    /// Which buckets to look into: query descriptor and table, in that order. The smallest ones that together hold at
    /// most [`MAX_COMPARED`] entries.
    fn affordable(&self, wanted: &[&Descriptor]) -> Vec<(u32, usize)> {
        let mut buckets: Vec<(u32, u32, usize)> = Vec::with_capacity(wanted.len() * TABLES);
        for (turn, descriptor) in (0..).zip(wanted) {
            let lengths = self.tables.iter().enumerate().map(|(table, t)| (t.len[key(descriptor, table)], turn, table));
            buckets.extend(lengths.filter(|(len, ..)| *len > 0));
        }
        buckets.sort_unstable();
        let mut left = MAX_COMPARED;
        let affordable = buckets.into_iter().map_while(|(len, turn, table)| {
            left = left.checked_sub(len)?;
            Some((turn, table))
        });
        let mut affordable: Vec<(u32, usize)> = affordable.collect();
        affordable.sort_unstable();
        affordable
    }

    fn insert(&mut self, keyframe: u32, keypoint: u32, descriptor: &Descriptor) -> u32 {
        let mut entry = Entry { descriptor: *descriptor, keyframe, keypoint, next: [NIL; TABLES] };
        let slot = self.free.pop().unwrap_or(self.entries.len() as u32);
        for (table, next) in entry.next.iter_mut().enumerate() {
            let bucket = key(descriptor, table);
            *next = std::mem::replace(&mut self.tables[table].head[bucket], slot);
            self.tables[table].len[bucket] += 1;
        }
        if slot as usize == self.entries.len() {
            self.entries.push(entry);
        } else {
            self.entries[slot as usize] = entry;
        }
        slot
    }

    fn unlink(&mut self, slot: u32) {
        let removed = self.entries[slot as usize];
        for table in 0..TABLES {
            let bucket = key(&removed.descriptor, table);
            self.tables[table].len[bucket] -= 1;
            let mut at = self.tables[table].head[bucket];
            if at == slot {
                self.tables[table].head[bucket] = removed.next[table];
                continue;
            }
            while self.entries[at as usize].next[table] != slot {
                at = self.entries[at as usize].next[table];
            }
            self.entries[at as usize].next[table] = removed.next[table];
        }
    }
}

/// Bits `table`, `table + 16`, `table + 32`, ... as a bucket number: the pattern lists alike pairs one after another,
/// so bits far apart are the least dependent.
fn key(descriptor: &Descriptor, table: usize) -> usize {
    descriptor
        .iter()
        .flat_map(|word| (0..4).map(move |k| word >> (table + 16 * k) & 1))
        .fold(0, |key, bit| key << 1 | bit) as usize
}

/// At most [`MAX_DESCRIPTORS`] of the list, evenly spread: the list is sorted by octave and row, and a cut would lose
/// the coarse octaves, which are seen from farthest.
pub(crate) fn spread<T>(list: &[T]) -> impl Iterator<Item = &T> {
    let taken = list.len().min(MAX_DESCRIPTORS);
    (0..taken).map(move |i| &list[i * list.len() / taken])
}
