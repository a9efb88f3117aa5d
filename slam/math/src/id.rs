//! Stamps and identifiers. Identifiers count up in creation order and are never reused, so sorting by id is sorting by
//! age: the canonical order everywhere.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Nanoseconds on the log's one timeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Stamp(pub i64);

impl Stamp {
    /// Seconds as a float, for plots and human eyes only.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

macro_rules! id {
    ($(#[$doc:meta])* $name:ident, $letter:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
        pub struct $name(pub u32);

        impl $name {
            /// Position in an [`IdVec`].
            #[must_use]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!($letter, "{}"), self.0)
            }
        }

        impl From<usize> for $name {
            fn from(index: usize) -> Self {
                Self(u32::try_from(index).expect("more than 2^32 items in one map"))
            }
        }
    };
}

id!(/// Position of a frame in the replay, from 0.
    FrameId, "f");
id!(/// A keyframe.
    KeyFrameId, "kf");
id!(/// A map point.
    MapPointId, "mp");
id!(/// A map of the atlas: the part of the world seen since the last unrecovered loss of track.
    MapId, "map");

/// Append-only vector of shared values indexed by creation order. Removing leaves a hole, so ids stay valid for ever.
/// Cloning is cheap: values are shared until written to.
#[derive(Debug, Clone)]
pub struct IdVec<T> {
    slots: Vec<Option<Arc<T>>>,
    live: usize,
}

impl<T> Default for IdVec<T> {
    fn default() -> Self {
        Self { slots: Vec::new(), live: 0 }
    }
}

impl<T: Serialize> Serialize for IdVec<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.slots.serialize(serializer)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for IdVec<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let slots: Vec<Option<Arc<T>>> = Vec::deserialize(deserializer)?;
        let live = slots.iter().flatten().count();
        Ok(Self { slots, live })
    }
}

impl<T: Clone> IdVec<T> {
    /// The index that the next [`push`](Self::push) will use.
    #[must_use]
    pub fn next_index(&self) -> usize {
        self.slots.len()
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
        self.slots.push(Some(Arc::new(value)));
        self.live += 1;
        self.slots.len() - 1
    }

    /// The value, unless it was removed or never existed.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&T> {
        self.slots.get(index).and_then(|slot| slot.as_deref())
    }

    /// The value for writing; copies it first when it is shared with a snapshot.
    pub fn get_mut(&mut self, index: usize) -> Option<&mut T> {
        self.slots.get_mut(index).and_then(|slot| slot.as_mut()).map(Arc::make_mut)
    }

    /// Removes a value; true when it was there.
    pub fn remove(&mut self, index: usize) -> bool {
        let removed = self.slots.get_mut(index).and_then(Option::take).is_some();
        self.live -= usize::from(removed);
        removed
    }

    /// Live values in id order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (usize, &T)> {
        self.slots.iter().enumerate().filter_map(|(i, slot)| slot.as_deref().map(|value| (i, value)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_never_reused() {
        let mut v = IdVec::default();
        assert_eq!((v.push('a'), v.push('b')), (0, 1));
        assert!(v.remove(0));
        assert!(!v.remove(0));
        assert_eq!(v.push('c'), 2);
        assert_eq!(v.iter().collect::<Vec<_>>(), [(1, &'b'), (2, &'c')]);
        assert_eq!((v.len(), v.next_index(), v.get(0)), (2, 3, None));
    }

    #[test]
    fn a_snapshot_does_not_see_later_writes() {
        let mut v = IdVec::default();
        v.push(1);
        let snapshot = v.clone();
        *v.get_mut(0).unwrap() = 2;
        assert_eq!((v.get(0), snapshot.get(0)), (Some(&2), Some(&1)));
    }
}
