//! In the steady state a frame asks the allocator for nothing: only what the map keeps takes new memory.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod counting;
#[allow(dead_code, reason = "shared with other tests")]
#[path = "it/support.rs"]
mod support;

use std::sync::Arc;

use slam::{Config, FrameInput, Inline, Observer, Slam, Work};
use slam_math::{FrameId, Stamp};
use slam_vision::Workspace;

/// Whether a job's result was applied.
#[derive(Default)]
struct Applied(bool);

impl Observer for Applied {
    fn done(&mut self, work: Work) {
        self.0 |= work == Work::Apply;
    }
}

/// A few frames of a room with movers, forth and back.
fn inputs(count: usize) -> impl Iterator<Item = FrameInput> {
    let world = fixtures::WorldConfig { actors: fixtures::scenario::demo().actors, ..support::room(120) };
    let frames = support::inputs(&world, (0..120).step_by(4));
    let order: Vec<usize> = (0..30).chain((1..29).rev()).collect();
    (0..count).map(move |id| FrameInput {
        id: FrameId(id as u32),
        stamp: Stamp(id as i64 * 33_000_000),
        ..frames[order[id % order.len()]].clone()
    })
}

/// Frames after which memory is as large as it gets: the filter keeps an anchor every 30 frames, eight in all.
const WARM: usize = 300;
/// Lists of an observation: those of one that a keyframe keeps are replaced.
const LISTS: u64 = 12;

#[test]
fn a_frame_between_keyframes_asks_for_no_memory() {
    // The camera sees the same again and again: with the default share it would need no keyframe any more.
    let mut config = Config::default();
    config.keyframes.tracked_share = 0.95;
    let mut slam = Slam::new(&config, &support::setup()).unwrap();
    let mut workspace = Workspace::default();
    let (mut between, mut others) = (Vec::new(), Vec::new());
    for input in inputs(500) {
        let before = counting::asked()[0];
        let obs = slam.front_end().observe(&input, &mut workspace).unwrap();
        let for_features = counting::asked()[0] - before;
        let obs = Arc::new(obs);
        let (mut applied, before) = (Applied::default(), counting::asked()[0]);
        let report = slam.step(&input, obs, &mut Inline, &mut applied).unwrap();
        let asked = for_features + counting::asked()[0] - before;
        if input.id.index() >= WARM {
            let has_keyframe = report.new_keyframe.is_some() || applied.0;
            if has_keyframe { &mut others } else { &mut between }.push(asked);
        }
    }
    assert!(others.len() > 10 && between.len() > 100, "{} frames with keyframes, {}", others.len(), between.len());
    assert!(others.iter().all(|asked| *asked > 0), "the map grows, and the counter sees it: {others:?}");
    let none = between.iter().filter(|asked| **asked == 0).count();
    // What a frame saw is kept for the final stage, in blocks of several frames.
    assert!(none * 10 >= between.len() * 8, "only {none} of {} asked for nothing: {between:?}", between.len());
    assert!(between.iter().all(|asked| *asked <= LISTS), "{between:?}");
}
