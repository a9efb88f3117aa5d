//! The CDR codec against golden bytes, the other endianness, odd alignments and hostile input.

use proptest::prelude::*;
use schemas::cdr::{Cdr, CdrError, Reader, Writer};
use schemas::msg::*;
use schemas::{Message, Stamp};
use std::borrow::Cow;

fn header(frame: &str) -> Header {
    Header { stamp: Time { sec: 7, nanosec: 9 }, frame_id: frame.to_owned() }
}

#[test]
fn compressed_image_golden_bytes() {
    let message = CompressedImage { header: header("ab"), format: "png".to_owned(), data: Cow::Borrowed(&[1, 2, 3]) };
    let golden: Vec<u8> = [
        vec![0, 1, 0, 0],                                 // plain CDR, little endian
        vec![7, 0, 0, 0, 9, 0, 0, 0],                     // stamp
        vec![3, 0, 0, 0, b'a', b'b', 0, 0 /* padding */], // frame_id
        vec![4, 0, 0, 0, b'p', b'n', b'g', 0],            // format
        vec![3, 0, 0, 0, 1, 2, 3],                        // data
    ]
    .concat();
    assert_eq!(message.encode(), golden);
    let back = CompressedImage::decode(&golden).unwrap();
    assert!(matches!(back.data, Cow::Borrowed(_)), "pixels must not be copied");
    assert_eq!(back, message);
}

#[test]
fn big_endian_pose_with_alignment_gap() {
    // Frame "abc" ends at body offset 16: no gap. Frame "abcd" ends at 17: the first double moves to 24.
    for (frame, gap) in [("abc", 0), ("abcd", 7)] {
        let mut bytes = vec![0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0, frame.len() as u8 + 1];
        bytes.extend_from_slice(frame.as_bytes());
        bytes.push(0);
        bytes.extend(std::iter::repeat_n(0xEE, gap));
        for value in [1.0_f64, -2.0, 3.0, 0.0, 0.0, 0.0, 1.0] {
            bytes.extend_from_slice(&value.to_be_bytes());
        }
        let pose = PoseStamped::decode(&bytes).unwrap();
        assert_eq!(pose.header, header(frame));
        assert_eq!(pose.pose.position, Point { x: 1.0, y: -2.0, z: 3.0 });
        assert_eq!(pose.pose.orientation, Quaternion::default());
        assert_eq!(pose.encode().len(), bytes.len());
    }
}

#[test]
fn segment_table_alignment_inside_sequences() {
    let segment =
        Segment { id: 513, category_id: 2, score: 0.5, x: 1, y: 2, width: 3, height: 4, area: 5, is_crowd: true };
    let table = SegmentTable { header: header(""), layer: "l".to_owned(), segments: vec![segment, segment] };
    let bytes = table.encode();
    // An element does not start at any alignment of its own: after the first segment's bool, the second one's first u16
    // is padded by one byte only.
    let mut by_hand = Writer::with_capacity(0);
    table.header.write(&mut by_hand);
    table.layer.write(&mut by_hand);
    by_hand.count(2);
    for _ in 0..2 {
        (513_u16).write(&mut by_hand);
        (2_u16).write(&mut by_hand);
        (0.5_f32).write(&mut by_hand);
        [1_u32, 2, 3, 4, 5].write(&mut by_hand);
        true.write(&mut by_hand);
    }
    assert_eq!(by_hand.into_bytes(), bytes);
    assert_eq!(SegmentTable::decode(&bytes).unwrap(), table);
}

#[test]
fn writers_that_omit_or_pad() {
    // An empty frame_id as length 0 (no closing zero), options bits set, and padding bytes at the end.
    let bytes = [0, 1, 0, 3, 1, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0xAA, 0xAA];
    let read = Header::decode(&bytes).unwrap();
    assert_eq!(read, Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: String::new() });
}

#[test]
fn hostile_lengths_are_errors_and_allocate_nothing() {
    let start = [0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let huge = [&start[..], &[1, 0, 0, 0, 0, 0, 0, 0], &[1, 0, 0, 0, 0, 0, 0, 0], &[0xFF; 4]].concat();
    assert!(matches!(CompressedImage::decode(&huge), Err(CdrError::Length { count: 0xFFFF_FFFF, .. })));
    let huge_count = [0, 1, 0, 0, 0xFF, 0xFF, 0xFF, 0x7F];
    assert!(matches!(TFMessage::decode(&huge_count), Err(CdrError::Length { .. })));
    let long_text = [&start[..], &[0xF0, 0xFF, 0xFF, 0xFF, b'a']].concat();
    assert!(matches!(Header::decode(&long_text), Err(CdrError::Length { .. })));
    let unterminated = [&start[..], &[2, 0, 0, 0, b'a', b'b']].concat();
    assert_eq!(Header::decode(&unterminated), Err(CdrError::Text(16)));
    let not_utf8 = [&start[..], &[2, 0, 0, 0, 0xFF, 0]].concat();
    assert_eq!(Header::decode(&not_utf8), Err(CdrError::Text(16)));
    for kind in [2_u8, 3, 6, 7, 255] {
        assert_eq!(Time::decode(&[0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]), Err(CdrError::Representation(kind.into())));
    }
    assert!(matches!(Reader::new(&[0, 1]), Err(CdrError::Truncated { .. })));
}

#[test]
fn image_sizes_that_contradict_are_errors() {
    let pixels = [1_u16, 2, 3, 4, 5, 6];
    let image = Image::from_u16(header("c"), encoding::DEPTH, 3, &pixels);
    assert_eq!((image.width, image.height, image.step), (3, 2, 6));
    assert_eq!(image.pixels_u16().unwrap(), pixels);
    for bad in [
        Image { height: 3, ..image.clone() },
        Image { width: 4, ..image.clone() },
        Image { step: 5, ..image.clone() },
        Image { width: u32::MAX, height: u32::MAX, step: u32::MAX, ..image.clone() },
        Image { encoding: "rgb8".to_owned(), ..image.clone() },
    ] {
        assert!(bad.pixels_u16().is_err(), "{bad:?}");
    }
    // Padded rows, big-endian pixels.
    let padded = Image {
        step: 4,
        width: 1,
        height: 2,
        is_bigendian: 1,
        data: Cow::Borrowed(&[1, 2, 9, 9, 3, 4, 9, 9]),
        ..image
    };
    assert_eq!(padded.pixels_u16().unwrap(), [0x0102, 0x0304]);
    let empty = Image::from_u8(header("c"), encoding::MONO8, 0, &[]);
    assert!(empty.pixels_u16().unwrap().is_empty());
}

fn text() -> impl Strategy<Value = String> {
    "[a-zA-Zäß_/]{0,12}"
}

prop_compose! {
    fn any_header()(nanos in 0_i64..(i64::from(i32::MAX) * 1_000_000_000), frame_id in text()) -> Header {
        Header::new(Stamp(nanos), &frame_id).expect("the range is that of a ROS time")
    }
}

prop_compose! {
    fn any_tf()(edges in prop::collection::vec((any_header(), text(), any::<[i32; 7]>()), 0..4)) -> TFMessage {
        let transforms = edges.into_iter().map(|(header, child_frame_id, v)| {
            let [x, y, z, qx, qy, qz, qw] = v.map(f64::from);
            let transform = Transform { translation: Vector3 { x, y, z }, rotation: Quaternion { x: qx, y: qy, z: qz, w: qw } };
            TransformStamped { header, child_frame_id, transform }
        });
        TFMessage { transforms: transforms.collect() }
    }
}

proptest! {
    #[test]
    fn time_round_trip(nanos in 0_i64..(i64::from(i32::MAX) * 1_000_000_000)) {
        prop_assert_eq!(Stamp::from(Time::try_from(Stamp(nanos)).unwrap()), Stamp(nanos));
    }

    #[test]
    fn time_refuses_what_ros_cannot_say(nanos in i64::MIN..0) {
        prop_assert!(Time::try_from(Stamp(nanos)).is_err());
    }

    #[test]
    fn image_round_trip(header in any_header(), data in prop::collection::vec(any::<u8>(), 0..300), encoding in text()) {
        let image = Image { header, height: 3, width: 4, encoding, is_bigendian: 1, step: 5, data: Cow::Owned(data) };
        let bytes = image.encode();
        prop_assert_eq!(Image::decode(&bytes).unwrap(), image);
    }

    #[test]
    fn camera_info_round_trip(header in any_header(), d in prop::collection::vec(-1e6_f64..1e6, 0..9), model in text(), v: u32) {
        let info = CameraInfo { header, height: v, distortion_model: model, d, k: [0.5; 9], p: [1.5; 12], ..CameraInfo::default() };
        let bytes = info.encode();
        prop_assert_eq!(CameraInfo::decode(&bytes).unwrap(), info);
    }

    #[test]
    fn tf_round_trip(tf in any_tf()) {
        prop_assert_eq!(TFMessage::decode(&tf.encode()).unwrap(), tf);
    }

    #[test]
    fn labels_round_trip(header in any_header(), names in prop::collection::vec((any::<u16>(), text(), any::<bool>()), 0..20)) {
        let categories = names.into_iter().map(|(id, name, is_thing)| Category { id, name, is_thing }).collect();
        let table = CategoryTable { header, layer: "panoptic".to_owned(), categories };
        prop_assert_eq!(CategoryTable::decode(&table.encode()).unwrap(), table.clone());
        let info = schemas::panoptic::label_info(&table);
        prop_assert_eq!(info.class_map.len(), table.categories.len());
        prop_assert_eq!(LabelInfo::decode(&info.encode()).unwrap(), info);
    }

    #[test]
    fn imu_round_trip(header in any_header(), x: i32) {
        let imu = Imu { header, angular_velocity: Vector3 { x: x.into(), ..Vector3::default() }, ..Imu::default() };
        prop_assert_eq!(Imu::decode(&imu.encode()).unwrap(), imu);
    }

    #[test]
    fn mocap_round_trip(header in any_header(), subject in text(), number: i64, seconds: f64, none: bool) {
        prop_assume!(!seconds.is_nan());
        let body = MocapBody { subject: subject.clone(), occluded: none, quality: seconds, ..MocapBody::default() };
        let marker = MocapMarker { name: subject.clone(), trajectory_id: 7, ..MocapMarker::default() };
        let timecode = MocapTimecode { hours: 23, user_bits: 5, field_flag: 1, ..MocapTimecode::default() };
        let frame = MocapFrame {
            header,
            frame_number: number,
            latency: vec![MocapLatency { name: subject, seconds }],
            timecode: if none { vec![] } else { vec![timecode] },
            bodies: vec![body.clone(), body],
            markers: vec![marker],
            ..MocapFrame::default()
        };
        prop_assert_eq!(MocapFrame::decode(&frame.encode()).unwrap(), frame);
    }

    #[test]
    fn any_bytes_give_a_value_or_an_error(mut bytes in prop::collection::vec(any::<u8>(), 0..200), plain: bool) {
        if plain && bytes.len() >= 4 {
            bytes[0] = 0;
            bytes[1] &= 1;
        }
        let _ = Image::decode(&bytes);
        let _ = TFMessage::decode(&bytes);
        let _ = CameraInfo::decode(&bytes);
        let _ = SegmentTable::decode(&bytes);
        let _ = CategoryTable::decode(&bytes);
        let _ = LabelInfo::decode(&bytes);
        let _ = Imu::decode(&bytes);
        let _ = PoseStamped::decode(&bytes);
        let _ = MocapFrame::decode(&bytes);
    }

    #[test]
    fn every_cut_is_an_error(header in any_header(), cut in 0_usize..1000) {
        let bytes = CameraInfo { header, d: vec![1.0; 5], ..CameraInfo::default() }.encode();
        let cut = cut % bytes.len();
        prop_assert!(CameraInfo::decode(&bytes[..cut]).is_err());
    }
}

#[test]
fn recording_messages_round_trip() {
    let metadata = FrameMetadata {
        header: header("camera_depth_optical_frame"),
        counter: u64::MAX,
        frame_number: 3,
        timestamp_ms: 1.5,
        domain: domain::GLOBAL_TIME,
        device_clock: device_clock::SENSOR_TIMESTAMP,
        device_time_us: 4_294_967_295,
        device_time_ns: NOT_TOLD,
        arrival_monotonic_ns: 5,
        arrival_realtime_ns: i64::MAX,
        payload_bytes: 614_400,
        attribute_ids: vec![0, 2, 44],
        attribute_values: vec![7, i64::MIN, -1],
    };
    assert_eq!(FrameMetadata::decode(&metadata.encode()).unwrap(), metadata);
    let drops = DropRecord { stream: "color".to_owned(), cause: "queue".to_owned(), count: 2, ..DropRecord::default() };
    assert_eq!(DropRecord::decode(&drops.encode()).unwrap(), drops);
    let label = LabelRecord {
        layer: "network".to_owned(),
        outcome: "late".to_owned(),
        duration_ns: NOT_TOLD,
        ..LabelRecord::default()
    };
    assert_eq!(LabelRecord::decode(&label.encode()).unwrap(), label);
    let entry = LogEntry { level: level::ERROR, name: "camera.lost".to_owned(), ..LogEntry::default() };
    assert_eq!(LogEntry::decode(&entry.encode()).unwrap(), entry);
    let pair = ClockPair { monotonic_ns: 1, step_ns: -1_000_000_000, ..ClockPair::default() };
    assert_eq!(ClockPair::decode(&pair.encode()).unwrap(), pair);
}
