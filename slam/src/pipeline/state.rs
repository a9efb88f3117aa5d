//! All that decides what comes next, as a value: what a run is between two frames. Saved and taken up again, it goes on
//! as if it had never stopped.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Executor, Slam, SlamError, Tracker, loops, schedule, trajectory};
use crate::context::Context;
use crate::depth::DepthModel;
use crate::looping::LoopState;
use crate::map::{Map, MapProblem};
use crate::mapping::YoungPoints;
use crate::offline::Sights;
use crate::panoptic::PanopticFilter;
use crate::tracking::FirstView;

/// A [`Slam`] between two frames, for any encoding. Results of background jobs that are not due yet are part of it; what
/// follows from configuration and map (tables, the index of places) is not.
#[derive(Serialize, Deserialize)]
pub struct State<'a> {
    depth: Cow<'a, DepthModel>,
    map: Cow<'a, Map>,
    loops: Cow<'a, LoopState>,
    waiting: loops::Waiting,
    filter: Cow<'a, PanopticFilter>,
    young: Cow<'a, YoungPoints>,
    schedule: Cow<'a, schedule::Schedule>,
    tracker: Cow<'a, Tracker>,
    first_view: Cow<'a, Option<FirstView>>,
    frames: Cow<'a, [trajectory::Entry]>,
    sights: Cow<'a, Sights>,
}

impl State<'_> {
    /// Frames that have gone into it.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.frames.len()
    }
}

impl Slam {
    /// The state before the next frame. Waits for all jobs in flight; their results take effect when they are due.
    ///
    /// # Errors
    /// When the executor lost a job.
    pub fn state(&mut self, executor: &mut dyn Executor) -> Result<State<'_>, SlamError> {
        self.schedule.collect_all(self.frames.len() as u32, executor)?;
        // Named one by one, so that a new field can't be forgotten. The local map lives within a frame only.
        let Self { front_end: _, ctx, map, places: _, loops, waiting, filter, young, schedule, tracker, .. } = self;
        let Self { first_view, frames, sights, last_local: _, .. } = self;
        Ok(State {
            depth: Cow::Borrowed(&ctx.depth),
            map: Cow::Borrowed(map),
            loops: Cow::Borrowed(loops),
            waiting: *waiting,
            filter: Cow::Borrowed(filter),
            young: Cow::Borrowed(young),
            schedule: Cow::Borrowed(schedule),
            tracker: Cow::Borrowed(tracker),
            first_view: Cow::Borrowed(first_view),
            frames: Cow::Borrowed(frames),
            sights: Cow::Borrowed(sights),
        })
    }

    /// A new slam of the same configuration and setup goes on where the state was taken.
    ///
    /// # Errors
    /// A map that contradicts itself. That can't come from damage, which the file's own checks find.
    pub fn resumed(self, state: State<'_>) -> Result<Self, MapProblem> {
        let State { depth, map, loops, waiting, filter, young, schedule, tracker, first_view, frames, sights } = state;
        map.check(self.context().scales.len())?;
        let mut slam = Self {
            ctx: Arc::new(Context { depth: depth.into_owned(), ..(*self.ctx).clone() }),
            map: map.into_owned(),
            loops: loops.into_owned(),
            waiting,
            filter: filter.into_owned(),
            young: young.into_owned(),
            schedule: schedule.into_owned(),
            tracker: tracker.into_owned(),
            first_view: first_view.into_owned(),
            frames: frames.into_owned(),
            sights: sights.into_owned(),
            ..self
        };
        let keyframes: Vec<_> = slam.map.keyframes().map(|k| k.id).collect();
        keyframes.into_iter().for_each(|id| slam.remember_place(id));
        Ok(slam)
    }
}
