//! What holds from packet to packet, and poses along a chain of segments.

use recorder::mocap::MocapFrame;
use recorder::mocap::vicon::object::*;
use recorder::mocap::vicon::packet::{Inbox, Packet, PacketWriter};
use recorder::mocap::vicon::{Scene, Segments as Kind};
use recorder::mocap::wire::Wire;
use std::collections::BTreeSet;

fn packet(add: impl Fn(&mut PacketWriter), unchanged: &[u32]) -> Packet {
    let mut writer = PacketWriter::default();
    let unchanged: BTreeSet<u32> = unchanged.iter().copied().collect();
    writer.add(id::CONTENTS, &Contents { unchanged, ..Contents::default() });
    add(&mut writer);
    let mut inbox = Inbox::default();
    inbox.push(&writer.finish());
    inbox.next_packet().unwrap().unwrap()
}

fn subject(subject: u32, name: &str) -> SubjectInfo {
    let segment = |parent, segment: u32| SegmentInfo { parent, segment, bounds: [0.0; 6], name: format!("s{segment}") };
    let segments = vec![segment(0, 1), segment(1, 2), segment(2, 3)];
    SubjectInfo { subject, name: name.to_owned(), segments, ..SubjectInfo::default() }
}

/// A quarter turn about z and a shift along x.
fn pose(segment: u32, x_mm: f64) -> SegmentPose {
    let rotation = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    SegmentPose { segment, translation_mm: [x_mm, 0.0, 0.0], rotation }
}

fn frame(scene: &Scene) -> MocapFrame {
    scene.frame(Kind::Global, &[]).unwrap()
}

fn full(w: &mut PacketWriter, frame_id: u32) {
    w.add(id::STREAM_INFO, &StreamInfo { frame_period_ticks: 1_350_000 });
    w.add(id::SUBJECT_INFO, &subject(1, "a"));
    w.add(id::SUBJECT_INFO, &subject(2, "b"));
    w.add(id::OBJECT_QUALITY, &ObjectQuality { subject: 1, quality: 0.5 });
    w.add(id::FRAME_INFO, &FrameInfo { frame_id });
    w.add(id::GLOBAL_SEGMENTS, &Segments { subject: 1, poses: vec![pose(1, 1000.0)] });
    w.add(id::LATENCY_INFO, &LatencyInfo { samples: vec![Latency { name: "l".to_owned(), seconds: 0.5 }] });
}

#[test]
fn without_static_objects_the_old_ones_stay() {
    let mut scene = Scene::default();
    assert!(scene.take(packet(|w| full(w, 7), &[])).unwrap());
    let first = frame(&scene);
    assert_eq!((first.number, first.rate_hz, first.bodies.len()), (Some(8), Some(100.0), 6));
    assert_eq!(first.bodies[0].quality, Some(0.5));
    assert!(scene.take(packet(|w| w.add(id::FRAME_INFO, &FrameInfo { frame_id: 8 }), &[])).unwrap());
    let second = frame(&scene);
    assert_eq!((second.number, second.rate_hz, second.bodies.len()), (Some(9), Some(100.0), 6));
    assert!(second.latency.is_empty(), "a dynamic object that is neither sent nor unchanged is gone");
    assert!(second.bodies.iter().all(|body| body.world_from_segment.is_none()), "all are occluded");
    assert_eq!(second.bodies[1].parent, "s1");
}

#[test]
fn with_static_objects_only_the_unchanged_ones_stay() {
    let mut scene = Scene::default();
    scene.take(packet(|w| full(w, 7), &[])).unwrap();
    let second = |w: &mut PacketWriter| {
        w.add(id::OBJECT_QUALITY, &ObjectQuality { subject: 1, quality: 0.25 });
        w.add(id::FRAME_INFO, &FrameInfo { frame_id: 8 });
    };
    let unchanged = [id::SUBJECT_INFO, id::OBJECT_QUALITY, id::GLOBAL_SEGMENTS, id::LATENCY_INFO];
    scene.take(packet(second, &unchanged)).unwrap();
    let carried = frame(&scene);
    assert_eq!(carried.bodies[0].quality, Some(0.25), "what is sent goes before what is unchanged");
    assert_eq!(carried.rate_hz, None, "neither sent nor unchanged");
    assert_eq!(carried.bodies.len(), 6);
    assert_eq!(carried.latency_s(), Some(0.5));
    let seen: Vec<bool> = carried.bodies.iter().map(|body| body.world_from_segment.is_some()).collect();
    assert_eq!(seen, [true, false, false, false, false, false]);
    scene.take(packet(second, &[])).unwrap();
    assert!(frame(&scene).bodies.is_empty(), "the subjects were neither sent nor unchanged");
}

#[test]
fn packets_without_a_frame_and_unknown_objects() {
    let mut scene = Scene::default();
    scene.take(packet(|w| full(w, 7), &[])).unwrap();
    let echo = |w: &mut PacketWriter| {
        w.add(id::PING, &Ping { id: 1 });
        w.add(4_000_000_000, &Ping { id: 1 });
        w.add(id::KEEP_ALIVE, &Vec::<u8>::new());
    };
    assert!(!scene.take(packet(echo, &[])).unwrap());
    assert_eq!(frame(&scene).bodies.len(), 6);
}

#[test]
fn chains_of_segments() {
    let poses = |present: &[u32]| present.iter().map(|segment| pose(*segment, 1000.0)).collect::<Vec<_>>();
    let seen = |present: &[u32]| {
        let mut scene = Scene::default();
        let add = |w: &mut PacketWriter| {
            w.add(id::SUBJECT_INFO, &subject(1, "a"));
            w.add(id::FRAME_INFO, &FrameInfo { frame_id: 0 });
            w.add(id::LOCAL_SEGMENTS, &Segments { subject: 1, poses: poses(present) });
        };
        scene.take(packet(add, &[])).unwrap();
        scene.frame(Kind::Local, &[]).unwrap().bodies
    };
    let all = seen(&[1, 2, 3]);
    // One step along x, then along y after the quarter turn, then back along x after the second.
    let expected = [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    for (body, expected) in all.iter().zip(expected) {
        let found: [f64; 3] = body.world_from_segment.unwrap().translation.into();
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }
    let broken = seen(&[1, 3]);
    let visible: Vec<bool> = broken.iter().map(|body| body.world_from_segment.is_some()).collect();
    assert_eq!(visible, [true, false, false], "no pose without the parent's");
}

#[test]
fn circles_and_matrices_that_are_no_rotation() {
    let mut circle = subject(1, "a");
    circle.segments[0].parent = 3;
    let zero = SegmentPose { segment: 1, ..SegmentPose::default() };
    let add = |w: &mut PacketWriter| {
        w.add(id::SUBJECT_INFO, &circle);
        w.add(id::FRAME_INFO, &FrameInfo { frame_id: 0 });
        w.add(id::LOCAL_SEGMENTS, &Segments { subject: 1, poses: (1..=3).map(|s| pose(s, 1.0)).collect() });
        w.add(id::GLOBAL_SEGMENTS, &Segments { subject: 1, poses: vec![zero.clone()] });
    };
    let mut scene = Scene::default();
    scene.take(packet(add, &[])).unwrap();
    assert!(scene.frame(Kind::Local, &[]).unwrap().bodies.iter().all(|body| body.world_from_segment.is_none()));
    let body = frame(&scene).bodies.remove(0);
    assert!(body.world_from_segment.is_none() && body.suspect, "all zeros is no pose");
}

#[test]
fn a_short_object_names_itself() {
    let mut writer = PacketWriter::default();
    writer.add_bytes(id::FRAME_INFO, &[1, 2]);
    let mut inbox = Inbox::default();
    inbox.push(&writer.finish());
    let mut scene = Scene::default();
    scene.take(inbox.next_packet().unwrap().unwrap()).unwrap();
    let error = scene.frame(Kind::Global, &[]).unwrap_err();
    assert_eq!(error.to_string(), "byte 16: object 5: 4 bytes wanted at offset 0, 2 are left");
    assert_eq!(u32::MIN_BYTES, 4);
}

#[test]
fn latencies_that_cannot_be_are_kept_but_not_believed() {
    for seconds in [f64::NAN, f64::INFINITY, -1.0, 1e9] {
        let add = |w: &mut PacketWriter| {
            w.add(id::FRAME_INFO, &FrameInfo { frame_id: 0 });
            w.add(id::LATENCY_INFO, &LatencyInfo { samples: vec![Latency { name: "l".to_owned(), seconds }] });
        };
        let mut scene = Scene::default();
        scene.take(packet(add, &[])).unwrap();
        let seen = frame(&scene);
        assert_eq!((seen.latency.len(), seen.latency_s()), (1, None));
    }
}
