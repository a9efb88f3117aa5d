//! Live recording with scripted sources: what comes in is in the log, and what is not is told.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod labels;
mod support;

use recorder::capture::{
    Allowed, End, EndedBy, Limits, RecordError, RecordOptions, Source, Stream, SystemClock, Verdict, record,
};
use recorder::picture::decode_rgb8;
use recorder::realsense::{Sample, StreamKind, TimestampDomain, metadata};
use schemas::msg::{ClockPair, CompressedImage, FrameMetadata, Image, Imu};
use schemas::{Message, metadata as records, topics};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use support::*;

fn counts(verdict: &Verdict, stream: Stream) -> recorder::capture::Counts {
    verdict.streams.iter().find(|s| s.stream == stream).unwrap().counts
}

#[test]
fn everything_that_came_is_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let verdict = run(&options(&path), |_, inlet| {
        inlet.camera(&setup());
        for number in 0..20 {
            for kind in [StreamKind::Color, StreamKind::Depth] {
                inlet.sample(sample(kind, number));
            }
            (0..6).for_each(|k| inlet.sample(sample(StreamKind::Gyro, number * 6 + k)));
        }
        End::Finished
    });
    assert!(verdict.complete, "{:?}", verdict.reasons);
    assert_eq!(verdict.ended_by, EndedBy::Source("camera".to_owned()));
    let log = Recording::read(&path);
    let stored = [topics::COLOR, topics::COLOR_METADATA, topics::COLOR_INFO].map(|topic| log.messages(topic));
    assert_eq!(stored.map(<[Stored]>::len), [20; 3]);
    let mut stamps = Vec::new();
    for number in 0..20_u64 {
        let [color, told, _] = stored.map(|messages| &messages[number as usize]);
        let Sample::Frame(fed) = sample(StreamKind::Color, number) else { panic!() };
        let picture = CompressedImage::decode(&color.data).unwrap();
        assert_eq!(decode_rgb8(&picture.data).unwrap().2, fed.bytes);
        let told = FrameMetadata::decode(&told.data).unwrap();
        let attributes: Vec<(u32, i64)> =
            told.attribute_ids.iter().map(|id| u32::from(*id)).zip(told.attribute_values.iter().copied()).collect();
        assert_eq!(attributes, fed.header.metadata);
        assert_eq!((told.counter, told.frame_number, told.timestamp_ms), (number, number, fed.header.timestamp_ms));
        assert_eq!(Some(told.device_time_us), fed.header.metadata(metadata::SENSOR_TIMESTAMP));
        assert_eq!(color.publish_time.0, told.arrival_realtime_ns);
        assert_eq!(schemas::Stamp::from(picture.header.stamp), color.log_time);
        stamps.push(color.log_time.0);
        let depth = &log.messages(topics::DEPTH_NATIVE)[number as usize];
        let Sample::Frame(fed) = sample(StreamKind::Depth, number) else { panic!() };
        assert_eq!(Image::decode(&depth.data).unwrap().data, fed.bytes);
        assert_eq!(depth.log_time, color.log_time, "one anchor for all streams of a camera");
    }
    // The device's own spacing, across the wrap of its counter.
    let fed_us = |number: i64| number * 1_000_000 / 30;
    assert!((0..20).all(|n| stamps[n] - stamps[0] == fed_us(n as i64) * 1000), "{stamps:?}");
    let gyro = log.messages(topics::GYRO);
    assert_eq!(gyro.len(), 120);
    for (number, stored) in gyro.iter().enumerate() {
        let velocity = Imu::decode(&stored.data).unwrap().angular_velocity;
        assert_eq!([velocity.x, velocity.y, velocity.z], [number as f64, -0.5, 0.25]);
        assert_eq!(stored.log_time.0 - stamps[0], number as i64 * 5_000_000);
    }
    for name in [records::RECORDING, records::DEVICE, records::DEPTH, records::PAIRING, records::VERDICT] {
        assert_eq!(records::verify(name, &log.metadata[name]), Some(true), "{name}");
    }
    assert_eq!(log.metadata[records::DEPTH][records::DEPTH_UNITS_PER_METRE], "1000");
    assert_eq!(log.metadata[records::VERDICT]["verdict"], "complete");
}

#[test]
fn losses_of_the_device_are_told_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let verdict = run(&options(&path), |_, inlet| {
        inlet.camera(&setup());
        for number in (0..30).filter(|number| ![7, 8, 20].contains(number)) {
            inlet.sample(sample(StreamKind::Color, number));
        }
        (0..10).for_each(|number| inlet.sample(sample(StreamKind::Depth, number)));
        for number in 0..10 {
            // Three samples are missing by the device's clock, though the library numbers on.
            let Sample::Motion(mut motion) = sample(StreamKind::Gyro, if number < 5 { number } else { number + 3 })
            else {
                panic!()
            };
            motion.header.number = number;
            inlet.sample(Sample::Motion(motion));
        }
        End::Finished
    });
    assert!(!verdict.complete);
    let text = |s: &str| s.to_owned();
    let expected = [
        (text("color"), text("device"), 7, 8, 2),
        (text("color"), text("device"), 20, 20, 1),
        (text("gyro"), text("device"), 5, 5, 3),
    ];
    assert_eq!(Recording::read(&path).drops(), expected);
    assert_eq!((counts(&verdict, Stream::Color).dropped_device, counts(&verdict, Stream::Color).written), (3, 27));
    assert_eq!((counts(&verdict, Stream::Depth).dropped_device, counts(&verdict, Stream::Gyro).dropped_device), (0, 3));
}

#[test]
fn a_full_queue_gives_up_the_oldest_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    // Room for two pictures, and nobody waits.
    let limits = Limits { video_bytes: 5000, patience: Duration::ZERO, ..Limits::default() };
    let verdict = run(&RecordOptions { limits, ..options(&path) }, |_, inlet| {
        inlet.camera(&setup());
        (0..10).for_each(|number| inlet.sample(sample(StreamKind::Depth, number)));
        (0..10).for_each(|number| inlet.sample(sample(StreamKind::Gyro, number)));
        (0..400).for_each(|number| inlet.sample(sample(StreamKind::Color, number)));
        End::Finished
    });
    let log = Recording::read(&path);
    let told = counts(&verdict, Stream::Color);
    assert_eq!(told.received, 400);
    assert!(told.dropped_host > 0 && !verdict.complete, "400 pictures at once went through a queue of two");
    assert_eq!(told.written + told.dropped_host, 400);
    let written = log.messages(topics::COLOR_METADATA).iter();
    let mut numbers: Vec<u64> = written.map(|m| FrameMetadata::decode(&m.data).unwrap().counter).collect();
    assert_eq!(numbers.len() as u64, told.written);
    assert_eq!(numbers.last(), Some(&399), "the newest stays");
    let drops = log.drops().into_iter().filter(|drop| drop.0 == "color");
    numbers.extend(drops.map(|(_, cause, first, last, count)| {
        assert_eq!((cause.as_str(), count, first), ("queue", 1, last));
        first
    }));
    numbers.sort_unstable();
    assert_eq!(numbers, (0..400).collect::<Vec<u64>>(), "each picture is in the log or in the ledger, once");
}

#[test]
fn a_camera_that_comes_back_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let verdict = run(&options(&path), |run, inlet| {
        inlet.camera(&setup());
        for number in 0..5 {
            for kind in [StreamKind::Color, StreamKind::Depth, StreamKind::Gyro] {
                inlet.sample(sample(kind, number));
            }
        }
        if run == 0 { End::Lost("unplugged".to_owned()) } else { End::Finished }
    });
    assert!(!verdict.complete);
    assert!(verdict.reasons.iter().any(|reason| reason.starts_with("camera was away for ")), "{:?}", verdict.reasons);
    let log = Recording::read(&path);
    let names: Vec<String> = log.events().into_iter().map(|event| event.name).collect();
    assert_eq!(names, ["recording.started", "camera.lost", "camera.back"]);
    assert_eq!(log.drops(), [], "a new connection counts anew");
    let stamps: Vec<i64> = log.messages(topics::COLOR).iter().map(|m| m.log_time.0).collect();
    assert_eq!(stamps.len(), 10);
    assert!(stamps[5] - stamps[4] > 100_000_000, "the time away is on the timeline: {stamps:?}");
    let device = &log.metadata[records::DEVICE];
    assert!(device.contains_key("anchor_ns/0") && device.contains_key("anchor_ns/1"));
}

#[test]
fn a_clock_step_moves_no_stamp() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let clock = Arc::new(SetClock::default());
    let set = Arc::clone(&clock);
    let script = move |_: usize, inlet: &recorder::capture::Inlet| {
        inlet.camera(&setup());
        for number in 0..3 {
            for kind in [StreamKind::Color, StreamKind::Depth, StreamKind::Gyro] {
                inlet.sample(sample(kind, number));
            }
        }
        set.ahead_ns.store(3_600_000_000_000, Ordering::Relaxed);
        // Until the watch has looked.
        while !inlet.is_stopping() {
            std::thread::sleep(Duration::from_millis(5));
        }
        End::Stopped
    };
    let sources: Vec<Box<dyn Source>> = vec![Box::new(Scripted { script: Box::new(script), runs: 0 })];
    let seen = std::cell::Cell::new(false);
    let verdict =
        record(sources, &options(&path), clock, &|| seen.get(), &mut |status| seen.set(status.clock.steps > 0))
            .unwrap();
    assert!(verdict.complete, "{:?}", verdict.reasons);
    assert_eq!(verdict.clock.steps, 1);
    let log = Recording::read(&path);
    assert!(log.events().iter().any(|event| event.name == "clock.step"));
    let pairs: Vec<ClockPair> =
        log.messages(topics::CLOCK).iter().map(|m| ClockPair::decode(&m.data).unwrap()).collect();
    let stepped = pairs.iter().find(|pair| pair.step_ns != 0).unwrap();
    assert!((stepped.step_ns - 3_600_000_000_000).abs() < 10_000_000, "{stepped:?}");
    let first = log.messages(topics::CLOCK)[0].log_time.0;
    assert!(log.messages(topics::CLOCK).iter().all(|m| m.log_time.0 - first < 600_000_000_000), "stamps stay");
}

#[test]
fn frames_without_metadata_are_refused_unless_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let script = |_: usize, inlet: &recorder::capture::Inlet| {
        inlet.camera(&setup());
        for kind in [StreamKind::Color, StreamKind::Depth] {
            let Sample::Frame(mut frame) = sample(kind, 0) else { panic!() };
            frame.header.domain = TimestampDomain::SystemTime;
            frame.header.metadata.clear();
            inlet.sample(Sample::Frame(frame));
        }
        inlet.sample(sample(StreamKind::Gyro, 0));
        End::Finished
    };
    let sources: Vec<Box<dyn Source>> = vec![Box::new(Scripted { script: Box::new(script), runs: 0 })];
    let refused = record(sources, &options(&path), Arc::new(SystemClock), &|| false, &mut |_| {});
    let Err(RecordError::Refused(reason)) = refused else { panic!("{refused:?}") };
    assert!(reason.contains("--allow-missing-metadata"), "{reason}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left");

    let allowed = Allowed { missing_metadata: true };
    let verdict = run(&RecordOptions { allowed, ..options(&path) }, script);
    assert!(verdict.complete, "{:?}", verdict.reasons);
    assert!(Recording::read(&path).events().iter().any(|event| event.name == "camera.metadata"));
}

#[test]
fn a_disk_without_room_is_told_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let options = RecordOptions { reserve_bytes: u64::MAX, ..options(&folder.path().join("a.mcap")) };
    let full = record(Vec::new(), &options, Arc::new(SystemClock), &|| true, &mut |_| {});
    assert!(matches!(full, Err(RecordError::NoRoom { .. })), "{full:?}");
    let nowhere = RecordOptions { path: folder.path().join("no/a.mcap"), ..options };
    assert!(record(Vec::new(), &nowhere, Arc::new(SystemClock), &|| true, &mut |_| {}).is_err());
}

/// A picture of one colour, which compresses well.
fn plain(number: u64) -> Sample {
    let mut sample = sample(StreamKind::Color, number);
    if let Sample::Frame(frame) = &mut sample {
        frame.bytes.fill(number as u8);
    }
    sample
}

/// Pictures come faster than they can be compressed for a while, then slowly.
#[test]
fn compression_is_left_out_while_it_cannot_keep_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let picture_bytes = 3 * (WIDTH * HEIGHT) as usize;
    // The queue takes eight pictures; the disk's is never full.
    let limits = Limits { video_bytes: 8 * picture_bytes, ..Limits::default() };
    const BURST: u64 = 400;
    // Compression is tried again after 150 pictures.
    const ALL: u64 = BURST + 200;
    let verdict = run(&RecordOptions { limits, ..options(&path) }, |_, inlet| {
        inlet.camera(&setup());
        // It waits where the queue is full, as a file does: nothing is lost.
        let inlet = inlet.patient();
        for number in 0..ALL {
            if number >= BURST {
                std::thread::sleep(Duration::from_millis(5));
            }
            inlet.sample(plain(number));
            inlet.sample(sample(StreamKind::Depth, number));
        }
        End::Finished
    });
    assert_eq!(counts(&verdict, Stream::Color).written, ALL, "{verdict}");
    let log = Recording::read(&path);
    let told: Vec<String> =
        log.events().into_iter().filter(|event| event.name == "color.encoding").map(|event| event.msg).collect();
    // How often depends on the machine; that it goes and comes back does not.
    assert!(told.len() >= 2, "{told:?}");
    let goes = |text: &String| text.contains("stored without compression from here on");
    assert!(told.iter().enumerate().all(|(i, text)| goes(text) == (i % 2 == 0)), "{told:?}");
    let pictures = log.messages(topics::COLOR);
    assert_eq!(pictures.len() as u64, ALL);
    let mut stored = Vec::new();
    for (number, message) in pictures.iter().enumerate() {
        let Sample::Frame(fed) = plain(number as u64) else { panic!() };
        let picture = CompressedImage::decode(&message.data).unwrap();
        assert_eq!(decode_rgb8(&picture.data).unwrap(), (WIDTH, HEIGHT, fed.bytes), "picture {number}");
        stored.push(picture.data.len() > picture_bytes);
    }
    let changes = stored.windows(2).filter(|pair| pair[0] != pair[1]).count() + usize::from(stored[0]);
    assert_eq!(changes, told.len(), "each change is told: {stored:?}");
}
