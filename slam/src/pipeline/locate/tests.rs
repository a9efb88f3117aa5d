//! Which keypoints a frame is tracked by, and what becomes of a judgement. A wall of points, seen without noise.

use std::sync::Arc;

use slam_math::{Buffers, FrameId, Rng, Stamp};
use slam_vision::{Camera, Distortion, Features, GrayImage};

use super::*;
use crate::config::{Config, TrackingConfig};
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

/// A slam that has tracked eight frames of the wall.
fn at_work(config: &Config) -> Slam {
    let category = |id, is_thing| crate::input::Category { id, name: format!("category {id}"), is_thing };
    let categories = vec![category(0, false), category(BOX, true)];
    let setup = Setup { camera: camera(), sensor: Sensor::Stereo { bf: 0.1 * camera().fx }, categories };
    let mut slam = Slam::new(config, &setup).unwrap();
    for frame in 0..8 {
        let (input, obs) = seen(frame, 0);
        let report = slam.step(&input, obs, &mut Inline, &mut Unobserved).unwrap();
        assert_eq!(report.state, TrackingState::Ok, "frame {frame}");
    }
    slam
}

/// Goes on to the frame's selection with verdicts by keypoint.
fn with_verdicts<R>(
    config: &Config,
    verdict: impl Fn(usize) -> Verdict,
    then: impl FnOnce(&mut Step<'_>, &FrameFilter) -> R,
) -> R {
    with_frame(config, seen(8, 0), verdict, then)
}

/// The same with what the frame shows.
fn with_frame<R>(
    config: &Config,
    (input, obs): (FrameInput, Arc<Observation>),
    verdict: impl Fn(usize) -> Verdict,
    then: impl FnOnce(&mut Step<'_>, &FrameFilter) -> R,
) -> R {
    let mut slam = at_work(config);
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

/// The default configuration but for what makes a frame well supported.
fn good_from(good_inliers: u32, good_sigma_share: f64) -> Config {
    let config = Config::default();
    Config { tracking: TrackingConfig { good_inliers, good_sigma_share, ..config.tracking }, ..config }
}

/// The selection that a frame is tracked by and the inliers of its pose, when 50 inliers are good wherever they are.
fn chosen(verdict: impl Fn(usize) -> Verdict) -> (Selection, u32) {
    with_verdicts(&good_from(50, 1.0), verdict, |step, filter| {
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
    assert_eq!(chosen(every(4, Border, Person)), (Selection::WithBorders, all / 4));
    assert_eq!(chosen(every(4, Border, ThingDynamic)), (Selection::WithBorders, all / 4), "before what moves");
    assert_eq!(chosen(every(25, Static, Person)), (Selection::Everything, all));
    assert_eq!(chosen(|_| Person), (Selection::Everything, all), "a mask never costs a frame");
}

#[test]
fn many_keypoints_in_a_corner_are_no_support() {
    let corner = |i: usize| if i / COLUMNS < 8 && i % COLUMNS < 8 { Verdict::Static } else { Verdict::ThingNew };
    let [narrow, wide] = [Selection::Static, Selection::WithUnconfirmed].map(|selection| {
        with_verdicts(&Config::default(), corner, |step, filter| {
            step.frame.usable = filter.admitted(&step.ctx, selection);
            step.attempt(selection, filter).unwrap().sigma_share
        })
    });
    assert!(2.0 * wide < narrow, "{wide} {narrow}");
    let by = |good_sigma_share: f64| {
        with_verdicts(&good_from(50, good_sigma_share), corner, |step, filter| {
            step.best_attempt(filter).unwrap().selection
        })
    };
    assert_eq!(by(1.01 * narrow), Selection::Static);
    assert_eq!(by(0.99 * narrow), Selection::WithUnconfirmed);
}

#[test]
fn a_selection_that_admits_no_more_than_the_one_before_is_not_reported() {
    // Few, but all there are: with everything in use there is nothing to widen to.
    let none_is_good = good_from(u32::MAX, 1.0);
    let selection =
        with_verdicts(&none_is_good, |_| Verdict::Static, |step, filter| step.best_attempt(filter).unwrap().selection);
    assert_eq!(selection, Selection::Static);
}

#[test]
fn a_wider_selection_never_gives_a_frame_less_support() {
    // Nothing is ever good enough, so that all selections are tried.
    let none_is_good = good_from(u32::MAX, 1.0);
    for seed in 0..6 {
        let verdict = |i: usize| Verdict::ALL[Rng::at(5, seed, i as u32, 0).below(8)];
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

#[test]
fn a_wider_selection_that_fixes_the_pose_worse_is_not_taken() {
    // 48 keypoints in a corner have moved by 12 pixels, every sixth of the others is where it was, the rest is hidden.
    let is_mover = |i: usize| i / COLUMNS < 8 && i % COLUMNS < 6;
    let is_still = |i: usize| !is_mover(i) && i.is_multiple_of(6);
    let (input, obs) = seen(8, 0);
    let mut features = Features::default();
    for i in 0..KEYPOINTS {
        let moved = if is_mover(i) { 12.0 } else { 0.0 };
        let [x, y] = obs.raw_pixel[i];
        features.pixel.push([(x + moved) as f32, y as f32]);
        features.octave.push(0);
        features.angle.push(0.0);
        features.response.push(50);
        let descriptor = obs.descriptor[i];
        features.descriptor.push(if is_mover(i) || is_still(i) { descriptor } else { descriptor.map(|word| !word) });
    }
    let obs = Observation::with_depth(features, obs.depth_m.clone(), None, &camera(), &Buffers::default());
    let verdict = |i: usize| if is_mover(i) { Verdict::ThingDynamic } else { Verdict::Static };
    // Nothing is ever good enough, so that all selections are tried.
    with_frame(&good_from(u32::MAX, 1.0), (input, Arc::new(obs)), verdict, |step, filter| {
        let best = step.best_attempt(filter).unwrap();
        assert_eq!(best.selection, Selection::Static);
        step.frame.usable = filter.admitted(&step.ctx, Selection::Everything);
        let all = step.attempt(Selection::Everything, filter).unwrap();
        assert!(all.fit.inliers >= step.needed_inliers(), "it would do");
        assert!(all.sigma_share > best.sigma_share, "but the mover costs support");
    });
}

/// A frame in which the upper part of the wall is a new Thing is settled with what the consensus says about it. Gives whether it
/// is tracked, the matches before and after, and the inliers that are reported.
fn settled(rows: usize, disagrees: bool) -> (bool, [usize; 2], u32) {
    let mut slam = at_work(&Config::default());
    let (input, obs) = seen(8, rows);
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
