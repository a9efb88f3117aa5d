//! The loop: every frame of the range, in order, through the slam.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use slam::map::MapProblem;
use slam::offline::seen_twice;
use slam::report::{Event, KeypointClass, TrackingState};
use slam::{Config, FinalPath, FrameReport, FrontEnd, Setup, Slam, TrajectoryPose};
use slam_math::{FrameId, MapId, Se3};
use slam_vision::{Vocabulary, Workspace};

use super::records::{FrameEntry, RunEnd, digest_of};
use super::source::Source;
use super::state::Saved;
use super::summary::{MapFrames, RunEvent, RunResult};
use super::timing::{Clock, Timing};
use super::workers::{Foreman, FrameTask, Prepared, Unrest, with_workers};
use super::{Progress, RunError};
use crate::eval::{StampedPose, Trajectory};
use crate::log::RawFrame;
use crate::stopwatch::Stopwatch;

/// Events kept with their text; the rest is counted.
const MAX_EVENTS: usize = 1000;

/// A frame that has just gone through the slam.
pub(super) struct Stepped<'a> {
    pub prepared: &'a Prepared,
    pub report: &'a FrameReport,
    pub entry: FrameEntry,
    pub slam: &'a Slam,
    /// The state after this frame, where it was asked for.
    pub state: Option<Vec<u8>>,
}

/// Where a replay begins and where it shows its state.
#[derive(Default)]
pub(super) struct Stops {
    /// Not at the first frame but with a state, from this file.
    pub from: Option<(PathBuf, Saved<'static>)>,
    /// Before this frame of the run.
    pub save_before: Option<usize>,
}

/// A whole replay.
pub(crate) struct Outcome {
    pub result: RunResult,
    pub trajectory: Trajectory,
    pub online: Trajectory,
    /// Before the final stage: by the keyframes as the last frame left them.
    pub unrefined: Trajectory,
    pub timing: Timing,
}

impl Outcome {
    pub fn end(&self) -> RunEnd {
        let digest = |trajectory: &Trajectory| digest_of(trajectory.to_tum().as_bytes());
        let frames = self.result.frames as u32;
        RunEnd { frames, trajectory: digest(&self.trajectory), online: digest(&self.online) }
    }
}

/// Is shown each frame; `false` ends the replay.
pub(super) type Each<'a> = &'a mut dyn FnMut(&Stepped<'_>) -> Result<bool, RunError>;

/// Replays the source and shows each frame to `each`; `None` when that ended the replay early.
pub(super) fn drive(
    source: &Source,
    threads: usize,
    unrest: Option<&Unrest>,
    stops: Stops,
    progress: Progress<'_>,
    each: Each<'_>,
) -> Result<Option<Outcome>, RunError> {
    let vocabulary = source.vocabulary.as_ref().map(|file| file.vocabulary.clone());
    let mut drive = Drive::new(&source.config, &source.setup, vocabulary, source.range.len())?;
    drive.slam_from_recorded = source.rig.slam_from_recorded;
    drive.save_before = stops.save_before;
    match stops.from {
        Some((path, saved)) => drive = drive.resumed(&path, saved)?,
        None => source.notes.iter().for_each(|note| drive.tally.event(None, note)),
    }
    let front_end = drive.slam.front_end().clone();
    let frames = source.range.start + drive.slam.frame_count()..source.range.end;
    let mut feed = source.timeline.stream(frames)?.map(|raw| {
        let (raw, front_end) = (raw?, &front_end);
        Ok(Box::new(move |workspace: &mut Workspace| prepare(source, front_end, raw, workspace)) as FrameTask<'_>)
    });
    with_workers(threads, unrest, &mut feed, |foreman| drive.run(threads, foreman, progress, each))
}

/// A slam on its way through a sequence.
pub(super) struct Drive {
    pub slam: Slam,
    clock: Clock,
    tally: Tally,
    /// In the whole sequence.
    frames: usize,
    /// Trajectories are those of the camera as it records, whatever way the slam's pictures were turned.
    pub slam_from_recorded: Se3,
    save_before: Option<usize>,
}

impl Drive {
    pub fn new(
        config: &Config,
        setup: &Setup,
        vocabulary: Option<Arc<Vocabulary>>,
        frames: usize,
    ) -> Result<Self, RunError> {
        let clock = Clock::start();
        let slam = Slam::new(config, setup)?.with_vocabulary(vocabulary);
        let mut tally = Tally::default();
        setup.sensor.name().clone_into(&mut tally.result.sensor);
        Ok(Self { slam, clock, tally, frames, slam_from_recorded: Se3::identity(), save_before: None })
    }

    fn resumed(mut self, path: &Path, saved: Saved<'static>) -> Result<Self, RunError> {
        let wrong = |problem: MapProblem| RunError::State { path: path.to_owned(), reason: problem.to_string() };
        self.slam = self.slam.resumed(saved.slam).map_err(wrong)?;
        self.tally.result = saved.result.into_owned();
        Ok(self)
    }

    /// Takes all frames of the foreman.
    pub fn run(
        mut self,
        threads: usize,
        foreman: &mut Foreman<'_, '_>,
        progress: Progress<'_>,
        each: Each<'_>,
    ) -> Result<Option<Outcome>, RunError> {
        let Self { slam, clock, tally, frames, save_before, .. } = &mut self;
        while let Some(prepared) = foreman.next_frame()? {
            clock.frame(prepared.decode_time, prepared.features_time);
            let mut report = slam.step(&prepared.input, prepared.observation.clone(), foreman, clock)?;
            clock.frame_done();
            report.events.splice(0..0, prepared.events.iter().cloned());
            tally.frame(&report);
            let entry = FrameEntry::from(&report);
            let mut state = None;
            if *save_before == Some(slam.frame_count()) {
                let saved = Saved { result: Cow::Borrowed(&tally.result), slam: slam.state(foreman)? };
                state = Some(saved.encode());
            }
            if !each(&Stepped { prepared: &prepared, report: &report, entry, slam, state })? {
                return Ok(None);
            }
            progress(tally.result.frames, *frames);
        }
        slam.settle(foreman)?;
        let mut watch = Stopwatch::start();
        let path = foreman.in_pool(|| slam.final_path(&seen_twice));
        let timing = self.clock.finish(threads, &foreman.job_times, watch.lap());
        Ok(Some(self.tally.finish(&self.slam, path, &self.slam_from_recorded, timing)))
    }
}

fn prepare(
    source: &Source,
    front_end: &FrontEnd,
    raw: RawFrame,
    workspace: &mut Workspace,
) -> Result<Prepared, RunError> {
    let mut watch = Stopwatch::start();
    let (input, events) = source.input(&raw)?;
    let decode_time = watch.lap();
    let observation = Arc::new(front_end.observe(&input, workspace)?);
    let features_time = watch.lap();
    let color = (!source.rig.rectifies()).then_some(raw.color);
    Ok(Prepared { input, observation, color, events, decode_time, features_time })
}

/// What is counted on the way.
#[derive(Default)]
struct Tally {
    result: RunResult,
}

impl Tally {
    fn event(&mut self, frame: Option<u32>, event: &Event) {
        let result = &mut self.result;
        result.warnings += usize::from(event.warning);
        if result.events.len() < MAX_EVENTS {
            result.events.push(RunEvent { frame, warning: event.warning, text: event.text.clone() });
        } else {
            result.events_left_out += 1;
        }
    }

    fn frame(&mut self, report: &FrameReport) {
        self.result.frames += 1;
        *self.result.states.entry(state_name(report.state).to_owned()).or_default() += 1;
        report.events.iter().for_each(|event| self.event(Some(report.id.0), event));
    }

    fn finish(mut self, slam: &Slam, path: FinalPath, slam_from_recorded: &Se3, timing: Timing) -> Outcome {
        let recorded = |pose: TrajectoryPose| TrajectoryPose {
            world_from_camera: pose.world_from_camera * *slam_from_recorded,
            ..pose
        };
        let final_stage = path.parts;
        let path = MainPath::of(path.poses.into_iter().map(recorded));
        let unrefined = MainPath::of(slam.trajectory().map(recorded)).trajectory;
        // The map of a pose is the one of that moment: after two maps were joined, poses reported before are still in the
        // frame of the old one.
        let online = MainPath::of(slam.online_trajectory().map(recorded));
        let tracked: BTreeSet<FrameId> = slam.online_trajectory().map(|pose| pose.id).collect();
        let lost: Vec<FrameId> =
            (0..slam.frame_count()).map(FrameId::from).filter(|id| !tracked.contains(id)).collect();
        for (part, frames) in path.maps.iter().filter(|(part, _)| Some(**part) != path.main) {
            let main = path.main.unwrap_or_default();
            let text = format!(
                "{part} was never joined to {main}: the {frames} frames in it have no place in that frame of reference and \
                 are not in the trajectory"
            );
            self.event(None, &Event { warning: true, text });
        }
        let of_class = |class| slam.map().points().filter(|point| point.class == class).count();
        let result = RunResult {
            tracked: tracked.len(),
            lost: lost.len(),
            lost_frames: ranges(&lost),
            maps: path.maps.iter().map(|(map, frames)| MapFrames { map: map.0, frames: *frames }).collect(),
            main_map: path.main.map(|map| map.0),
            in_trajectory: path.trajectory.poses.len(),
            other_map_frames: ranges(&path.others),
            online_other_map_frames: ranges(&online.others),
            keyframes: slam.map().keyframe_count(),
            map_points: slam.map().point_count(),
            map_points_on_things: of_class(KeypointClass::Thing),
            map_points_on_unknown: of_class(KeypointClass::Unknown),
            r#final: final_stage,
            depth: slam.context().depth.miscalibration(),
            ..self.result
        };
        Outcome { result, trajectory: path.trajectory, online: online.trajectory, unrefined, timing }
    }
}

fn state_name(state: TrackingState) -> &'static str {
    match state {
        TrackingState::NotInitialized => "not initialized",
        TrackingState::Ok => "ok",
        TrackingState::RecentlyLost => "recently lost",
        TrackingState::Lost => "lost",
    }
}

/// The poses of the map with the most frames (the older one of equals); maps have no common frame, so the poses of
/// others can't stand in the same trajectory.
struct MainPath {
    main: Option<MapId>,
    maps: BTreeMap<MapId, usize>,
    trajectory: Trajectory,
    others: Vec<FrameId>,
}

impl MainPath {
    fn of(poses: impl Iterator<Item = TrajectoryPose>) -> Self {
        let poses: Vec<_> = poses.collect();
        let mut maps = BTreeMap::new();
        for pose in &poses {
            *maps.entry(pose.map).or_default() += 1;
        }
        let main = maps.iter().max_by_key(|(map, frames)| (**frames, std::cmp::Reverse(**map))).map(|(map, _)| *map);
        let (here, others): (Vec<_>, Vec<_>) = poses.into_iter().partition(|pose| Some(pose.map) == main);
        let stamped = |pose: TrajectoryPose| StampedPose {
            stamp: schemas::Stamp(pose.stamp.0),
            world_from_camera: pose.world_from_camera,
        };
        let trajectory = Trajectory { poses: here.into_iter().map(stamped).collect() };
        Self { main, maps, trajectory, others: others.into_iter().map(|pose| pose.id).collect() }
    }
}

/// Ascending frames as ranges.
fn ranges(frames: &[FrameId]) -> Vec<Range<u32>> {
    let mut ranges: Vec<Range<u32>> = Vec::new();
    for FrameId(frame) in frames {
        match ranges.last_mut() {
            Some(last) if last.end == *frame => last.end += 1,
            _ => ranges.push(*frame..frame + 1),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;
    use slam_math::Stamp;

    #[test]
    fn only_the_largest_map_is_written() {
        let pose = |(id, map)| TrajectoryPose {
            id: FrameId(id),
            stamp: Stamp(i64::from(id)),
            map: MapId(map),
            world_from_camera: Se3::identity(),
        };
        let path = MainPath::of([(0, 0), (1, 0), (4, 1), (5, 1), (6, 1), (9, 2)].map(pose).into_iter());
        assert_eq!(path.main, Some(MapId(1)));
        assert_eq!(path.trajectory.poses.iter().map(|p| p.stamp.0).collect::<Vec<_>>(), [4, 5, 6]);
        assert_eq!(ranges(&path.others), [0..2, 9..10]);
        let tie = MainPath::of([(0, 1), (1, 0)].map(pose).into_iter());
        assert_eq!(tie.main, Some(MapId(0)));
        assert_eq!(MainPath::of(std::iter::empty()).main, None);
    }
}
