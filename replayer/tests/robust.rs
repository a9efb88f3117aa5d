//! What must not matter: what perturbations do, and that they leave a path as easy to find as it was.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::Arc;

use fixtures::{Intrinsics, World, WorldConfig, scenario};
use replayer::eval::{StampedPose, Trajectory};
use replayer::robust::{Perturbation, Sequence, judge, judge_all};
use slam::{Category, Config, DepthImage, FrameInput, PanopticMask, Segment, Sensor, Setup};
use slam_math::{FrameId, Stamp};
use slam_vision::{Camera, Distortion, gray_from_rgb};

const CAMERA: Intrinsics =
    Intrinsics { width: 320, height: 240, fx_px: 262.5, fy_px: 262.5, cx_px: 155.5, cy_px: 119.5 };

/// A room where nothing moves (what moves makes errors depend on much), the camera as slow as in its scenario.
fn sequence(frame_count: u32) -> Sequence {
    let mut world = WorldConfig { camera: CAMERA, texels_per_metre: 160.0, ..scenario::static_room() };
    let share = f64::from(frame_count) / f64::from(world.frame_count);
    let path = &mut world.camera_path;
    path.amplitude_m.iter_mut().chain(&mut path.look_amplitude_m).for_each(|metres| *metres *= share);
    (path.sway_m, path.sway_rad, world.frame_count) = (path.sway_m * share, path.sway_rad * share, frame_count);
    let world = World::new(&world).unwrap();
    let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
    let (mut frames, mut poses) = (Vec::new(), Vec::new());
    for index in 0..frame_count {
        let frame = world.frame(index);
        let segment = |s: &fixtures::Segment| Segment { id: s.id, category: s.category_id, score: 1.0 };
        let segments = frame.panoptic.segments.iter().map(segment).collect();
        let metres_per_unit = 1.0 / world.config().depth_units_per_metre;
        frames.push(FrameInput {
            id: FrameId(index),
            stamp: Stamp(frame.stamp_ns),
            gray: gray_from_rgb(&frame.rgb, width, height).unwrap(),
            right: None,
            depth: Some(Arc::new(DepthImage { width, height, units: frame.depth_units, metres_per_unit })),
            panoptic: Some(Arc::new(PanopticMask { width, height, ids: frame.panoptic.ids, segments })),
        });
        let stamp = schemas::Stamp(frame.stamp_ns);
        poses.push(StampedPose { stamp, world_from_camera: frame.world_from_camera });
    }
    let categories = world.categories().iter();
    let categories = categories.map(|c| Category { id: c.id, name: c.name.into(), is_thing: c.is_thing }).collect();
    let Intrinsics { width, height, fx_px: fx, fy_px: fy, cx_px: cx, cy_px: cy } = CAMERA;
    let camera = Camera { fx, fy, cx, cy, width, height, distortion: Distortion::None };
    Sequence { frames, setup: Setup { camera, sensor: Sensor::Rgbd, categories }, truth: Trajectory { poses } }
}

/// What a frame holds, to compare.
#[derive(PartialEq)]
struct Content<'a> {
    id: FrameId,
    stamp: Stamp,
    gray: &'a [u8],
    depth: Option<&'a [u16]>,
    mask: Option<&'a [u16]>,
}

fn content(frame: &FrameInput) -> Content<'_> {
    let (depth, mask) = (frame.depth.as_ref(), frame.panoptic.as_ref());
    let (depth, mask) = (depth.map(|d| &d.units[..]), mask.map(|m| &m.ids[..]));
    Content { id: frame.id, stamp: frame.stamp, gray: &frame.gray.data, depth, mask }
}

fn assert_same(a: &Sequence, b: &Sequence) {
    assert_eq!(a.frames.len(), b.frames.len());
    for (a, b) in a.frames.iter().zip(&b.frames) {
        assert!(content(a) == content(b), "frame {}", a.id.0);
    }
    for (a, b) in a.truth.poses.iter().zip(&b.truth.poses) {
        assert_eq!(a, b);
    }
    assert!((a.setup.camera.cx - b.setup.camera.cx).abs() < 1e-9);
}

/// Share of frames that are what they were.
fn same_share(before: &Sequence, after: &Sequence) -> f64 {
    let same = before.frames.iter().zip(&after.frames).filter(|(a, b)| content(a) == content(b));
    same.count() as f64 / before.frames.len() as f64
}

#[test]
fn a_mirror_and_time_turned_back_undo_themselves() {
    let before = sequence(4);
    for twice in [Perturbation::Mirrored, Perturbation::Backwards] {
        let once = twice.apply(&before).unwrap();
        assert!(same_share(&before, &once) < 1.0, "{twice} does something");
        assert_same(&before, &twice.apply(&once).unwrap());
    }
}

#[test]
fn every_name_is_read_back_and_others_are_refused() {
    for known in Perturbation::ALL {
        assert_eq!(known.to_string().parse(), Ok(known));
    }
    let error = "upside-down".parse::<Perturbation>().unwrap_err();
    assert!(Perturbation::ALL.iter().all(|known| error.contains(&known.to_string())), "{error}");
}

#[test]
fn frames_and_masks_go_as_their_name_says() {
    let before = sequence(60);
    let after = |perturbation: Perturbation| perturbation.apply(&before).unwrap();
    assert_same(&before, &after(Perturbation::AsRecorded));
    let later = after(Perturbation::Start(7));
    assert_eq!((later.frames.len(), later.frames[0].id.0, later.frames[0].stamp), (53, 0, before.frames[7].stamp));
    let second = after(Perturbation::EverySecond);
    assert_eq!((second.frames.len(), second.frames[1].stamp), (30, before.frames[2].stamp));
    let mean = |s: &Sequence| s.frames[0].gray.data.iter().map(|v| f64::from(*v)).sum::<f64>();
    let share = mean(&after(Perturbation::Brightness(80))) / mean(&before);
    assert!((share - 0.8).abs() < 0.01, "{share}");
    let masks = |s: &Sequence| s.frames.iter().filter(|frame| frame.panoptic.is_some()).count();
    assert_eq!(masks(&after(Perturbation::NoMasks)), 0);
    // One second at 30 Hz, both ends included.
    assert!((30..=31).contains(&(60 - masks(&after(Perturbation::MasksDropped)))));
    let late = after(Perturbation::MasksLate);
    assert_eq!(content(&late.frames[20]).mask, content(&before.frames[15]).mask);
    assert_eq!(Perturbation::Features(900).config(&Config::default()).orb.features, 900);
    assert_eq!(Perturbation::Seed(3).config(&Config::default()).seed, 3);
    assert!(Perturbation::Start(60).apply(&before).is_none(), "no frame is left");
    let without = after(Perturbation::NoMasks);
    assert!(Perturbation::ALL.into_iter().filter(|p| p.spoils_labels()).all(|p| p.apply(&without).is_none()));
}

#[test]
fn label_noise_is_a_function_of_the_frame_and_neither_little_nor_all() {
    let (width, height) = (640, 480);
    // Tiles of 80 px, each a segment with a category of its own.
    let ids = (0..width * height).map(|i| 1 + (i % width / 80 + i / width / 80 * 8) as u16).collect();
    let segments = (1..=48).map(|id| Segment { id, category: id, score: 1.0 }).collect();
    let mask = Arc::new(PanopticMask { width, height, ids, segments });
    let mut before = sequence(1);
    let frame = FrameInput { panoptic: Some(mask.clone()), ..before.frames[0].clone() };
    before.frames = vec![frame; 40];
    let [after, again] = [(); 2].map(|()| Perturbation::LabelNoise.apply(&before).unwrap());
    assert_same(&after, &again);
    for frame in &after.frames {
        let noisy = frame.panoptic.as_ref().unwrap();
        let changed = noisy.ids.iter().zip(&mask.ids).filter(|(a, b)| a != b).count();
        let share = changed as f64 / mask.ids.len() as f64;
        assert!((0.02..0.4).contains(&share), "frame {}: {share}", frame.id.0);
        assert_eq!(noisy.segments, mask.segments);
    }
}

#[test]
fn mirrored_truth_fits_mirrored_pictures() {
    let sequence = sequence(60);
    let config = Config::default();
    let mirrored = Perturbation::Mirrored.apply(&sequence).unwrap();
    let error = |sequence| judge(sequence, &config, 2).unwrap().error_m.rmse;
    let (plain, same) = (error(&sequence), error(&mirrored));
    assert!(plain < 0.02 && same < 0.02, "{plain} {same}");
    // The test sees a truth that is not mirrored, and a camera that is not.
    let wrong = Sequence { truth: sequence.truth.clone(), ..mirrored.clone() };
    let wrong = error(&wrong);
    assert!(wrong > 3.0 * same, "{wrong} {same}");
    let all = [(Perturbation::Mirrored, &config), (Perturbation::Start(60), &config), (Perturbation::NoMasks, &config)];
    let verdicts = judge_all(&sequence, &all, 3, &|_| {});
    assert_eq!(verdicts[0].as_ref().unwrap().judged.as_ref().unwrap().error_m.rmse, same, "threads change nothing");
    assert!(verdicts[1].is_none());
    assert_eq!(verdicts[2].as_ref().unwrap().frames, 60);
}

#[test]
fn without_truth_there_is_no_verdict() {
    let sequence = Sequence { truth: Trajectory::default(), ..sequence(4) };
    assert!(judge(&sequence, &Config::default(), 1).is_err());
}
