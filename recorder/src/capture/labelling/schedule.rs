//! Which pictures get labels: the lag rule, without threads and clocks.
//!
//! Pictures are numbered as they come in. The labels of picture f are *due* when picture f + lag comes in: that is when a live
//! SLAM takes up picture f, with the labels that are ready by then or without any. Labels that come later are thrown away, so
//! that the log holds what that SLAM saw. Whoever is free takes the newest picture; one that a newer one replaces before
//! anybody took it is never labelled.

use std::collections::BTreeSet;

/// What became of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Labels were ready in time.
    Labelled,
    /// A newer picture came before anybody was free.
    Busy,
    /// Its labels were not ready when they were due.
    Late,
    /// There are no labels for it.
    Unlabelled,
    /// The network could not label it.
    Failed,
    /// The recording ended before.
    Ended,
}

impl Outcome {
    /// Name in the log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Labelled => "labelled",
            Self::Busy => "busy",
            Self::Late => "late",
            Self::Unlabelled => "unlabelled",
            Self::Failed => "failed",
            Self::Ended => "ended",
        }
    }
}

/// The pictures that are not decided yet.
#[derive(Debug)]
pub struct Schedule<T> {
    lag: u64,
    next: u64,
    waiting: Option<(u64, T)>,
    working: BTreeSet<u64>,
    ended: bool,
}

impl<T> Schedule<T> {
    /// Labels are due `lag` pictures (at least 1) later.
    pub fn new(lag: u64) -> Self {
        Self { lag: lag.max(1), next: 0, waiting: None, working: BTreeSet::new(), ended: false }
    }

    /// A picture came in; gives its number and what is decided by that, in order of numbers.
    pub fn arrive(&mut self, picture: T) -> (u64, Vec<(u64, Outcome)>) {
        let number = self.next;
        self.next += 1;
        if self.ended {
            return (number, vec![(number, Outcome::Ended)]);
        }
        let still_good = self.working.split_off(&(number + 1).saturating_sub(self.lag));
        let late = std::mem::replace(&mut self.working, still_good);
        let mut decided: Vec<_> = late.into_iter().map(|late| (late, Outcome::Late)).collect();
        decided.extend(self.waiting.replace((number, picture)).map(|(replaced, _)| (replaced, Outcome::Busy)));
        (number, decided)
    }

    /// The newest picture, for somebody who is free.
    pub fn take(&mut self) -> Option<(u64, T)> {
        let (number, picture) = self.waiting.take()?;
        self.working.insert(number);
        Some((number, picture))
    }

    /// The work at a picture is done: whether in time. If not, it has been decided already.
    pub fn done(&mut self, number: u64) -> bool {
        self.working.remove(&number)
    }

    /// No more pictures come: all that are left are decided.
    pub fn end(&mut self) -> Vec<(u64, Outcome)> {
        self.ended = true;
        let mut left: Vec<u64> = std::mem::take(&mut self.working).into_iter().collect();
        left.extend(self.waiting.take().map(|(number, _)| number));
        left.into_iter().map(|number| (number, Outcome::Ended)).collect()
    }

    /// Whether no more pictures come.
    pub fn is_ended(&self) -> bool {
        self.ended
    }
}

#[cfg(test)]
mod tests {
    use super::Outcome::{Busy, Ended, Late};
    use super::*;

    #[test]
    fn a_network_slower_than_the_camera() {
        let mut schedule = Schedule::new(3);
        assert_eq!(schedule.arrive('a'), (0, vec![]));
        assert_eq!(schedule.take(), Some((0, 'a')));
        assert_eq!(schedule.take(), None);
        assert_eq!(schedule.arrive('b'), (1, vec![]));
        assert_eq!(schedule.arrive('c'), (2, vec![(1, Busy)]));
        assert!(schedule.done(0), "picture 3, at which it is due, has not come");
        assert_eq!(schedule.take(), Some((2, 'c')), "the newest");
        assert_eq!(schedule.arrive('d'), (3, vec![]));
        assert_eq!(schedule.arrive('e'), (4, vec![(3, Busy)]));
        assert_eq!(schedule.arrive('f'), (5, vec![(2, Late), (4, Busy)]), "due at 5");
        assert!(!schedule.done(2), "thrown away");
        assert_eq!(schedule.take(), Some((5, 'f')));
        assert_eq!(schedule.arrive('g'), (6, vec![]));
        assert_eq!(schedule.end(), [(5, Ended), (6, Ended)]);
        assert!(!schedule.done(5) && schedule.is_ended());
        assert_eq!(schedule.take(), None);
        assert_eq!(schedule.arrive('h'), (7, vec![(7, Ended)]));
    }

    #[test]
    fn several_work_at_once_and_the_shortest_lag_is_one_picture() {
        let mut schedule = Schedule::new(1);
        schedule.arrive('a');
        schedule.take();
        assert_eq!(schedule.arrive('b'), (1, vec![(0, Late)]));
        schedule.take();
        assert!(schedule.done(1) && !schedule.done(0));
        let mut schedule = Schedule::new(2);
        schedule.arrive('a');
        schedule.take();
        schedule.arrive('b');
        schedule.take();
        assert!(schedule.done(1), "they need not come in order");
        assert_eq!(schedule.arrive('c'), (2, vec![(0, Late)]));
    }
}
