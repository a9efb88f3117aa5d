//! Vectors whose memory is used again.

use std::any::{Any, TypeId};
use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Memory of vectors that are no longer needed, by the type of their elements. A program that does the same thing for every
/// frame takes its vectors from here and asks the allocator for nothing once they are as long as they get.
///
/// Clones share their memory, also between threads. Which memory a vector gets makes no difference to what is in it: it
/// always starts empty.
#[derive(Clone, Default)]
pub struct Buffers(Arc<Shelves>);

/// Vectors of so many values serve the smallest lists too.
const SMALL: usize = 64;

/// A `Vec<Vec<T>>` for each type `T`.
type Shelves = Mutex<BTreeMap<TypeId, Box<dyn Any + Send>>>;

impl std::fmt::Debug for Buffers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Buffers").finish_non_exhaustive()
    }
}

impl Buffers {
    /// An empty vector for a list of unknown length: the largest. A small one would grow, and be missing where it sufficed:
    /// there would be ever more large ones.
    #[must_use]
    pub fn empty<T: Send + 'static>(&self) -> Buffer<T> {
        let vec = self.with_shelf(|shelf: &mut Vec<Vec<T>>| {
            let largest = shelf.iter().map(Vec::capacity).zip(0..).max();
            largest.map(|(_, i)| shelf.swap_remove(i))
        });
        Buffer { vec: vec.unwrap_or_default(), home: Some(self.clone()) }
    }

    /// An empty vector with room for `n` values: the smallest that has it and not far more, so that small lists do not hold
    /// the memory of large ones.
    #[must_use]
    pub fn with_room<T: Send + 'static>(&self, n: usize) -> Buffer<T> {
        let vec = self.with_shelf(|shelf: &mut Vec<Vec<T>>| {
            let capacities = || shelf.iter().map(Vec::capacity).zip(0..);
            let fitting = capacities().filter(|(capacity, _)| (n..=4 * n + SMALL).contains(capacity)).min();
            let largest_too_small = || capacities().filter(|(capacity, _)| *capacity < n).max();
            fitting.or_else(largest_too_small).map(|(_, i)| shelf.swap_remove(i))
        });
        let mut vec = vec.unwrap_or_default();
        if vec.capacity() < n {
            // A little more than needed: the next one may want a little more too.
            vec.reserve_exact(n + n / 8);
        }
        Buffer { vec, home: Some(self.clone()) }
    }

    /// `n` times the same value.
    #[must_use]
    pub fn filled<T: Clone + Send + 'static>(&self, n: usize, value: T) -> Buffer<T> {
        let mut buffer = self.with_room(n);
        buffer.resize(n, value);
        buffer
    }

    /// The values of an iterator.
    #[must_use]
    pub fn collect<T: Send + 'static>(&self, values: impl IntoIterator<Item = T>) -> Buffer<T> {
        let values = values.into_iter();
        let mut buffer = values.size_hint().1.map_or_else(|| self.empty(), |at_most| self.with_room(at_most));
        buffer.extend(values);
        buffer
    }

    fn with_shelf<T: Send + 'static, R>(&self, f: impl FnOnce(&mut Vec<Vec<T>>) -> R) -> R {
        let mut shelves = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let shelf = shelves.entry(TypeId::of::<T>()).or_insert_with(|| Box::new(Vec::<Vec<T>>::new()));
        f(shelf.downcast_mut().expect("a shelf holds what its key says"))
    }
}

/// A vector that gives its memory back to the [`Buffers`] it came from, if any, when it is dropped.
pub struct Buffer<T: Send + 'static> {
    vec: Vec<T>,
    home: Option<Buffers>,
}

impl<T: Send + 'static> Drop for Buffer<T> {
    fn drop(&mut self) {
        if let Some(home) = &self.home
            && self.vec.capacity() > 0
        {
            let mut vec = std::mem::take(&mut self.vec);
            vec.clear();
            home.with_shelf(|shelf| shelf.push(vec));
        }
    }
}

impl<T: Send + 'static> Deref for Buffer<T> {
    type Target = Vec<T>;
    fn deref(&self) -> &Vec<T> {
        &self.vec
    }
}

impl<T: Send + 'static> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut Vec<T> {
        &mut self.vec
    }
}

impl<T: Send + 'static> Default for Buffer<T> {
    fn default() -> Self {
        Self::from(Vec::new())
    }
}

impl<T: Send + 'static> From<Vec<T>> for Buffer<T> {
    /// A vector without a home.
    fn from(vec: Vec<T>) -> Self {
        Self { vec, home: None }
    }
}

impl<T: Send + 'static> FromIterator<T> for Buffer<T> {
    /// A vector without a home.
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        Self::from(Vec::from_iter(values))
    }
}

impl<T: Clone + Send + 'static> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        match &self.home {
            Some(home) => home.collect(self.vec.iter().cloned()),
            None => Self::from(self.vec.clone()),
        }
    }

    fn clone_from(&mut self, source: &Self) {
        self.vec.clone_from(&source.vec);
    }
}

impl<T: std::fmt::Debug + Send> std::fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.vec.fmt(f)
    }
}

impl<T: PartialEq + Send> PartialEq for Buffer<T> {
    fn eq(&self, other: &Self) -> bool {
        self.vec == other.vec
    }
}

impl<T: Eq + Send> Eq for Buffer<T> {}

impl<'a, T: Send> IntoIterator for &'a Buffer<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.vec.iter()
    }
}

impl<'a, T: Send> IntoIterator for &'a mut Buffer<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.vec.iter_mut()
    }
}

impl<T: Serialize + Send> Serialize for Buffer<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.vec.serialize(serializer)
    }
}

impl<'de, T: Deserialize<'de> + Send> Deserialize<'de> for Buffer<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Vec::deserialize(deserializer).map(Self::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::par::Pool;

    #[test]
    fn memory_comes_back_empty() {
        let buffers = Buffers::default();
        let first = buffers.filled(100, 7u8);
        let memory = first.as_ptr();
        drop(first);
        let second = buffers.collect(0..90u8);
        assert_eq!(second.as_ptr(), memory);
        assert!(second.iter().copied().eq(0..90));
        let third = second.clone();
        assert_eq!(third, second);
        assert_ne!(third.as_ptr(), memory, "what is in use is not given twice");
        assert_ne!(buffers.filled(1, 7u16).as_ptr().cast(), memory, "nor to other types");
    }

    #[test]
    fn large_memory_is_kept_for_large_lists() {
        let buffers = Buffers::default();
        let (large, small) = (buffers.filled(10_000, 0u8), buffers.filled(100, 0u8));
        let memory = [&large, &small].map(|list| list.as_ptr());
        drop((small, large));
        let (small, next) = (buffers.filled(90, 0u8), buffers.filled(90, 0u8));
        let large = buffers.filled(9_000, 0u8);
        assert_eq!([&large, &small].map(|list| list.as_ptr()), memory);
        assert!(next.capacity() < 1000, "new memory rather than far too much: {}", next.capacity());
    }

    #[test]
    fn a_vector_without_a_home_is_a_vector() {
        let buffer = Buffer::from(vec![3, 4]);
        assert_eq!(buffer.clone().iter().sum::<i32>(), 7);
        assert_eq!(Buffer::<i32>::default().len(), 0);
    }

    #[test]
    fn memory_is_given_back_from_any_thread() {
        let buffers = Buffers::default();
        let made = buffers.filled(10, 0u64);
        let memory = made.as_ptr() as usize;
        Pool::new(1).unwrap().run(move || drop(made));
        assert_eq!(buffers.filled(10, 0u64).as_ptr() as usize, memory);
    }
}
