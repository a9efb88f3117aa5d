//! A bounded queue between two threads that says what it could not take.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How long a sender waits for room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wait {
    /// Until there is some: the sender's source can wait.
    Forever,
    /// So long; then the oldest items make room.
    AtMost(Duration),
    /// Not at all, and the item goes in whatever the load.
    No,
}

/// What a receiver gets.
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// The oldest item.
    Item(T),
    /// Nothing in time.
    Nothing,
    /// Nothing any more.
    Closed,
}

/// A queue whose items have weights (bytes, or 1 each) that together stay below a limit; a single item always fits.
#[derive(Debug)]
pub struct Lane<T> {
    inner: Mutex<Inner<T>>,
    changed: Condvar,
    limit: usize,
}

/// How full a queue is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Load {
    /// Items inside.
    pub items: usize,
    /// Their weight.
    pub weight: usize,
    /// The most that may be inside.
    pub limit: usize,
}

impl Load {
    /// Whether more than one part of so many is full.
    pub fn is_above_one_of(&self, parts: usize) -> bool {
        self.weight > self.limit / parts
    }
}

#[derive(Debug)]
struct Inner<T> {
    items: VecDeque<(usize, T)>,
    weight: usize,
    open: bool,
}

impl<T> Lane<T> {
    /// An empty, open queue.
    pub fn new(limit: usize) -> Self {
        let inner = Inner { items: VecDeque::new(), weight: 0, open: true };
        Self { inner: Mutex::new(inner), changed: Condvar::new(), limit }
    }

    /// Adds an item; returns the items that are lost by that: the oldest ones, or this one if the queue is closed.
    pub fn push(&self, item: T, weight: usize, wait: Wait) -> Vec<T> {
        let mut inner = self.lock();
        let full = |inner: &mut Inner<T>| inner.open && !inner.items.is_empty() && inner.weight + weight > self.limit;
        inner = match wait {
            Wait::No => inner,
            Wait::Forever => self.changed.wait_while(inner, full).unwrap_or_else(PoisonError::into_inner),
            Wait::AtMost(time) => {
                self.changed.wait_timeout_while(inner, time, full).unwrap_or_else(PoisonError::into_inner).0
            }
        };
        if !inner.open {
            return vec![item];
        }
        let mut lost = Vec::new();
        while wait != Wait::No && full(&mut inner) {
            lost.extend(inner.take());
        }
        inner.weight += weight;
        inner.items.push_back((weight, item));
        drop(inner);
        self.changed.notify_all();
        lost
    }

    /// Takes the oldest item; waits for one at most `time`.
    pub fn pop(&self, time: Duration) -> Taken<T> {
        let empty = |inner: &mut Inner<T>| inner.open && inner.items.is_empty();
        let waited = self.changed.wait_timeout_while(self.lock(), time, empty);
        let mut inner = waited.unwrap_or_else(PoisonError::into_inner).0;
        let taken = inner.take();
        let open = inner.open;
        drop(inner);
        self.changed.notify_all();
        match taken {
            Some(item) => Taken::Item(item),
            None if open => Taken::Nothing,
            None => Taken::Closed,
        }
    }

    /// Takes no more items; those inside can still be taken out.
    pub fn close(&self) {
        self.lock().open = false;
        self.changed.notify_all();
    }

    /// Closes and empties it.
    pub fn abandon(&self) -> Vec<T> {
        let mut inner = self.lock();
        inner.open = false;
        inner.weight = 0;
        let left = inner.items.drain(..).map(|(_, item)| item).collect();
        drop(inner);
        self.changed.notify_all();
        left
    }

    /// What is inside.
    pub fn load(&self) -> Load {
        let inner = self.lock();
        Load { items: inner.items.len(), weight: inner.weight, limit: self.limit }
    }

    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> Inner<T> {
    fn take(&mut self) -> Option<T> {
        let (weight, item) = self.items.pop_front()?;
        self.weight -= weight;
        Some(item)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Wait = Wait::AtMost(Duration::ZERO);

    #[test]
    fn the_newest_stay() {
        let lane = Lane::new(10);
        assert_eq!(lane.push('a', 4, NOW), []);
        assert_eq!(lane.push('b', 4, NOW), []);
        assert_eq!(lane.push('c', 8, NOW), ['a', 'b'], "whole items make room");
        assert_eq!(lane.push('d', 40, NOW), ['c'], "a single item always fits");
        assert_eq!(lane.push('e', 1, Wait::No), [], "what cannot wait goes in");
        assert_eq!(lane.load(), Load { items: 2, weight: 41, limit: 10 });
        lane.close();
        assert_eq!(lane.push('f', 1, Wait::Forever), ['f']);
        assert_eq!([lane.pop(Duration::ZERO), lane.pop(Duration::ZERO)], [Taken::Item('d'), Taken::Item('e')]);
        assert_eq!(lane.pop(Duration::from_secs(9)), Taken::Closed);
    }

    #[test]
    fn a_sender_waits_for_room() {
        let lane = Lane::new(2);
        let taken: Vec<u32> = std::thread::scope(|scope| {
            scope.spawn(|| {
                let lost: usize = (0..100).map(|i| lane.push(i, 1, Wait::Forever).len()).sum();
                assert_eq!(lost, 0);
                lane.close();
            });
            std::iter::from_fn(|| match lane.pop(Duration::from_secs(60)) {
                Taken::Item(item) => Some(item),
                Taken::Nothing | Taken::Closed => None,
            })
            .collect()
        });
        assert_eq!(taken, (0..100).collect::<Vec<u32>>());
    }
}
