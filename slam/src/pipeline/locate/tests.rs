//! Which keypoints a frame is tracked by, and what becomes of a judgement. A wall of points, seen without noise.

use std::sync::Arc;

use slam_math::{Buffers, FrameId, Rng, Stamp};
use slam_vision::{Camera, Distortion, Features, GrayImage};

use super::*;
use crate::config::Config;
use crate::input::{PanopticMask, Segment, Sensor, Setup};
use crate::observation::Observation;
use crate::pipeline::{Inline, Slam, Unobserved};
use crate::report::{TrackingState, Verdict};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Keypoints a row, and in all.
const COLUMNS: usize = 20;
const KEYPOINTS: usize = COLUMNS * 15;
/// A Thing, by its number in no label set.
const BOX: u16 = 7;

fn camera() -> Camera {
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    Camera { fx: 260.0, fy: 260.0, cx: 159.5, cy: 119.5, width, height, distortion: Distortion::None }
}

/// Keypoint `i`, at 2 to 3 m, seen from a camera that has gone so far to the side.
fn place(i: usize, aside_m: f64) -> ([f64; 2], f64) {
    let depth = 2.0 + (i % 7) as f64 / 6.0;
    let (column, row) = ((i % COLUMNS) as f64, (i / COLUMNS) as f64);
    ([16.0 + 15.0 * column - camera().fx * aside_m / depth, 14.0 + 15.0 * row], depth)
}

/// The wall as a stereo camera sees it: with depth, but without a depth image, so that no place is known to be background. The
/// mask has the upper rows of keypoints on a Thing.
fn seen(frame: u32, thing_rows: usize) -> (FrameInput, Arc<Observation>) {
    let places: Vec<_> = (0..KEYPOINTS).map(|i| place(i, 0.004 * f64::from(frame))).collect();
    let mut features = Features::default();
    for (i, (pixel, _)) in places.iter().enumerate() {
        let mut rng = Rng::at(1, i as u32, 0, 0);
        features.pixel.push(pixel.map(|v| v as f32));
        features.octave.push(0);
        features.angle.push(0.0);
        features.response.push(50);
        features.descriptor.push(std::array::from_fn(|_| rng.next_u64()));
    }
    // It ends close below its last row: the next one is no border.
    let end = if thing_rows == 0 { 0 } else { 15 * thing_rows + 2 };
    let ids = (0..WIDTH * HEIGHT).map(|i| if i / WIDTH < end { 2 } else { 1 }).collect();
    let segments = [(1, 0), (2, BOX)].map(|(id, category)| Segment { id, category, score: 1.0 }).into();
    let mask = PanopticMask { width: WIDTH, height: HEIGHT, ids, segments };
    let depth_m = places.iter().map(|(_, depth)| *depth).collect();
    let obs = Observation::with_depth(features, depth_m, Some(&mask), &camera(), &Buffers::default());
    let input = FrameInput {
        id: FrameId(frame),
        stamp: Stamp(i64::from(frame) * 33_000_000),
        gray: GrayImage::new(WIDTH, HEIGHT, 0),
        right: None,
        depth: None,
        panoptic: Some(Arc::new(mask)),
    };
    (input, Arc::new(obs))
}

/// A slam that has tracked some frames of the wall.
fn at_work(config: &Config) -> (Slam, u32) {
    let category = |id, is_thing| crate::input::Category { id, name: format!("category {id}"), is_thing };
    let categories = vec![category(0, false), category(BOX, true)];
    let setup = Setup { camera: camera(), sensor: Sensor::Stereo { bf: 0.1 * camera().fx }, categories };
    let mut slam = Slam::new(config, &setup).unwrap();
    for frame in 0..8 {
        let (input, obs) = seen(frame, 0);
        let report = slam.step(&input, obs, &mut Inline, &mut Unobserved).unwrap();
        assert_eq!(report.state, TrackingState::Ok, "frame {frame}");
    }
    (slam, 8)
}

/// Goes on to the frame's selection with verdicts by keypoint.
fn with_verdicts<R>(
    config: &Config,
    verdict: impl Fn(usize) -> Verdict,
    then: impl FnOnce(&mut Step<'_>, &FrameFilter) -> R,
) -> R {
    let (mut slam, frame) = at_work(config);
    let (input, obs) = seen(frame, 0);
    let (mut inline, mut unobserved) = (Inline, Unobserved);
    let mut step = Step::new(&mut slam, &input, obs.clone(), &mut inline, &mut unobserved);
    let mut filter = step.slam.filter.label(&step.ctx, &input, &obs);
    (0..KEYPOINTS).for_each(|i| filter.verdict[i] = verdict(i));
    then(&mut step, &filter)
}

/// Every so manyth keypoint has the first verdict, the others the second.
fn every(n: usize, some: Verdict, others: Verdict) -> impl Fn(usize) -> Verdict {
    move |i| if i.is_multiple_of(n) { some } else { others }
}

/// The selection that a frame is tracked by and the inliers of its pose.
fn chosen(verdict: impl Fn(usize) -> Verdict) -> (Selection, u32) {
    with_verdicts(&Config::default(), verdict, |step, filter| {
        let attempt = step.best_attempt(filter).unwrap();
        (attempt.selection, attempt.fit.inliers)
    })
}

#[test]
fn selections_widen_one_by_one_until_the_pose_is_supported() {
    use Verdict::{Border, Person, Static, ThingDynamic, ThingNew, UnknownNew};
    let all = KEYPOINTS as u32;
    // A quarter of the wall is enough.
    assert_eq!(chosen(every(4, Static, Person)), (Selection::Static, all / 4));
    assert_eq!(chosen(every(4, Static, ThingNew)), (Selection::Static, all / 4), "no more than is needed");
    assert_eq!(chosen(every(25, Static, UnknownNew)), (Selection::WithUnconfirmed, all));
    assert_eq!(chosen(every(4, ThingNew, ThingDynamic)), (Selection::WithUnconfirmed, all / 4));
    assert_eq!(chosen(every(25, Static, ThingDynamic)), (Selection::AllButPeople, all));
    assert_eq!(chosen(every(4, Border, Person)), (Selection::AllButPeople, all / 4));
    assert_eq!(chosen(every(25, Static, Person)), (Selection::Everything, all));
    assert_eq!(chosen(|_| Person), (Selection::Everything, all), "a mask never costs a frame");
}

#[test]
fn a_selection_that_admits_no_more_than_the_one_before_is_not_reported() {
    // Few, but all there are: with everything in use there is nothing to widen to.
    let config = Config::default();
    let none_is_good = Config {
        tracking: crate::config::TrackingConfig { good_inliers: u32::MAX, ..config.tracking.clone() },
        ..config
    };
    let selection =
        with_verdicts(&none_is_good, |_| Verdict::Static, |step, filter| step.best_attempt(filter).unwrap().selection);
    assert_eq!(selection, Selection::Static);
}

#[test]
fn a_wider_selection_never_gives_a_frame_less_support() {
    let config = Config::default();
    // Nothing is ever good enough, so that all selections are tried.
    let none_is_good = Config {
        tracking: crate::config::TrackingConfig { good_inliers: u32::MAX, ..config.tracking.clone() },
        ..config
    };
    for seed in 0..6 {
        let verdict = |i: usize| Verdict::ALL[Rng::at(5, seed, i as u32, 0).below(8) as usize];
        with_verdicts(&none_is_good, verdict, |step, filter| {
            let best = step.best_attempt(filter).unwrap();
            for selection in Selection::ALL {
                step.frame.usable = filter.admitted(&step.ctx, selection);
                let Some(other) = step.attempt(selection, filter) else { continue };
                if other.fit.inliers >= step.needed_inliers() {
                    assert!(best.sigma_share <= other.sigma_share, "{seed}: {:?}, {selection:?}", best.selection);
                    assert!(selection >= best.selection || best.fit.inliers >= other.fit.inliers, "{seed}");
                }
            }
        });
    }
}

/// A frame in which the upper part of the wall is a new Thing is settled with what the consensus says about it. Gives whether it
/// is tracked, the matches before and after, and the inliers that are reported.
fn settled(rows: usize, disagrees: bool) -> (bool, [usize; 2], u32) {
    let (mut slam, frame) = at_work(&Config::default());
    let (input, obs) = seen(frame, rows);
    let (mut inline, mut unobserved) = (Inline, Unobserved);
    let mut step = Step::new(&mut slam, &input, obs.clone(), &mut inline, &mut unobserved);
    let mut filter = step.slam.filter.label(&step.ctx, &input, &obs);
    let things = filter.verdict.iter().filter(|verdict| **verdict == Verdict::ThingNew).count();
    assert_eq!((things, filter.tracks.len()), (rows * COLUMNS, 1));
    step.frame.usable = filter.admitted(&step.ctx, Selection::WithUnconfirmed);
    let mut attempt = step.attempt(Selection::WithUnconfirmed, &filter).unwrap();
    attempt.disagrees = vec![disagrees].into();
    let before = attempt.frame.match_count() as usize;
    let pose = attempt.frame.camera_from_world;
    let ok = step.settle(attempt, &mut filter);
    let off = (step.frame.camera_from_world * pose.inverse()).log().norm();
    assert!(off < 1e-6, "everything stands still, so the pose is the same either way: {off}");
    let condemned = filter.verdict.iter().filter(|verdict| **verdict == Verdict::ThingDynamic).count();
    assert_eq!(condemned, if disagrees { rows * COLUMNS } else { 0 });
    (ok, [before, step.frame.match_count() as usize], step.counts.inliers)
}

#[test]
fn what_turns_out_to_move_is_left_out() {
    let all = KEYPOINTS;
    assert_eq!(settled(5, false), (true, [all, all], all as u32));
    assert_eq!(settled(5, true), (true, [all, all - 5 * COLUMNS], (all - 5 * COLUMNS) as u32));
}

#[test]
fn a_judgement_that_leaves_nothing_does_not_stand() {
    let all = KEYPOINTS;
    // One row of twenty is less than a pose needs: the motion that all of them agree on is the camera's.
    assert_eq!(settled(14, true), (true, [all, all], all as u32));
    assert_eq!(settled(15, true), (true, [all, all], all as u32));
    // Two rows are enough.
    assert_eq!(settled(13, true), (true, [all, 2 * COLUMNS], 2 * COLUMNS as u32));
}
