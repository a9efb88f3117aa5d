//! Single edits with their exact results.

use slam::map::{Correction, Join, Map, MapEdit, NewPoint};
use slam::report::KeypointClass;
use slam_math::{FrameId, KeyFrameId, MapId, MapPointId, Se3, Sim3};

use crate::map::{KEYPOINTS, appearance, check, content, keyframe, new_point, pose, position};

/// Keyframe 0 with a point a keypoint, and `others` keyframes that see all of them.
fn chain(part: MapId, others: u32, map: &mut Map) -> Vec<KeyFrameId> {
    let first = map.next_keyframe();
    map.apply(&keyframe(map, part, &[]));
    for index in 0..KEYPOINTS {
        assert!(map.apply(&new_point(first, index)));
    }
    let points: Vec<MapPointId> = map.points().filter(|p| p.map == part).map(|p| p.id).collect();
    for _ in 0..others {
        let id = map.next_keyframe();
        map.apply(&keyframe(map, part, &points));
        assert!(map.apply(&MapEdit::Connect(id)));
    }
    (0..=others).map(|i| KeyFrameId(first.0 + i)).collect()
}

#[test]
fn keyframes_that_share_points_are_neighbours_and_form_a_tree() {
    let mut map = Map::default();
    let ids = chain(MapId(0), 3, &mut map);
    check(&map);
    let last = map.keyframe(ids[3]).unwrap();
    assert_eq!(last.covisible, ids[..3].iter().map(|id| (*id, KEYPOINTS)).collect());
    assert_eq!(last.parent, Some(ids[0]));
    assert_eq!(map.keyframe(ids[0]).unwrap().children[..], ids[1..]);
    assert_eq!(map.keyframe(ids[0]).unwrap().parent, None);
}

#[test]
fn few_shared_points_link_only_the_best_neighbour() {
    let mut map = Map::default();
    let ids = chain(MapId(0), 1, &mut map);
    let points: Vec<MapPointId> = map.points().map(|p| p.id).take(5).collect();
    let id = map.next_keyframe();
    map.apply(&keyframe(&map, MapId(0), &points));
    map.apply(&MapEdit::Connect(id));
    assert_eq!(map.keyframe(id).unwrap().covisible[..], [(ids[0], 5)]);
    check(&map);
}

#[test]
fn a_removed_keyframe_follows_its_parent() {
    let mut map = Map::default();
    let ids = chain(MapId(0), 2, &mut map);
    let (before, _) = map.pose_of(ids[1]).unwrap();
    let parent_before = map.keyframe(ids[0]).unwrap().camera_from_world;
    assert!(map.apply(&MapEdit::CullKeyFrame(ids[1])));
    assert!(map.apply(&MapEdit::SetPose(ids[0], pose(99))));
    let expected = before * parent_before.inverse() * pose(99);
    let (now, part) = map.pose_of(ids[1]).unwrap();
    assert_eq!(part, MapId(0));
    assert!((now * expected.inverse()).log().norm() < 1e-9);
    check(&map);
}

#[test]
fn the_root_stays() {
    let mut map = Map::default();
    let ids = chain(MapId(0), 1, &mut map);
    let before = content(&map);
    assert!(!map.apply(&MapEdit::CullKeyFrame(ids[0])));
    assert_eq!(content(&map), before);
}

#[test]
fn merged_points_resolve_through_any_number_of_merges() {
    let mut map = Map::default();
    chain(MapId(0), 0, &mut map);
    for i in 0..4 {
        assert!(map.apply(&MapEdit::MergePoints { keep: MapPointId(i + 1), drop: MapPointId(i) }));
    }
    assert_eq!(map.current_point(MapPointId(0)), Some(MapPointId(4)));
    let heir = map.point(MapPointId(4)).unwrap();
    assert_eq!((heir.visible, heir.found), (5, 5), "counters add up");
    assert_eq!(heir.seen_in.len(), 1, "one keyframe sees a point once");
    assert!(map.apply(&MapEdit::CullPoint(MapPointId(4))));
    assert_eq!(map.current_point(MapPointId(0)), None);
    assert!(!map.apply(&MapEdit::MergePoints { keep: MapPointId(6), drop: MapPointId(6) }));
    check(&map);
}

#[test]
fn a_point_that_nobody_sees_any_more_goes() {
    let mut map = Map::default();
    let ids = chain(MapId(0), 1, &mut map);
    assert!(map.apply(&MapEdit::Unobserve(MapPointId(3), ids[0])));
    assert!(map.point(MapPointId(3)).is_some());
    assert!(map.apply(&MapEdit::Unobserve(MapPointId(3), ids[1])));
    assert!(map.point(MapPointId(3)).is_none());
    check(&map);
}

#[test]
fn edits_of_the_dead_do_nothing() {
    let mut map = Map::default();
    let ids = chain(MapId(0), 2, &mut map);
    let (dead_keyframe, dead_point, alive) = (ids[1], MapPointId(2), MapPointId(5));
    map.apply(&MapEdit::CullKeyFrame(dead_keyframe));
    map.apply(&MapEdit::CullPoint(dead_point));
    let before = content(&map);
    let class = KeypointClass::Stuff;
    let on_dead = NewPoint { position: position(1), keyframe: dead_keyframe, index: 0, frame: FrameId(9), class };
    let on_taken = NewPoint { keyframe: ids[0], index: 7, ..on_dead };
    let edits = [
        MapEdit::AddPoint(on_dead),
        MapEdit::AddPoint(on_taken),
        MapEdit::Observe(dead_point, ids[0], 2),
        MapEdit::Observe(alive, dead_keyframe, 2),
        MapEdit::Observe(alive, ids[0], 2),
        MapEdit::Unobserve(dead_point, ids[0]),
        MapEdit::Unobserve(alive, dead_keyframe),
        MapEdit::MergePoints { keep: alive, drop: dead_point },
        MapEdit::MergePoints { keep: dead_point, drop: alive },
        MapEdit::SetPose(dead_keyframe, pose(1)),
        MapEdit::SetPosition(dead_point, position(2)),
        MapEdit::CountSight(dead_point, true),
        MapEdit::SetDoubts(dead_point, 3),
        MapEdit::Refresh(dead_point, appearance(1)),
        MapEdit::Connect(dead_keyframe),
        MapEdit::CullPoint(dead_point),
        MapEdit::CullKeyFrame(dead_keyframe),
        MapEdit::LinkLoop(dead_keyframe, ids[0]),
        MapEdit::Correct(Box::new(Correction { based_on: 1, ..Correction::default() })),
    ];
    for edit in edits {
        assert!(!map.apply(&edit), "{}", edit.name());
        assert_eq!(content(&map), before, "{}", edit.name());
    }
}

#[test]
fn joining_moves_a_part_rigidly_and_leaves_the_other_alone() {
    let mut map = Map::default();
    let stays = chain(MapId(0), 2, &mut map);
    let moves = chain(MapId(1), 2, &mut map);
    map.apply(&MapEdit::CullKeyFrame(moves[1]));
    let before = map.clone();
    let by = Sim3::from(pose(50));
    let join = Some(Join { map: MapId(1), into: MapId(0), at: (moves[2], stays[1]) });
    let keyframes = vec![(moves[0], by), (moves[2], by)];
    assert!(map.apply(&MapEdit::Correct(Box::new(Correction { keyframes, join, ..Correction::default() }))));
    check(&map);
    assert_eq!(map.keyframe(moves[2]).unwrap().parent, Some(stays[1]), "one tree");
    assert_eq!(map.keyframe(moves[0]).unwrap().parent, Some(moves[2]), "turned round at the seam");
    assert_eq!(map.keyframe_count_of(MapId(1)), 0);
    for (was, now) in before.points().zip(map.points()) {
        if was.map == MapId(0) {
            assert_eq!(was, now);
            continue;
        }
        assert!((now.position - pose(50).transform(&was.position)).norm() < 1e-12);
        for s in &now.seen_in {
            let [a, b] = [&before, &map].map(|m| m.keyframe(s.keyframe).unwrap().camera_from_world);
            assert!((a.transform(&was.position) - b.transform(&now.position)).norm() < 1e-9);
        }
    }
    for id in stays {
        assert_eq!(before.pose_of(id), map.pose_of(id));
    }
    for id in moves {
        let (was, now): (Se3, _) = (before.pose_of(id).unwrap().0, map.pose_of(id).unwrap());
        assert_eq!(now.1, MapId(0), "a removed keyframe changes its part with its parent");
        assert!((now.0 * (was * pose(50).inverse()).inverse()).log().norm() < 1e-9);
    }
}
