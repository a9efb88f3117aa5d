//! Our clients read our simulated systems, which the genuine clients read too (`tests/mocap/`).

use crate::support::{PATIENCE, assert_shows, client, distance, frames, script, start, two_subjects};
use recorder::mocap::sim::{Fault, Protocol, Script};
use recorder::mocap::vicon::{self, Segments, ViconMode, ViconOptions, ViconSource};
use recorder::mocap::vrpn::{VrpnOptions, VrpnSource};
use recorder::mocap::{MocapError, MocapSource, messages};
use schemas::Stamp;
use slam_math::Se3;

fn vicon_reads(script: &Script, options: impl Fn(&mut ViconOptions), tolerance: f64) {
    let server = start(Protocol::Vicon, script);
    let mut options_of_client = ViconOptions::new(&server.address().to_string());
    options(&mut options_of_client);
    let mut source = ViconSource::new(options_of_client);
    source.connect().unwrap();
    let seen = frames(&mut source, 60);
    for pair in seen.windows(2) {
        assert_eq!(pair[1].number.unwrap(), pair[0].number.unwrap() + 1, "no frame is lost");
        assert!(pair[1].arrival >= pair[0].arrival);
    }
    for frame in &seen {
        assert_shows(frame, script, frame.number.unwrap() as u32 - 1, tolerance);
    }
}

#[test]
fn every_way_to_ask_for_frames() {
    for mode in [ViconMode::ServerPush, ViconMode::Prefetch] {
        vicon_reads(&two_subjects(3, &[]), |options| options.mode = mode, 1e-9);
    }
}

#[test]
fn pulls_give_no_frame_twice() {
    let script = two_subjects(3, &[]);
    let server = start(Protocol::Vicon, &script);
    let address = server.address().to_string();
    let mut source = ViconSource::new(ViconOptions { mode: ViconMode::Pull, ..ViconOptions::new(&address) });
    source.connect().unwrap();
    let seen = frames(&mut source, 50);
    assert!(seen.windows(2).all(|pair| pair[1].number > pair[0].number));
    seen.iter().for_each(|frame| assert_shows(frame, &script, frame.number.unwrap() as u32 - 1, 1e-9));
}

#[test]
fn every_kind_of_segments_and_every_delivery() {
    let deliveries: [&[Fault]; 4] = [&[], &[Fault::StaticOnce], &[Fault::Split], &[Fault::Glue, Fault::YUp]];
    std::thread::scope(|scope| {
        for (kind, tolerance) in [(Segments::Global, 1e-9), (Segments::Local, 1e-9), (Segments::Lightweight, 1e-5)] {
            for faults in deliveries {
                let read = move || vicon_reads(&two_subjects(2, faults), |options| options.segments = kind, tolerance);
                scope.spawn(read);
            }
        }
    });
}

#[test]
fn everything_that_vicon_tells_is_kept() {
    let mut script = two_subjects(3, &[Fault::StaticOnce, Fault::YUp]);
    script.latency_s = 0.02;
    let server = start(Protocol::Vicon, &script);
    let options = ViconOptions { markers: true, ..ViconOptions::new(&server.address().to_string()) };
    let mut source = ViconSource::new(options);
    source.connect().unwrap();
    let frame = frames(&mut source, 30).pop().unwrap();
    let index = frame.number.unwrap() as u32 - 1;
    assert_eq!(frame.hardware_frame, Some(index + vicon::HARDWARE_FRAMES_BEFORE));
    assert_eq!(frame.rate_hz, Some(100.0));
    assert!((frame.latency_s().unwrap() - 0.02).abs() < 1e-12);
    assert_eq!(frame.latency.len(), 2);
    let timecode = frame.timecode.unwrap();
    assert_eq!((u32::from(timecode.seconds), u32::from(timecode.frames)), (index / 100, index % 100 / 4));
    assert!(frame.ping_round_trip_s.unwrap() < 1.0);
    let body = &frame.bodies[1];
    assert_eq!((body.quality, body.health), (Some(vicon::QUALITY), Some(vicon::HEALTH)));
    assert!((body.marker_error_m.unwrap() - vicon::MARKER_ERROR_MM * 1e-3).abs() < 1e-12);
    assert_eq!(frame.markers.len(), 2 * 4 + 1, "four markers a subject and a stray one");
    let (first, stray) = (&frame.markers[0], &frame.markers[8]);
    assert_eq!((first.subject.as_str(), first.name.as_str()), ("quad", "quad1"));
    let on_body = frame.bodies[0].world_from_segment.unwrap().inverse().transform(&first.position_m.into());
    assert!((on_body.norm() - (0.05_f64 * 0.05 + 0.02 * 0.02).sqrt()).abs() < 1e-9);
    assert_eq!((stray.subject.as_str(), stray.name.as_str()), ("", ""));
    assert!((stray.position_m[2] - 0.25).abs() < 1e-12, "carried over, and z is up: {stray:?}");
}

#[test]
fn only_the_subjects_that_were_asked_for() {
    let script = two_subjects(3, &[]);
    let server = start(Protocol::Vicon, &script);
    let subjects = vec!["person 2".to_owned()];
    let mut source = ViconSource::new(ViconOptions { subjects, ..ViconOptions::new(&server.address().to_string()) });
    source.connect().unwrap();
    for frame in frames(&mut source, 20) {
        assert_eq!(frame.bodies.len(), 1);
        let truth = script.frame(frame.number.unwrap() as u32 - 1).unwrap();
        let seen = frame.bodies[0].world_from_segment.unwrap();
        assert!(distance(&seen, &truth.bodies[1].world_from_marker.unwrap()) < 1e-9);
    }
}

#[test]
fn vrpn_over_tcp_and_by_call_back() {
    let script = two_subjects(3, &[]);
    let server = start(Protocol::Vrpn, &script);
    for prefix in ["tcp://", ""] {
        let mut source = VrpnSource::new(VrpnOptions::new(&format!("{prefix}{}", server.address())));
        source.connect().unwrap();
        let seen = frames(&mut source, 40);
        let first_ns = seen[0].source_stamp_ns.unwrap();
        let first = (0..1000).find(|index| {
            let pose = script.frame(*index).unwrap().bodies[0].world_from_marker.unwrap();
            seen[0].bodies[0].subject == "quad"
                && distance(&pose, &seen[0].bodies[0].world_from_segment.unwrap()) < 1e-9
        });
        let first = first.expect("the first frame is one of the script's");
        for frame in seen.iter().filter(|frame| frame.bodies.len() == 2) {
            // VRPN's stamps have microseconds.
            let since_ns = frame.source_stamp_ns.unwrap() - first_ns;
            let index = first + u32::try_from((since_ns + 5_000_000) / 10_000_000).unwrap();
            assert!((since_ns - i64::from(index - first) * 10_000_000).abs() < 2_000);
            assert_shows(frame, &script, index, 1e-9);
        }
        assert!(seen.iter().filter(|frame| frame.bodies.len() == 2).count() > 30);
    }
}

#[test]
fn datagrams_are_frames() {
    let script = two_subjects(3, &[]);
    let server = start(Protocol::Udp, &script);
    let mut source = client(Protocol::Udp, &server);
    source.connect().unwrap();
    for frame in frames(source.as_mut(), 50) {
        assert_shows(&frame, &script, frame.number.unwrap() as u32, 1e-9);
    }
}

#[test]
fn planted_offset_and_marker_are_in_the_poses() {
    let marker_from_camera = Se3::from_quaternion([0.02, -0.015, -0.06], [-0.5, 0.5, -0.5, 0.5]);
    let mut script = Script { clock_offset_ns: 37_300_000, marker_from_camera, ..script(3, &[]) };
    script.drift_ppm = 200.0;
    let server = start(Protocol::Vicon, &script);
    let mut source = client(Protocol::Vicon, &server);
    source.connect().unwrap();
    let path = &script.subjects[0].path;
    for frame in frames(source.as_mut(), 30) {
        let captured_ns = (frame.number.unwrap() - 1) as f64 * 10e6 / (1.0 + 200e-6);
        let shown_ns = captured_ns.round() as i64 - 37_300_000;
        let camera = path.at(path.start_ns().unwrap() + shown_ns);
        let seen = frame.bodies[0].world_from_segment.map(|pose| pose * marker_from_camera);
        match (camera, seen) {
            (Some(camera), Some(seen)) => assert!(distance(&camera, &seen) < 1e-9),
            (camera, seen) => assert_eq!(camera.is_some(), seen.is_some(), "before the start nothing is seen"),
        }
    }
}

#[test]
fn occluded_is_never_a_zero_pose_in_a_log() {
    let script = script(3, &[Fault::Occlude]);
    let server = start(Protocol::Vicon, &script);
    let mut source = client(Protocol::Vicon, &server);
    source.connect().unwrap();
    let seen = frames(source.as_mut(), 130);
    let hidden: Vec<_> = seen.iter().filter(|frame| frame.bodies[0].world_from_segment.is_none()).collect();
    assert_eq!(hidden.len(), 25, "a quarter of a second");
    let written = messages(hidden[0], &source.describe(), Stamp(5)).unwrap();
    assert!(written.frame.bodies[0].occluded && written.frame.bodies[0].pose.position.x.is_nan());
    assert!(written.poses.is_empty() && written.tf.is_none());
    let written = messages(&seen[0], &source.describe(), Stamp(5)).unwrap();
    assert_eq!(written.poses[0].0, "/vicon/quad/quad");
    assert_eq!(written.tf.unwrap().transforms[0].child_frame_id, "vicon/quad/quad");
    assert_eq!(written.frame.frame_number, seen[0].number.unwrap() as i64);
    assert_eq!(written.frame.arrival_monotonic_ns, seen[0].arrival.monotonic_ns);
}

#[test]
fn the_wrong_port_is_named() {
    let vrpn = start(Protocol::Vrpn, &script(3, &[]));
    let mut source = ViconSource::new(ViconOptions::new(&vrpn.address().to_string()));
    let error = source.connect().unwrap_err();
    assert!(error.to_string().contains("VRPN port, DataStream is 801"), "{error}");
    assert!(matches!(source.next_frame(PATIENCE), Err(MocapError::NotConnected { .. })));

    let vicon = start(Protocol::Vicon, &script(3, &[]));
    let mut source = VrpnSource::new(VrpnOptions::new(&format!("tcp://{}", vicon.address())));
    let error = source.connect().unwrap_err();
    assert!(error.to_string().contains("DataStream port, VRPN is 3883"), "{error}");
}
