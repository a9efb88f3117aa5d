//! A path, simulated systems, and what clients see of them.

use nalgebra::Vector6;
use recorder::Arrival;
use recorder::mocap::sim::{Fault, Path, Protocol, Script, SimServer};
use recorder::mocap::udp::{UdpOptions, UdpSource};
use recorder::mocap::vicon::{ViconOptions, ViconSource};
use recorder::mocap::vrpn::{VrpnOptions, VrpnSource};
use recorder::mocap::{MocapFrame, MocapSource};
use slam_math::{Se3, float};
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

/// Longer than any frame takes, also on a machine with other work.
pub const PATIENCE: Duration = Duration::from_secs(3);

/// `seconds` of a motion with all six degrees of freedom, 50 poses a second.
pub fn path(seconds: i64) -> Path {
    Path::new((0..=seconds * 50).map(|i| {
        let t = i as f64 * 0.02;
        let wave = |k: usize| float::sin(t * (1.0 + 0.3 * k as f64) + k as f64);
        let pose = Se3::exp(&Vector6::from_fn(|k, _| wave(k)));
        (1_700_000_000_000_000_000 + i * 20_000_000, pose)
    }))
}

/// One subject, `quad`, for `seconds`, with these faults.
pub fn script(seconds: i64, faults: &[Fault]) -> Script {
    Script { faults: faults.iter().copied().collect(), ..Script::new("quad", path(seconds)) }
}

/// Two subjects on different paths.
pub fn two_subjects(seconds: i64, faults: &[Fault]) -> Script {
    let mut script = script(seconds, faults);
    let mut second = script.subjects[0].clone();
    second.name = "person 2".to_owned();
    second.path = Path::new((0..=seconds * 50).map(|i| {
        let turn = Vector6::new(1.0, 2.0, 0.5, 0.0, 0.0, 0.01 * i as f64);
        (1_700_000_000_000_000_000 + i * 20_000_000, Se3::exp(&turn))
    }));
    script.subjects.push(second);
    script
}

/// A system on a free port of this computer.
pub fn start(protocol: Protocol, script: &Script) -> SimServer {
    let any: SocketAddr = ([127, 0, 0, 1], 0).into();
    let address = if protocol == Protocol::Udp { free_udp_port() } else { any };
    // A little later, so that the client is there for the first frame.
    let epoch_ns = Arrival::now().monotonic_ns + 200_000_000;
    SimServer::start(protocol, address, script.clone(), Some(epoch_ns)).unwrap()
}

/// An address that nobody has.
pub fn free_udp_port() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// The client of a system, not connected.
pub fn client(protocol: Protocol, server: &SimServer) -> Box<dyn MocapSource> {
    let address = server.address().to_string();
    match protocol {
        Protocol::Vicon => Box::new(ViconSource::new(ViconOptions::new(&address))),
        Protocol::Vrpn => Box::new(VrpnSource::new(VrpnOptions::new(&format!("tcp://{address}")))),
        Protocol::Udp => Box::new(UdpSource::new(UdpOptions { listen: address, subjects: Vec::new() })),
    }
}

/// The next `count` frames.
pub fn frames(source: &mut dyn MocapSource, count: usize) -> Vec<MocapFrame> {
    let mut frames = Vec::new();
    while frames.len() < count {
        frames.push(source.next_frame(PATIENCE).unwrap().expect("a frame in time"));
    }
    frames
}

/// How far apart two poses are: metres and radians together.
pub fn distance(a: &Se3, b: &Se3) -> f64 {
    (a.inverse() * *b).log().norm()
}

/// Compares a frame of the system with index `index` with the script: subjects, occlusion and poses.
pub fn assert_shows(frame: &MocapFrame, script: &Script, index: u32, tolerance: f64) {
    let truth = script.frame(index).unwrap();
    assert_eq!(frame.bodies.len(), truth.bodies.len(), "frame {index}");
    for (body, truth) in frame.bodies.iter().zip(&truth.bodies) {
        assert_eq!(body.subject, script.subjects[truth.subject].name);
        assert_eq!(body.segment, body.subject);
        match (&body.world_from_segment, &truth.world_from_marker) {
            (Some(seen), Some(true_pose)) => {
                let error = distance(seen, true_pose);
                assert!(error < tolerance, "frame {index}: {error}");
            }
            (seen, true_pose) => assert_eq!(seen.is_some(), true_pose.is_some(), "frame {index}"),
        }
    }
}
