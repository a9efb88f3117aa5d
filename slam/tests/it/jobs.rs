//! Background jobs take effect at their frame, whoever runs them and however long it takes.

use std::collections::BTreeMap;
use std::sync::Arc;

use fixtures::WorldConfig;
use slam::report::{FrameReport, TrackingState};
use slam::{Config, Executor, FrameInput, Inline, Job, JobKind, JobResult, Slam, SlamError, Ticket, Unobserved};
use slam_math::{KeyFrameId, Rng};
use slam_vision::Workspace;

use crate::support::{inputs, room, setup};

/// Does nothing until it must, then everything in reverse order; in a hurry, applies results at a whim.
#[derive(Default)]
pub struct Lazy {
    jobs: BTreeMap<Ticket, Job>,
    results: BTreeMap<Ticket, JobResult>,
    hurry: Option<u32>,
}

impl Executor for Lazy {
    fn submit(&mut self, ticket: Ticket, job: Job) -> Option<JobResult> {
        self.jobs.insert(ticket, job);
        None
    }

    fn collect(&mut self, ticket: Ticket) -> Option<JobResult> {
        while let Some((ticket, job)) = self.jobs.pop_last() {
            self.results.insert(ticket, job.run());
        }
        self.results.remove(&ticket)
    }

    fn hurry(&self, ticket: Ticket) -> bool {
        self.hurry.is_some_and(|seed| Rng::at(1, seed, 0, ticket.0 as u32).uniform() < 0.5)
    }
}

/// Loses what it is given.
struct Leaky;

impl Executor for Leaky {
    fn submit(&mut self, _: Ticket, _: Job) -> Option<JobResult> {
        None
    }

    fn collect(&mut self, _: Ticket) -> Option<JobResult> {
        None
    }
}

fn with_lag(lag: u32) -> Config {
    let mut config = Config::default();
    config.jobs.mapping_lag_frames = lag;
    config
}

const FRAMES: u32 = 40;

/// A gaze that sweeps through the room: many keyframes.
fn world() -> Vec<FrameInput> {
    let mut world: WorldConfig = room(200);
    world.camera_path.amplitude_m = [0.1, 0.05, 0.02];
    world.camera_path.look_amplitude_m = [6.0, 0.0, 0.0];
    inputs(&world, 64..64 + FRAMES)
}

fn run(
    config: &Config,
    inputs: &[FrameInput],
    executor: &mut dyn Executor,
) -> Result<(Slam, Vec<FrameReport>), SlamError> {
    let mut slam = Slam::new(config, &setup())?;
    let mut workspace = Workspace::default();
    let mut reports = Vec::new();
    for input in inputs {
        let obs = slam.front_end().observe(input, &mut workspace)?;
        reports.push(slam.step(input, Arc::new(obs), executor, &mut Unobserved)?);
    }
    slam.settle(executor)?;
    Ok((slam, reports))
}

fn path(slam: &Slam) -> Vec<[f64; 12]> {
    slam.trajectory().map(|p| p.world_from_camera.rows()).collect()
}

/// Frames in which keyframes were made, without the first.
fn keyframes(reports: &[FrameReport]) -> Vec<u32> {
    reports.iter().filter(|r| r.new_keyframe.is_some_and(|id| id > KeyFrameId(0))).map(|r| r.id.0).collect()
}

#[test]
fn who_runs_the_jobs_makes_no_difference() {
    let inputs = world();
    for lag in [0, 1, 3] {
        let (slam, reports) = run(&with_lag(lag), &inputs, &mut Inline).unwrap();
        let (lazy, lazy_reports) = run(&with_lag(lag), &inputs, &mut Lazy::default()).unwrap();
        assert!(keyframes(&reports).len() >= 3, "{:?}", keyframes(&reports));
        assert!(reports.iter().all(|r| r.state == TrackingState::Ok));
        assert!(reports.iter().zip(&lazy_reports).all(|(a, b)| a.records == b.records), "lag {lag}");
        assert_eq!(path(&slam), path(&lazy), "lag {lag}");
    }
}

#[test]
fn results_take_effect_exactly_when_they_are_due() {
    let inputs = world();
    let mapped = |r: &FrameReport| r.counts.points_fused > 0;
    for lag in [0, 2, 4] {
        let (_, reports) = run(&with_lag(lag), &inputs, &mut Lazy::default()).unwrap();
        let made = keyframes(&reports);
        let due: Vec<u32> = made.iter().map(|f| f + lag).filter(|f| *f < FRAMES).collect();
        let applied: Vec<u32> = reports.iter().filter(|r| mapped(r)).map(|r| r.id.0).collect();
        assert_eq!(applied, due, "lag {lag}: keyframes at {made:?}");
        assert!(made.windows(2).all(|w| w[1] - w[0] >= lag.max(1)), "none while mapping is in flight: {made:?}");
    }
}

#[test]
fn results_applied_early_are_found() {
    let inputs = world();
    let (_, reports) = run(&with_lag(3), &inputs, &mut Inline).unwrap();
    let (_, hurried) = run(&with_lag(3), &inputs, &mut Lazy { hurry: Some(5), ..Lazy::default() }).unwrap();
    let same = reports.iter().zip(&hurried).take_while(|(a, b)| a.records == b.records).count();
    assert!(same < reports.len(), "the digests must tell");
}

#[test]
fn a_lost_job_is_an_error() {
    let error = run(&with_lag(2), &world(), &mut Leaky).map(|_| ()).unwrap_err();
    assert!(matches!(&error, SlamError::Job { kind, .. } if *kind == JobKind::Mapping.name()), "{error}");
}

#[test]
fn a_job_in_flight_at_the_end_is_settled() {
    let inputs = world();
    let (config, executor) = (with_lag(FRAMES), &mut Lazy::default());
    let mut slam = Slam::new(&config, &setup()).unwrap();
    let mut workspace = Workspace::default();
    for input in &inputs {
        let obs = slam.front_end().observe(input, &mut workspace).unwrap();
        slam.step(input, Arc::new(obs), executor, &mut Unobserved).unwrap();
    }
    let before = path(&slam);
    slam.settle(executor).unwrap();
    let after = path(&slam);
    assert_ne!(before, after, "bundle adjustment has moved the keyframe");
    slam.settle(executor).unwrap();
    assert_eq!(path(&slam), after);
}
