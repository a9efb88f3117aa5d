//! Bytes of all kinds: they give messages or errors, never a panic, never memory.

use proptest::prelude::*;
use recorder::mocap::udp::datagram::Datagram;
use recorder::mocap::vicon::object::*;
use recorder::mocap::vicon::packet::{Inbox, MAX_PACKET_BYTES, Packet, PacketWriter, packet_of};
use recorder::mocap::vicon::{Scene, Segments as Kind};
use recorder::mocap::vrpn::message::{self, COOKIE, Message};
use recorder::mocap::{MocapSource as _, vicon, vrpn};
use std::io::Write as _;
use std::net::TcpListener;
use std::time::Duration;

/// A stream of packets as a server sends them, some with objects that nobody knows.
fn stream(frames: &[(u32, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (number, extra) in frames {
        let mut writer = PacketWriter::default();
        writer.add(id::FRAME_INFO, &FrameInfo { frame_id: *number });
        writer.add_bytes(77_777 + number % 3, extra);
        writer.add(id::OBJECT_QUALITY, &ObjectQuality { subject: *number, quality: 0.5 });
        bytes.extend(writer.finish());
    }
    bytes
}

fn packets(inbox: &mut Inbox) -> Vec<Packet> {
    std::iter::from_fn(|| inbox.next_packet().unwrap()).collect()
}

fn frames() -> impl Strategy<Value = Vec<(u32, Vec<u8>)>> {
    prop::collection::vec((any::<u32>(), prop::collection::vec(any::<u8>(), 0..40)), 1..6)
}

/// Any bytes, most of them with the head of a packet, so that they come further.
fn hostile() -> impl Strategy<Value = Vec<u8>> {
    let words = prop_oneof![
        Just(0x1A2B_0001_u32),
        0..60_u32,
        Just(u32::MAX),
        Just(100_001),
        Just(100_004),
        Just(901),
        Just(28_001),
        any::<u32>()
    ];
    (any::<bool>(), prop::collection::vec(words, 0..80), prop::collection::vec(any::<u8>(), 0..5)).prop_map(
        |(tagged, words, rest)| {
            let body: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).chain(rest).collect();
            let mut bytes = Vec::new();
            if tagged {
                bytes.extend(0x1A2B_0001_u32.to_le_bytes());
                bytes.extend((body.len() as u32).to_le_bytes());
            }
            bytes.extend(body);
            bytes
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn however_the_stream_is_cut(frames in frames(), cuts in prop::collection::vec(1_usize..50, 1..40)) {
        let bytes = stream(&frames);
        let mut whole = Inbox::default();
        whole.push(&bytes);
        let expected = packets(&mut whole);
        prop_assert_eq!(expected.len(), frames.len());
        let (mut cut, mut found, mut at) = (Inbox::default(), Vec::new(), 0);
        for size in cuts.iter().cycle() {
            let end = bytes.len().min(at + size);
            cut.push(&bytes[at..end]);
            found.extend(packets(&mut cut));
            at = end;
            if at == bytes.len() {
                break;
            }
        }
        prop_assert_eq!(&found, &expected);
        prop_assert!(cut.rest().is_empty());
        for (packet, (number, _)) in found.iter().zip(&frames) {
            prop_assert_eq!(packet.blocks.len(), 3);
            let info = packet.find::<FrameInfo>(id::FRAME_INFO).unwrap();
            prop_assert_eq!(info, Some(FrameInfo { frame_id: *number }));
        }
    }

    #[test]
    fn a_cut_stream_waits(frames in frames(), cut in any::<prop::sample::Index>()) {
        let bytes = stream(&frames);
        let mut inbox = Inbox::default();
        inbox.push(&bytes[..cut.index(bytes.len())]);
        prop_assert!(packets(&mut inbox).len() < frames.len());
        prop_assert_eq!(inbox.next_packet(), Ok(None));
    }

    #[test]
    fn any_bytes_give_packets_or_errors(pieces in prop::collection::vec(hostile(), 1..4)) {
        let (mut inbox, mut scene) = (Inbox::default(), Scene::default());
        for piece in pieces {
            inbox.push(&piece);
            while let Ok(Some(packet)) = inbox.next_packet() {
                let _ = scene.take(packet);
                for kind in [Kind::Global, Kind::Local, Kind::Lightweight] {
                    let _ = scene.frame(kind, &[]);
                }
            }
        }
    }

    #[test]
    fn any_datagram_gives_a_frame_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = Datagram::parse(&bytes);
    }

    #[test]
    fn any_bytes_give_vrpn_messages_or_errors(words in prop::collection::vec(prop_oneof![0..100_u32, any::<u32>()], 0..80)) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        let _ = message::read_all(&bytes);
    }

    #[test]
    fn vrpn_messages_round_trip(payload in prop::collection::vec(any::<u8>(), 0..90), sender: i32, kind: i32, us in 0..i64::from(u32::MAX)) {
        let message = Message { stamp_ns: us * 1000, sender, kind, sequence: 9, payload };
        prop_assert_eq!(message::read_all(&message.encode()), (vec![message], None));
    }
}

#[test]
fn a_claimed_length_allocates_nothing() {
    let mut inbox = Inbox::default();
    inbox.push(&[0x01, 0, 0x2b, 0x1a, 0xff, 0xff, 0xff, 0xff]);
    let error = inbox.next_packet().unwrap_err().to_string();
    assert!(error.contains("4294967295 bytes, more than 8388608"), "{error}");
    // A list that claims four billion subjects within a small block.
    let mut writer = PacketWriter::default();
    writer.add_bytes(id::GLOBAL_SEGMENTS, &[1, 0, 0, 0, 0xff, 0xff, 0xff, 0xff]);
    writer.add(id::FRAME_INFO, &FrameInfo::default());
    let mut inbox = Inbox::default();
    inbox.push(&writer.finish());
    let mut scene = Scene::default();
    scene.take(inbox.next_packet().unwrap().unwrap()).unwrap();
    let error = scene.frame(Kind::Global, &[]).unwrap_err().to_string();
    assert!(error.contains("claims 4294967295 elements, 0 bytes are left"), "{error}");
}

#[test]
fn a_server_that_sends_without_end_is_dropped() {
    // A packet that begins rightly and claims the most: after that many bytes the client has had enough or a packet.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut sent = 0_usize;
        let noise = [0x5a; 1 << 16];
        stream.write_all(&[0x01, 0, 0x2b, 0x1a, 0, 0, 0x80, 0]).unwrap();
        while stream.write_all(&noise).is_ok() {
            sent += noise.len();
        }
        sent
    });
    let mut source = vicon::ViconSource::new(vicon::ViconOptions::new(&address));
    assert!(source.connect().is_err());
    drop(source);
    assert!(server.join().unwrap() < 4 * MAX_PACKET_BYTES, "it was hung up on");
}

#[test]
fn vrpn_lengths_and_greetings() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(&COOKIE).unwrap();
        stream.write_all(&[0xff; 24]).unwrap();
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"HTTP/1.1 400 Bad Request").unwrap();
    });
    let mut source = vrpn::VrpnSource::new(vrpn::VrpnOptions::new(&address));
    source.connect().unwrap();
    let error = source.next_frame(Duration::from_secs(3)).unwrap_err().to_string();
    assert!(error.contains("a message of 4294967295 bytes"), "{error}");
    let error = source.connect().unwrap_err().to_string();
    assert!(error.contains("is not that of VRPN 07"), "{error}");
    server.join().unwrap();
}

#[test]
fn a_server_that_only_echoes_does_not_hold_a_recorder_up() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let ids = [id::GLOBAL_SEGMENTS, id::FRAME_INFO].into();
        stream.write_all(&packet_of(id::OBJECT_ENUMS, &ObjectEnums { ids })).unwrap();
        let echo = packet_of(id::PING, &Ping { id: 5 });
        while stream.write_all(&echo).is_ok() {}
    });
    let mut source = vicon::ViconSource::new(vicon::ViconOptions::new(&address));
    source.connect().unwrap();
    assert!(source.next_frame(Duration::from_millis(200)).unwrap().is_none());
    drop(source);
    server.join().unwrap();
}
