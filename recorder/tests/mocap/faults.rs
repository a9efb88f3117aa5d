//! Each fault by name, and what a recorder sees of it.

use crate::support::{PATIENCE, assert_shows, client, frames, script, start, two_subjects};
use recorder::Arrival;
use recorder::mocap::sim::{Fault, Protocol, Script, SimServer};
use recorder::mocap::vicon::{ViconOptions, ViconSource};
use recorder::mocap::{Backoff, Link, LinkEvent, MocapError, MocapFrame, MocapSource as _};
use std::net::{SocketAddr, TcpListener};
use std::time::Duration;

const SHORT: Backoff = Backoff {
    first: Duration::from_millis(20),
    longest: Duration::from_millis(200),
    silence: Duration::from_millis(300),
};

/// What a link sees until `enough`.
fn events(link: &mut Link, enough: impl Fn(&[LinkEvent]) -> bool) -> Vec<LinkEvent> {
    let end_ns = Arrival::now().monotonic_ns + 10_000_000_000;
    let mut events = Vec::new();
    while !enough(&events) {
        assert!(Arrival::now().monotonic_ns < end_ns, "only {} events in ten seconds", events.len());
        match link.next(Duration::from_millis(100)) {
            LinkEvent::Idle => {}
            event => events.push(event),
        }
    }
    events
}

fn frames_of(events: &[LinkEvent]) -> Vec<&MocapFrame> {
    let frame = |event: &'_ LinkEvent| matches!(event, LinkEvent::Frame(_));
    events
        .iter()
        .filter(|e| frame(e))
        .filter_map(|e| if let LinkEvent::Frame(f) = e { Some(&**f) } else { None })
        .collect()
}

#[test]
fn dropped_frames_are_gaps_in_the_numbers() {
    for protocol in [Protocol::Vicon, Protocol::Udp] {
        let script = script(3, &[Fault::Drop]);
        let server = start(protocol, &script);
        let mut source = client(protocol, &server);
        source.connect().unwrap();
        let seen = frames(source.as_mut(), 100);
        let first = if protocol == Protocol::Vicon { 1 } else { 0 };
        let seen: Vec<u32> = seen.iter().map(|frame| frame.number.unwrap() as u32 - first).collect();
        let sent = (seen[0]..=*seen.last().unwrap()).filter(|index| !script.drops(*index));
        assert_eq!(seen, sent.collect::<Vec<_>>());
        assert!(seen.windows(2).any(|pair| pair[1] == pair[0] + 4), "three in a row");
    }
}

#[test]
fn a_late_subject_appears() {
    for protocol in [Protocol::Vicon, Protocol::Udp] {
        let script = two_subjects(3, &[Fault::LateSubject, Fault::Occlude]);
        let server = start(protocol, &script);
        let mut source = client(protocol, &server);
        source.connect().unwrap();
        let seen = frames(source.as_mut(), 130);
        let first = if protocol == Protocol::Vicon { 1 } else { 0 };
        for frame in &seen {
            assert_shows(frame, &script, frame.number.unwrap() as u32 - first, 1e-9);
        }
        assert!(seen[0].bodies.len() == 1 && seen[129].bodies.len() == 2);
    }
}

#[test]
fn a_late_subject_of_vrpn_appears() {
    let server = start(Protocol::Vrpn, &two_subjects(3, &[Fault::LateSubject]));
    let mut source = client(Protocol::Vrpn, &server);
    source.connect().unwrap();
    let seen = frames(source.as_mut(), 120);
    assert!(seen[0].bodies.iter().all(|body| body.subject == "quad"));
    assert!(seen.iter().flat_map(|frame| &frame.bodies).any(|body| body.subject == "person 2"));
}

#[test]
fn a_slow_link_gives_late_frames_but_right_ones() {
    let script = Script { rate_hz: 200.0, ..script(4, &[Fault::SlowLink]) };
    let server = start(Protocol::Vicon, &script);
    let mut source = client(Protocol::Vicon, &server);
    source.connect().unwrap();
    let seen = frames(source.as_mut(), 150);
    seen.iter().for_each(|frame| assert_shows(frame, &script, frame.number.unwrap() as u32 - 1, 1e-9));
    let took_ns = seen[149].arrival.monotonic_ns - seen[0].arrival.monotonic_ns;
    assert!(took_ns > 149 * 7_000_000, "7.5 ms a frame, not 5: {took_ns}");
}

/// A fault strikes a second after each connect; the link says what it was and reads on afterwards.
fn strikes(protocol: Protocol, fault: Fault, expected: fn(&MocapError) -> bool) {
    let script = Script { looped: true, ..script(2, &[fault]) };
    let server = start(protocol, &script);
    let mut link = Link::new(client(protocol, &server), SHORT);
    let lost = |events: &[LinkEvent]| events.iter().position(|e| matches!(e, LinkEvent::Lost(_)));
    let seen = events(&mut link, |seen| lost(seen).is_some_and(|at| frames_of(&seen[at..]).len() >= 10));
    assert!(matches!(seen[0], LinkEvent::Connected));
    let at = lost(&seen).unwrap();
    let LinkEvent::Lost(error) = &seen[at] else { unreachable!() };
    assert!(expected(error), "{fault} {protocol:?}: {error}");
    let before = frames_of(&seen[..at]).len();
    // With VRPN a frame that arrives in two pieces counts twice.
    assert!((100..120).contains(&before), "{fault} {protocol:?}: {before} frames before it");
    assert!(matches!(seen[at + 1], LinkEvent::Connected), "{:?}", seen[at + 1]);
}

#[test]
fn connections_break_and_come_back() {
    let closed = |error: &MocapError| matches!(error, MocapError::Closed { .. });
    let silent = |error: &MocapError| matches!(error, MocapError::Silent { .. });
    let protocol = |error: &MocapError| matches!(error, MocapError::Protocol { offset, .. } if *offset > 1000);
    std::thread::scope(|scope| {
        for kind in [Protocol::Vicon, Protocol::Vrpn] {
            scope.spawn(move || strikes(kind, Fault::Reconnect, closed));
            scope.spawn(move || strikes(kind, Fault::HalfOpen, silent));
            scope.spawn(move || strikes(kind, Fault::Garbage, protocol));
            scope.spawn(move || strikes(kind, Fault::Oversize, protocol));
        }
        scope.spawn(move || strikes(Protocol::Vicon, Fault::Truncate, protocol));
    });
}

#[test]
fn a_server_that_starts_again_is_found_again() {
    let script = Script { looped: true, ..script(2, &[]) };
    let server = start(Protocol::Vicon, &script);
    let address = server.address();
    let mut link = Link::new(client(Protocol::Vicon, &server), SHORT);
    events(&mut link, |seen| frames_of(seen).len() >= 5);
    drop(server);
    let seen = events(&mut link, |seen| seen.iter().filter(|e| matches!(e, LinkEvent::Refused { .. })).count() >= 3);
    assert!(seen.iter().any(|event| matches!(event, LinkEvent::Lost(MocapError::Closed { .. }))));
    let pauses: Vec<Duration> = seen
        .iter()
        .filter_map(|event| if let LinkEvent::Refused { pause, .. } = event { Some(*pause) } else { None })
        .collect();
    assert!(pauses.windows(2).all(|pair| pair[1] == (pair[0] * 2).min(SHORT.longest)), "{pauses:?}");
    let _again = SimServer::start(Protocol::Vicon, address, script, None).unwrap();
    let seen = events(&mut link, |seen| frames_of(seen).len() >= 5);
    assert!(seen.iter().any(|event| matches!(event, LinkEvent::Connected)));
}

#[test]
fn nobody_there_and_nobody_speaking() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address: SocketAddr = listener.local_addr().unwrap();
    let timeout = Duration::from_millis(150);
    let mut source = ViconSource::new(ViconOptions { timeout, ..ViconOptions::new(&address.to_string()) });
    assert!(matches!(source.connect(), Err(MocapError::Silent { .. })));
    drop(listener);
    assert!(matches!(source.connect(), Err(MocapError::Refused { .. })));
    let mut nowhere = ViconSource::new(ViconOptions::new("no such host.invalid"));
    assert!(matches!(nowhere.connect(), Err(MocapError::Io { .. })));
    let mut impossible = ViconSource::new(ViconOptions::new("127.0.0.1:99999"));
    assert!(matches!(impossible.connect(), Err(MocapError::Address(address)) if address == "127.0.0.1:99999"));
}

#[test]
fn datagrams_that_are_none_are_counted_and_zero_poses_are_occluded() {
    let script = script(3, &[Fault::Garbage, Fault::Occlude]);
    let server = start(Protocol::Udp, &script);
    let mut source = client(Protocol::Udp, &server);
    source.connect().unwrap();
    let seen = frames(source.as_mut(), 130);
    assert_eq!(seen.iter().map(|frame| frame.discarded).sum::<u32>(), 1);
    let after = seen.iter().find(|frame| frame.discarded == 1).unwrap();
    assert_eq!(after.number, Some(100));
    let hidden: Vec<_> = seen.iter().filter(|frame| frame.bodies[0].world_from_segment.is_none()).collect();
    assert_eq!(hidden.len(), 25);
    assert!(hidden.iter().all(|frame| frame.bodies[0].suspect));
}

#[test]
fn the_end_of_a_script_is_the_end() {
    let server = start(Protocol::Vicon, &script(1, &[]));
    let mut source = client(Protocol::Vicon, &server);
    source.connect().unwrap();
    let mut last = None;
    let error = loop {
        match source.next_frame(PATIENCE) {
            Ok(frame) => last = frame.expect("a frame in time").number,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, MocapError::Closed { .. }), "{error}");
    assert_eq!(last, Some(101), "the second's last frame, numbered from one");
}

#[test]
fn scripts_and_faults_that_make_no_sense() {
    let any: SocketAddr = ([127, 0, 0, 1], 0).into();
    let refused = |protocol, script| SimServer::start(protocol, any, script, None).err().unwrap().to_string();
    assert!(refused(Protocol::Udp, script(1, &[Fault::YUp])).contains("cannot have the fault `y-up`"));
    assert!(refused(Protocol::Vicon, Script { rate_hz: f64::NAN, ..script(1, &[]) }).contains("rate"));
    assert!(refused(Protocol::Vicon, Script { subjects: vec![], ..script(1, &[]) }).contains("name"));
    assert!(refused(Protocol::Vicon, script(0, &[])).contains("fewer than two poses"));
    assert!("dropp".parse::<Fault>().unwrap_err().contains("drop, occlude"));
    for (name, fault) in Fault::ALL {
        assert_eq!(name.parse(), Ok(fault));
        assert_eq!(fault.to_string(), name);
    }
}
