//! Random edits never break what the map promises.

use std::sync::Arc;

use nalgebra::{Vector3, Vector6};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use slam::map::{Appearance, Correction, Editor, Join, KeyFrame, Map, MapEdit, MapPoint, NewPoint};
use slam::report::KeypointClass;
use slam_math::{Buffer, Buffers, FrameId, KeyFrameId, MapId, MapPointId, Rng, Se3, Sim3, Stamp};

use crate::support::{descriptor, observation};

pub const KEYPOINTS: u32 = 24;

/// A pose that depends on the number alone.
pub fn pose(seed: u32) -> Se3 {
    let mut rng = Rng::at(3, seed, 0, 0);
    Se3::exp(&Vector6::from_fn(|_, _| rng.uniform() - 0.5))
}

pub fn position(seed: u32) -> Vector3<f64> {
    let mut rng = Rng::at(4, seed, 0, 0);
    Vector3::from_fn(|_, _| rng.uniform() * 4.0)
}

/// The next keyframe of a part; keypoint `i` sees `points[i]`.
pub fn keyframe(map: &Map, part: MapId, points: &[MapPointId]) -> MapEdit {
    let id = map.next_keyframe();
    let pixels: Vec<[f64; 2]> = (0..KEYPOINTS).map(|i| [10.0 + 12.0 * f64::from(i), 40.0]).collect();
    let descriptors: Vec<_> = (0..KEYPOINTS).map(|i| descriptor(id.0, i)).collect();
    let mut seen: Vec<Option<MapPointId>> = points.iter().map(|p| Some(*p)).take(KEYPOINTS as usize).collect();
    seen.resize(KEYPOINTS as usize, None);
    MapEdit::AddKeyFrame(Box::new(KeyFrame {
        id,
        frame: FrameId(id.0),
        stamp: Stamp(0),
        map: part,
        obs: Arc::new(observation(&pixels, &descriptors)),
        class: Arc::new(vec![KeypointClass::Stuff; KEYPOINTS as usize]),
        usable: Arc::new(vec![true; KEYPOINTS as usize]),
        points: seen.into(),
        camera_from_world: pose(id.0),
        covisible: Buffer::default(),
        parent: None,
        children: Default::default(),
        loops: Default::default(),
    }))
}

pub fn new_point(keyframe: KeyFrameId, index: u32) -> MapEdit {
    let class = KeypointClass::Stuff;
    MapEdit::AddPoint(NewPoint { position: position(index), keyframe, index, frame: FrameId(keyframe.0), class })
}

pub fn appearance(seed: u32) -> Appearance {
    Appearance {
        descriptor: descriptor(seed, 0),
        described: 1,
        normal: position(seed).normalize(),
        range_m: [0.5, 4.0],
    }
}

type Row = (
    KeyFrameId,
    MapId,
    [f64; 12],
    Vec<Option<MapPointId>>,
    Vec<(KeyFrameId, u32)>,
    Option<KeyFrameId>,
    Vec<KeyFrameId>,
);

/// Everything a reader of the map can see.
#[derive(Debug, Clone, PartialEq)]
pub struct Content {
    keyframes: Vec<Row>,
    points: Vec<MapPoint>,
    next: (KeyFrameId, MapPointId),
    poses: Vec<Option<([f64; 12], MapId)>>,
    current: Vec<Option<MapPointId>>,
}

pub fn content(map: &Map) -> Content {
    let row = |k: &KeyFrame| {
        let pose = k.camera_from_world.rows();
        (k.id, k.map, pose, k.points.to_vec(), k.covisible.to_vec(), k.parent, k.children.to_vec())
    };
    let (keyframe, point) = (map.next_keyframe(), map.next_point());
    Content {
        keyframes: map.keyframes().map(row).collect(),
        points: map.points().cloned().collect(),
        next: (keyframe, point),
        poses: (0..keyframe.0).map(|i| map.pose_of(KeyFrameId(i)).map(|(p, m)| (p.rows(), m))).collect(),
        current: (0..point.0).map(|i| map.current_point(MapPointId(i))).collect(),
    }
}

/// Panics when something in the map contradicts something else.
pub fn check(map: &Map) {
    assert_eq!(map.keyframe_count(), map.keyframes().count());
    assert_eq!(map.point_count(), map.points().count());
    map.check(8).unwrap();
}

/// Three raw numbers choose an edit; ids may be dead or not there yet.
fn edit(map: &Map, kind: u32, a: u32, b: u32) -> MapEdit {
    let keyframe_id = KeyFrameId(a % (map.next_keyframe().0 + 1));
    let point_id = MapPointId(b % (map.next_point().0 + 1));
    let part = map.keyframe(keyframe_id).map_or(MapId(a % 2), |k| k.map);
    let of_part: Vec<MapPointId> = map.points().filter(|p| p.map == part).map(|p| p.id).collect();
    let chosen = if of_part.is_empty() { map.next_point() } else { of_part[b as usize % of_part.len()] };
    match kind % 16 {
        0 | 1 => {
            let start = b as usize % (of_part.len() / 3 + 1);
            keyframe(map, part, &of_part[start..])
        }
        2..=5 => new_point(keyframe_id, b % KEYPOINTS),
        6 => MapEdit::Observe(chosen, keyframe_id, (a / 7 + b) % KEYPOINTS),
        7 => MapEdit::Unobserve(point_id, keyframe_id),
        8 => {
            let keep = map.point(point_id).map_or(MapId(0), |p| p.map);
            let drop = map.points().filter(|p| p.map == keep).map(|p| p.id).nth(a as usize % 7);
            MapEdit::MergePoints { keep: point_id, drop: drop.unwrap_or(map.next_point()) }
        }
        9 => MapEdit::SetPose(keyframe_id, pose(a ^ b)),
        10 => MapEdit::SetPosition(point_id, position(a ^ b)),
        11 => MapEdit::CountSight(point_id, a.is_multiple_of(2)),
        12 | 13 => MapEdit::Connect(keyframe_id),
        14 if !a.is_multiple_of(3) => MapEdit::CullKeyFrame(keyframe_id),
        14 if b.is_multiple_of(5) => MapEdit::Correct(Box::new(correction(map, keyframe_id, a, b))),
        14 if b.is_multiple_of(3) => MapEdit::LinkLoop(keyframe_id, KeyFrameId(b % (map.next_keyframe().0 + 1))),
        14 => MapEdit::Refresh(point_id, appearance(a)),
        _ if a.is_multiple_of(3) => MapEdit::CullPoint(point_id),
        _ => MapEdit::SetDoubts(point_id, a),
    }
}

/// Moves a keyframe and what hangs on it, or joins its part to the other one.
fn correction(map: &Map, id: KeyFrameId, a: u32, b: u32) -> Correction {
    let other = map.keyframes().find(|k| Some(k.map) != map.keyframe(id).map(|k| k.map));
    let join = map.keyframe(id).zip(other).filter(|_| a.is_multiple_of(2));
    Correction {
        based_on: map.corrections() + u32::from(b.is_multiple_of(4)),
        keyframes: vec![(id, Sim3 { scale: 1.1, se3: pose(a) })],
        points: vec![(MapPointId(b % (map.next_point().0 + 1)), position(b))],
        join: join.map(|(k, other)| Join { map: k.map, into: other.map, at: (k.id, other.id) }),
        then: vec![MapEdit::Connect(id)],
    }
}

fn distance(a: &Se3, b: &Se3) -> f64 {
    a.rows().iter().zip(b.rows()).map(|(a, b)| (a - b).abs()).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn edits_keep_the_map_consistent(raw in proptest::collection::vec((0..64u32, 0..1000u32, 0..1000u32), 1..140)) {
        let mut map = Map::default();
        map.apply(&keyframe(&map, MapId(0), &[]));
        map.apply(&keyframe(&map, MapId(1), &[]));
        let mut merged = Vec::new();
        for (kind, a, b) in raw {
            let edit = edit(&map, kind, a, b);
            let (before, snapshot) = (content(&map), map.clone());
            let applied = map.apply(&edit);
            check(&map);
            prop_assert_eq!(&content(&snapshot), &before, "a snapshot changed with {:?}", edit.name());
            if !applied {
                prop_assert_eq!(content(&map), before, "{} did nothing but changed the map", edit.name());
                continue;
            }
            match edit {
                MapEdit::MergePoints { keep, drop } => merged.push((drop, keep)),
                MapEdit::CullKeyFrame(id) => {
                    let (was, now) = (snapshot.pose_of(id).unwrap(), map.pose_of(id).unwrap());
                    prop_assert!(map.keyframe(id).is_none());
                    prop_assert!(distance(&was.0, &now.0) < 1e-9, "{was:?} became {now:?}");
                    prop_assert_eq!(was.1, now.1);
                }
                _ => {}
            }
            for (drop, keep) in &merged {
                prop_assert!(map.point(*drop).is_none());
                prop_assert_eq!(map.current_point(*drop), map.current_point(*keep));
            }
            prop_assert!((0..map.next_keyframe().0).all(|i| map.pose_of(KeyFrameId(i)).is_some()));
        }
    }

    /// A job edits a snapshot while the live map goes on, each with points of its own.
    #[test]
    fn a_journal_fits_a_map_that_has_gone_on(
        before in proptest::collection::vec((0..64u32, 0..1000u32, 0..1000u32), 1..60),
        job in proptest::collection::vec((2..64u32, 0..1000u32, 0..1000u32), 1..60),
        meanwhile in proptest::collection::vec((0..64u32, 0..1000u32, 0..1000u32), 0..40),
    ) {
        let mut map = Map::default();
        map.apply(&keyframe(&map, MapId(0), &[]));
        map.apply(&keyframe(&map, MapId(1), &[]));
        for (kind, a, b) in before {
            let edit = edit(&map, kind, a, b);
            map.apply(&edit);
        }
        let (mut snapshot, mut live) = (map.snapshot(), map.clone());
        let mut editor = Editor::new(&mut snapshot, &Buffers::default());
        for (kind, a, b) in job {
            // Jobs make no keyframes.
            let edit = edit(editor.map(), kind, a, b);
            if !matches!(edit, MapEdit::AddKeyFrame(_)) {
                editor.apply(edit);
            }
        }
        let (journal, _) = editor.finish();

        let same = Editor::new(&mut map, &Buffers::default()).replay(journal.clone());
        prop_assert_eq!(live_content(&map), live_content(&snapshot), "nothing happened meanwhile");
        prop_assert!((0..map.next_point().0).all(|id| same.now(MapPointId(id)) == Some(MapPointId(id))));

        for (kind, a, b) in meanwhile {
            let edit = edit(&live, kind, a, b);
            live.apply(&edit);
        }
        let first_new = live.next_point();
        let made = journal.edits().iter().filter(|e| matches!(e, MapEdit::AddPoint(_))).count() as u32;
        let mut editor = Editor::new(&mut live, &Buffers::default());
        let renaming = editor.replay(journal);
        let (replayed, counts) = editor.finish();
        check(&live);
        prop_assert_eq!(counts.applied as usize, replayed.edits().len());
        let first_in_job = map.next_point().0 - made;
        let renamed = (0..made).filter_map(|i| renaming.now(MapPointId(first_in_job + i)));
        let expected = (first_new.0..live.next_point().0).map(MapPointId);
        prop_assert!(renamed.eq(expected), "new points get the next ids, in order");
    }
}

/// What a snapshot has as well: all but where removed things went.
fn live_content(map: &Map) -> Content {
    Content { poses: Vec::new(), current: Vec::new(), ..content(map) }
}
