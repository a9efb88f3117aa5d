//! One frame after the other: the order of the stages, and who owns the state.

mod doubts;
mod front_end;
mod job;
mod locate;
mod loops;
mod record;
mod schedule;
mod shares;
mod start;
mod state;
mod step;
mod summary;
mod trajectory;
mod upkeep;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{FrameId, MapId, Se3};
use slam_vision::{Places, VisionError, Vocabulary};

pub use front_end::FrontEnd;
pub use job::{Executor, Inline, Job, JobKind, JobResult, Ticket};
pub use state::State;
pub use trajectory::{FinalPath, TrajectoryPose};

use crate::config::Config;
use crate::context::Context;
use crate::input::{FrameInput, Setup};
use crate::looping::LoopState;
use crate::map::Map;
use crate::mapping::YoungPoints;
use crate::observation::Observation;
use crate::offline::Sights;
use crate::panoptic::PanopticFilter;
use crate::report::{FrameReport, TrackingState};
use crate::tracking::{FirstView, LocalMap, TrackedFrame};

/// Why a slam can't be made or a frame can't be taken.
#[derive(Debug, thiserror::Error)]
pub enum SlamError {
    /// The calibration or the feature settings make no sense.
    #[error(transparent)]
    Vision(#[from] VisionError),
    /// A picture of another size than the calibration's.
    #[error(
        "frame {frame}: the {what} has {width} x {height} pixels, the calibration {expected_width} x {expected_height}"
    )]
    Size {
        /// Which frame.
        frame: u32,
        /// Which picture.
        what: &'static str,
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// Width in the calibration.
        expected_width: u32,
        /// Height in the calibration.
        expected_height: u32,
    },
    /// A picture whose buffer does not hold width x height pixels.
    #[error("frame {frame}: the {what} has {pixels} pixels, its size says {expected}")]
    Pixels {
        /// Which frame.
        frame: u32,
        /// Which picture.
        what: &'static str,
        /// Pixels in its buffer.
        pixels: usize,
        /// Width times height.
        expected: usize,
    },
    /// Whoever ran a background job has failed.
    #[error("frame {frame}: the result of a {kind} job never came; the thread that ran it has failed")]
    Job {
        /// When the result was due.
        frame: u32,
        /// Which kind of job.
        kind: &'static str,
    },
    /// Frames must come in order.
    #[error("frame {got} came when frame {expected} was due")]
    Order {
        /// What came.
        got: u32,
        /// What was due.
        expected: u32,
    },
}

/// A piece of work inside a frame, for whoever measures time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// In the executor: waiting for late jobs, or running them where they are run inline.
    Jobs,
    /// Applying the results of jobs.
    Apply,
    /// Panoptic filter: labels, regions, association.
    Label,
    /// Pose by motion model, reference keyframe or relocalisation.
    Predict,
    /// Panoptic filter: evidence and verdicts.
    Judge,
    /// Local map search and final pose.
    LocalMap,
    /// Doubts, and making a keyframe.
    Keyframe,
    /// Making the snapshot for a job.
    Snapshot,
    /// Digests and report.
    Report,
}

impl Work {
    /// All pieces in order.
    pub const ALL: [Self; 9] = [
        Self::Jobs,
        Self::Apply,
        Self::Label,
        Self::Predict,
        Self::Judge,
        Self::LocalMap,
        Self::Keyframe,
        Self::Snapshot,
        Self::Report,
    ];

    /// Name for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Jobs => "jobs",
            Self::Apply => "apply jobs",
            Self::Label => "panoptic label",
            Self::Predict => "predict pose",
            Self::Judge => "panoptic judge",
            Self::LocalMap => "local map",
            Self::Keyframe => "keyframe",
            Self::Snapshot => "snapshot",
            Self::Report => "report",
        }
    }
}

/// Is told when a piece of work is done. The slam itself reads no clock.
pub trait Observer {
    /// `work` has just ended.
    fn done(&mut self, work: Work);
}

/// Nobody measures.
pub struct Unobserved;

impl Observer for Unobserved {
    fn done(&mut self, _work: Work) {}
}

/// The slam: its state and nothing else.
pub struct Slam {
    front_end: FrontEnd,
    /// That of the front end, with what the run has found out about depth.
    ctx: Arc<Context>,
    map: Map,
    places: Places,
    /// Not here while a loop search has it.
    loops: LoopState,
    /// What is to be searched for loops or adjusted as a whole as soon as the last such job is done.
    waiting: loops::Waiting,
    filter: PanopticFilter,
    /// Not here while a mapping job has them.
    young: YoungPoints,
    schedule: schedule::Schedule,
    tracker: Tracker,
    /// Without depth: the view that waits for a second one to start a map.
    first_view: Option<FirstView>,
    frames: Vec<trajectory::Entry>,
    /// What the frames saw, for the final stage.
    sights: Sights,
    /// Local map of the frame in work, between tracking and map upkeep.
    last_local: Option<LocalMap>,
}

/// What tracking carries from frame to frame.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Tracker {
    state: TrackingState,
    active: MapId,
    next_map: MapId,
    last: Option<TrackedFrame>,
    /// `last_from_before_last` in camera frames: motion per frame.
    velocity: Option<Se3>,
    last_keyframe: FrameId,
    relocalized_at: Option<FrameId>,
    /// Frames since the track was lost, and those of them with a usable picture.
    lost_frames: u32,
    lost_usable_frames: u32,
}

impl Slam {
    /// A slam that has seen nothing.
    ///
    /// # Errors
    /// When calibration or feature settings make no sense.
    pub fn new(config: &Config, setup: &Setup) -> Result<Self, SlamError> {
        let front_end = FrontEnd::new(config, setup)?;
        Ok(Self {
            ctx: front_end.shared_context(),
            front_end,
            map: Map::default(),
            places: Places::default(),
            loops: LoopState::default(),
            waiting: loops::Waiting::default(),
            filter: PanopticFilter::default(),
            young: YoungPoints::default(),
            schedule: schedule::Schedule::default(),
            tracker: Tracker::default(),
            first_view: None,
            frames: Vec::new(),
            sights: Sights::default(),
            last_local: None,
        })
    }

    /// Goes by the words of a vocabulary to find places again (`looping.vocabulary`), not by descriptors alone. For a slam
    /// that has seen nothing.
    #[must_use]
    pub fn with_vocabulary(self, vocabulary: Option<Arc<Vocabulary>>) -> Self {
        Self { places: Places::new(vocabulary), ..self }
    }

    /// The part that works on a frame alone: features ahead of time, on any thread.
    #[must_use]
    pub fn front_end(&self) -> &FrontEnd {
        &self.front_end
    }

    /// The map as it is now.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// Frames taken so far.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Configuration, calibration and tables.
    #[must_use]
    pub fn context(&self) -> &Context {
        &self.ctx
    }

    /// Takes the next frame with its observation from [`FrontEnd::observe`]. Background work goes to `executor`; which
    /// one makes no difference to any result. After the last frame, [`settle`](Self::settle).
    ///
    /// # Errors
    /// Frames out of order, or an executor that lost a job.
    pub fn step(
        &mut self,
        input: &FrameInput,
        obs: Arc<Observation>,
        executor: &mut dyn Executor,
        observer: &mut dyn Observer,
    ) -> Result<FrameReport, SlamError> {
        if input.id.index() != self.frames.len() {
            return Err(SlamError::Order { got: input.id.0, expected: self.frames.len() as u32 });
        }
        step::Step::new(self, input, obs, executor, observer).run()
    }
}
