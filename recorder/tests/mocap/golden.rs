//! Bytes made by hand from the tables of the protocols' descriptions.

use recorder::mocap::udp::datagram::{Datagram, Object};
use recorder::mocap::vicon::object::*;
use recorder::mocap::vicon::packet::{Inbox, packet_of};
use recorder::mocap::vrpn::message::{self, Message, PosQuat};
use recorder::mocap::wire::Wire;
use std::fmt::Debug;

/// Hexadecimal digits, white space and `f64(x)`, `f32(x)`, `text(x)` parted by `|`.
fn bytes(recipe: &str) -> Vec<u8> {
    let mut out = Vec::new();
    for part in recipe.split('|').map(str::trim) {
        let inner = |head: &str| part.strip_prefix(head).and_then(|rest| rest.strip_suffix(')'));
        if let Some(number) = inner("f64(") {
            out.extend(number.parse::<f64>().unwrap().to_le_bytes());
        } else if let Some(number) = inner("f32(") {
            out.extend(number.parse::<f32>().unwrap().to_le_bytes());
        } else if let Some(text) = inner("text(") {
            out.extend((text.len() as u32).to_le_bytes());
            out.extend(text.as_bytes());
        } else {
            let digits: String = part.split_whitespace().collect();
            out.extend((0..digits.len() / 2).map(|i| u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).unwrap()));
        }
    }
    out
}

/// The object has exactly this body, both ways, and sits in a packet with this head.
fn golden<T: Wire + PartialEq + Debug>(id: u32, object: T, recipe: &str) {
    let body = bytes(recipe);
    let mut whole = bytes("01002b1a");
    whole.extend((body.len() as u32 + 8).to_le_bytes());
    whole.extend(id.to_le_bytes());
    whole.extend((body.len() as u32).to_le_bytes());
    whole.extend(&body);
    assert_eq!(packet_of(id, &object), whole, "{object:?}");
    // A newer server may add fields: those are passed over.
    whole.extend([1, 2, 3]);
    let longer = |at: usize, bytes: &mut [u8]| {
        let length = u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) + 3;
        bytes[at..at + 4].copy_from_slice(&length.to_le_bytes());
    };
    longer(4, &mut whole);
    longer(12, &mut whole);
    let mut inbox = Inbox::default();
    inbox.push(&whole);
    let packet = inbox.next_packet().unwrap().unwrap();
    assert_eq!(packet.find::<T>(id).unwrap(), Some(object));
    // A body that is too short is an error, however short.
    for cut in 0..body.len() {
        let block = recorder::mocap::vicon::packet::Block { id, offset: 0, body: body[..cut].to_vec() };
        assert!(block.decode::<T>().is_err(), "{id}: {cut} bytes");
    }
}

#[test]
fn the_two_packets_that_the_genuine_programs_exchanged() {
    let offer = packet_of(id::OBJECT_ENUMS, &ObjectEnums { ids: [1, 2, 100_004].into() });
    assert_eq!(offer, bytes("01002b1a 18000000 a1860100 10000000 03000000 01000000 02000000 a4860100"));
    let on = packet_of(id::REQUEST_FRAME, &RequestFrame { streaming: true });
    assert_eq!(on, bytes("01002b1a 09000000 a2860100 01000000 01"));
}

#[test]
fn requests_and_contents() {
    golden(100_008, RequestNextFrame { count: 1 }, "01000000");
    golden(42, Ping { id: 0x0102_0304_0506_0708 }, "0807060504030201");
    golden(
        100_007,
        Filter { by_object: [(9, [2, 3].into()), (40, [7].into())].into() },
        "02000000 09000000 02000000 02000000 03000000 28000000 01000000 07000000",
    );
    golden(
        100_004,
        Contents { counts: [(5, 1), (9, 2)].into(), unchanged: [2].into() },
        "02000000 05000000 01000000 09000000 02000000 01000000 02000000",
    );
}

#[test]
fn stream_and_frame() {
    golden(1, StreamInfo { frame_period_ticks: 1_350_000 }, "7099140000000000");
    golden(5, FrameInfo { frame_id: 41 }, "29000000");
    golden(36, HardwareFrameInfo { frame_id: 258 }, "02010000");
    golden(39, FrameRateInfo { rates_hz: [("System".to_owned(), 100.0)].into() }, "01000000 | text(System) | f64(100)");
    let samples = vec![Latency { name: "a".to_owned(), seconds: 0.25 }, Latency { name: String::new(), seconds: 1.5 }];
    golden(26, LatencyInfo { samples }, "02000000 | text(a) | f64(0.25) | text() | f64(1.5)");
    let timecode = Timecode {
        hmsf: [1, 2, 3, 4],
        subframes: 5,
        subframes_per_frame: 6,
        standard: u32::MAX,
        user_bits: 7,
        field_flag: 1,
    };
    golden(23, timecode, "01020304 0500 0600 ffffffff 07000000 01");
    golden(37, ApplicationInfo { axis_orientation: 1 }, "01");
}

#[test]
fn subjects() {
    let segment = SegmentInfo { parent: 0, segment: 1, bounds: [0.5; 6], name: "root".to_owned() };
    let subject = SubjectInfo {
        subject: 3,
        name: "quad".to_owned(),
        segments: vec![segment],
        markers: vec![MarkerInfo { marker: 9, name: "m".to_owned() }],
        attachments: vec![Attachment { marker: 9, segment: 1 }],
    };
    golden(
        2,
        subject,
        "03000000 | text(quad) | 01000000 00000000 01000000 | f32(0.5) | f32(0.5) | f32(0.5) | f32(0.5) | f32(0.5) \
         | f32(0.5) | text(root) | 01000000 09000000 | text(m) | 01000000 09000000 01000000",
    );
    golden(29, SubjectHealth { subject: 3, marker_error_mm: 0.5, health: 0.75 }, "03000000 | f64(0.5) | f64(0.75)");
    golden(40, ObjectQuality { subject: 3, quality: 0.95 }, "03000000 | f64(0.95)");
    let scales = vec![SegmentScale { segment: 1, scale: [1.0, 2.0, 3.0] }];
    golden(28001, SubjectScale { subject: 3, scales }, "03000000 01000000 01000000 | f64(1) | f64(2) | f64(3)");
}

#[test]
fn segments() {
    let pose = SegmentPose {
        segment: 1,
        translation_mm: [1000.0, -2.5, 0.0],
        rotation: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
    };
    let recipe = "03000000 01000000 01000000 | f64(1000) | f64(-2.5) | f64(0) | f64(1) | f64(2) | f64(3) | f64(4) \
                  | f64(5) | f64(6) | f64(7) | f64(8) | f64(9)";
    for id in [8, 9, 28] {
        golden(id, Segments { subject: 3, poses: vec![pose.clone()] }, recipe);
    }
    golden(9, Segments { subject: 3, poses: vec![] }, "03000000 00000000");
    let pose = LightweightPose { segment: 1, translation_mm: [1.0, 2.0, 3.0], rotation_vector: [0.25, 0.5, -1.0] };
    golden(
        901,
        LightweightSegments { subject: 3, poses: vec![pose] },
        "03000000 01000000 01000000 | f32(1) | f32(2) | f32(3) | f32(0.25) | f32(0.5) | f32(-1)",
    );
}

#[test]
fn markers() {
    let recon = UnlabeledRecon { radius_mm: 7.0, position_mm: [1.0, 2.0, 3.0], covariance: [0.5; 9], trajectory: 17 };
    let numbers = "f64(7) | f64(1) | f64(2) | f64(3) | f64(0.5) | f64(0.5) | f64(0.5) | f64(0.5) | f64(0.5) | f64(0.5) \
                   | f64(0.5) | f64(0.5) | f64(0.5) | 11000000";
    golden(7, UnlabeledRecons { recons: vec![recon.clone()] }, &format!("01000000 | {numbers}"));
    let labeled = LabeledRecon { subject: 3, marker: 9, recon };
    golden(6, LabeledRecons { recons: vec![labeled] }, &format!("01000000 03000000 09000000 | {numbers}"));
}

#[test]
fn tracker_datagram() {
    let object =
        |name: &str| Object { name: name.to_owned(), position_mm: [1000.0, -2.5, 0.5], euler_xyz: [0.25, -0.5, 3.0] };
    let datagram = Datagram { frame_number: 513, objects: vec![object("quad"), object("a name of twenty-four...")] };
    let numbers = "f64(1000) | f64(-2.5) | f64(0.5) | f64(0.25) | f64(-0.5) | f64(3)";
    let mut golden = bytes(&format!(
        "01020000 02 | 00 4800 71756164 0000000000000000000000000000000000000000 | {numbers} \
         | 00 4800 61206e616d65206f66207477656e74792d666f75722e2e2e | {numbers}"
    ));
    assert_eq!(golden.len(), 155, "two objects have 155 bytes");
    golden.resize(256, 0);
    assert_eq!(datagram.encode(), golden);
    assert_eq!(Datagram::parse(&golden), Ok(datagram));
    // An item of another kind and size is passed over.
    let other = bytes(&format!(
        "01020000 02 | 07 0300 aabbcc | 00 4800 71756164 0000000000000000000000000000000000000000 | {numbers}"
    ));
    assert_eq!(Datagram::parse(&other).unwrap().objects, [object("quad")]);
    assert_eq!(Datagram { objects: vec![object("n"); 13], frame_number: 1 }.encode().len(), 1024);
}

#[test]
fn vrpn_messages() {
    assert_eq!(message::COOKIE.len(), 24);
    assert!(message::COOKIE.starts_with(b"vrpn: ver. 07.38  0\0"));
    let description = Message::description(message::SENDER_DESCRIPTION, 2, "quad");
    let golden = bytes("00000021 00000000 00000000 00000002 ffffffff 00000000 | 00000005 7175616400 | 00000000000000");
    assert_eq!(description.encode(), golden, "33 bytes, padded to 40");
    let pose = PosQuat { sensor: 1, position_m: [1.0, 2.0, 3.0], xyzw: [0.0, 0.0, 0.0, 1.0] };
    let message = Message { stamp_ns: 5_000_007_000, sender: 2, kind: 3, sequence: 4, payload: pose.encode() };
    let golden = bytes(
        "00000058 00000005 00000007 00000002 00000003 00000004 00000001 00000000 3ff0000000000000 4000000000000000 \
         4008000000000000 0000000000000000 0000000000000000 0000000000000000 3ff0000000000000",
    );
    assert_eq!(message.encode(), golden);
    assert_eq!(PosQuat::parse(&message.payload), Ok(pose));
    assert!(PosQuat::parse(&message.payload[..63]).unwrap_err().contains("63 bytes, 64 wanted"));
}
