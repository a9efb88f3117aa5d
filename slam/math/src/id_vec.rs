//! Values by id, shared with snapshots until written to.

use std::sync::{Arc, Mutex, PoisonError};

use serde::ser::SerializeSeq;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Values that are shared and copied together.
type Block<T, const N: usize> = [Option<T>; N];

/// Append-only vector of values indexed by creation order. Removing leaves a hole, so ids stay valid for ever; a block of
/// holes alone takes no memory, or a map would grow with all that ever was in it.
///
/// Cloning is cheap: blocks of `N` values are shared until one of them is written to. Large values want blocks of one;
/// for small ones that are written together, larger blocks save allocations and lie side by side in memory. The memory of
/// blocks that only one clone had is used again by the others when it is dropped.
#[derive(Debug, Clone)]
pub struct IdVec<T, const N: usize = 1> {
    blocks: Vec<Option<Arc<Block<T, N>>>>,
    /// Blocks of holes alone, for all clones.
    spare: Arc<Mutex<Vec<Arc<Block<T, N>>>>>,
    /// Slots in use, holes included.
    used: usize,
    live: usize,
}

impl<T, const N: usize> Default for IdVec<T, N> {
    fn default() -> Self {
        const { assert!(N > 0, "a block holds something") };
        Self { blocks: Vec::new(), spare: Arc::default(), used: 0, live: 0 }
    }
}

impl<T: Serialize, const N: usize> Serialize for IdVec<T, N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // Some formats need the number beforehand.
        let mut slots = serializer.serialize_seq(Some(self.used))?;
        for index in 0..self.used {
            slots.serialize_element(&self.slot(index))?;
        }
        slots.end()
    }
}

impl<T, const N: usize> IdVec<T, N> {
    fn slot(&self, index: usize) -> Option<&T> {
        self.blocks.get(index / N)?.as_ref()?[index % N].as_ref()
    }

    /// A block of holes.
    fn fresh(&self) -> Arc<Block<T, N>> {
        let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        spare.unwrap_or_else(|| Arc::new(std::array::from_fn(|_| None)))
    }
}

impl<T, const N: usize> Drop for IdVec<T, N> {
    fn drop(&mut self) {
        // The last of all clones leaves nothing to anybody.
        if Arc::get_mut(&mut self.spare).is_none() {
            let own = self.blocks.drain(..).flatten().filter_map(emptied);
            self.spare.lock().unwrap_or_else(PoisonError::into_inner).extend(own);
        }
    }
}

/// A block without its values, unless it is shared.
fn emptied<T, const N: usize>(mut block: Arc<Block<T, N>>) -> Option<Arc<Block<T, N>>> {
    Arc::get_mut(&mut block)?.fill_with(|| None);
    Some(block)
}

impl<'de, T: Clone + Deserialize<'de>, const N: usize> Deserialize<'de> for IdVec<T, N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut all = Self::default();
        Vec::deserialize(deserializer)?.into_iter().for_each(|slot| _ = all.append(slot));
        Ok(all)
    }
}

impl<T: Clone, const N: usize> IdVec<T, N> {
    /// The index that the next [`push`](Self::push) will use.
    #[must_use]
    pub fn next_index(&self) -> usize {
        self.used
    }

    /// Number of values that have not been removed.
    #[must_use]
    pub fn len(&self) -> usize {
        self.live
    }

    /// True when nothing is alive.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.live == 0
    }

    /// Appends a value and returns its index.
    pub fn push(&mut self, value: T) -> usize {
        self.append(Some(value))
    }

    fn append(&mut self, slot: Option<T>) -> usize {
        let index = self.used;
        if index / N == self.blocks.len() {
            self.blocks.push(None);
        }
        self.used += 1;
        if slot.is_some() {
            self.live += 1;
            self.own(index / N)[index % N] = slot;
        }
        index
    }

    /// The value, unless it was removed or never existed.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&T> {
        self.slot(index)
    }

    /// The value for writing; its block is copied first when it is shared with a snapshot.
    pub fn get_mut(&mut self, index: usize) -> Option<&mut T> {
        self.get(index)?; // a hole is no reason to copy
        self.own(index / N)[index % N].as_mut()
    }

    /// A block for writing; it is copied first when it is shared, and made when it is missing.
    fn own(&mut self, block: usize) -> &mut Block<T, N> {
        if self.blocks[block].as_mut().is_none_or(|shared| Arc::get_mut(shared).is_none()) {
            let mut own = self.fresh();
            if let (Some(shared), Some(own)) = (&self.blocks[block], Arc::get_mut(&mut own)) {
                own.clone_from_slice(&shared[..]);
            }
            self.blocks[block] = Some(own);
        }
        self.blocks[block].as_mut().and_then(Arc::get_mut).expect("nobody else has it now")
    }

    /// Removes a value; true when it was there.
    pub fn remove(&mut self, index: usize) -> bool {
        let Some(Some(block)) = self.blocks.get(index / N) else { return false };
        if block[index % N].is_none() {
            return false;
        }
        if block.iter().flatten().nth(1).is_none() {
            let last = self.blocks[index / N].take().and_then(emptied);
            self.spare.lock().unwrap_or_else(PoisonError::into_inner).extend(last);
        } else {
            self.own(index / N)[index % N] = None;
        }
        self.live -= 1;
        true
    }

    /// Live values in id order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (usize, &T)> {
        (0..self.used).filter_map(|index| self.get(index).map(|value| (index, value)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_never_reused() {
        let mut v = IdVec::<char, 2>::default();
        assert_eq!((v.push('a'), v.push('b')), (0, 1));
        assert!(v.remove(0));
        assert!(!v.remove(0));
        assert_eq!(v.push('c'), 2);
        assert_eq!(v.iter().collect::<Vec<_>>(), [(1, &'b'), (2, &'c')]);
        assert_eq!(v.iter().rev().collect::<Vec<_>>(), [(2, &'c'), (1, &'b')]);
        assert_eq!((v.len(), v.next_index(), v.get(0), v.get(3)), (2, 3, None, None));
        assert_eq!([0, 9].map(|hole| v.get_mut(hole).is_none()), [true; 2]);
    }

    #[test]
    fn a_block_of_holes_takes_no_memory() {
        let value = Arc::new(());
        let mut v = IdVec::<Arc<()>, 4>::default();
        (0..6).for_each(|_| _ = v.push(value.clone()));
        let snapshot = v.clone();
        (0..4).chain([5]).for_each(|index| assert!(v.remove(index)));
        assert!(v.blocks[0].is_none() && v.blocks[1].is_some());
        assert_eq!((snapshot.len(), Arc::strong_count(&value)), (6, 8), "the snapshot has all, and one is left");
        assert!(v.remove(4) && v.is_empty());
        assert_eq!((v.push(value.clone()), v.push(value)), (6, 7), "into a block that was given up");
        assert_eq!(v.iter().map(|(index, _)| index).collect::<Vec<_>>(), [6, 7]);
    }

    #[test]
    fn a_snapshot_does_not_see_later_writes() {
        let mut v = IdVec::<i32, 2>::default();
        (1..4).for_each(|i| _ = v.push(i));
        let snapshot = v.clone();
        *v.get_mut(0).unwrap() = 7;
        v.remove(1);
        v.push(8);
        assert_eq!(v.iter().map(|(_, x)| *x).collect::<Vec<_>>(), [7, 3, 8]);
        assert_eq!(snapshot.iter().map(|(_, x)| *x).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!((snapshot.next_index(), snapshot.get(3)), (3, None));
    }
}
