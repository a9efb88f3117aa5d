//! The simulated sender.

use super::datagram::{Datagram, MOST_OBJECTS, NAME_BYTES, Object};
use crate::mocap::convert::{self, MM_PER_M};
use crate::mocap::sim::{Fault, SimFrame, Stage, TICK};
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::thread::JoinHandle;

/// [`Fault::Garbage`]: of so many datagrams one is none.
const GARBAGE_PERIOD: u32 = 100;

/// Sends frames to an address until the script is over or the system is to stop.
pub fn send_to(address: SocketAddr, stage: Arc<Stage>) -> io::Result<JoinHandle<()>> {
    let subjects = &stage.script.subjects;
    if subjects.len() > MOST_OBJECTS || subjects.iter().any(|subject| subject.name.len() > NAME_BYTES) {
        let limits = format!("a datagram holds at most {MOST_OBJECTS} objects with names of {NAME_BYTES} bytes");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, limits));
    }
    let any = if address.is_ipv4() { (Ipv4Addr::UNSPECIFIED, 0).into() } else { (Ipv6Addr::UNSPECIFIED, 0).into() };
    let socket = UdpSocket::bind::<SocketAddr>(any)?;
    Ok(std::thread::spawn(move || {
        let mut last = None;
        while !stage.stopped() {
            let index = stage.upcoming(last);
            let wait = stage.until_sent(index);
            if !wait.is_zero() {
                std::thread::sleep(wait.min(TICK));
                continue;
            }
            last = Some(index);
            let Some(frame) = stage.script.frame(index) else { return };
            if stage.script.drops(index) {
                continue;
            }
            let is_garbage = stage.script.has(Fault::Garbage) && index % GARBAGE_PERIOD == GARBAGE_PERIOD - 1;
            let bytes = if is_garbage { b"no frame".to_vec() } else { datagram(&stage, &frame).encode() };
            // With nobody listening the datagram is lost, as with the real one.
            let _ = socket.send_to(&bytes, address);
        }
    }))
}

fn datagram(stage: &Stage, frame: &SimFrame) -> Datagram {
    let objects = frame.bodies.iter().map(|body| {
        let name = stage.script.subjects[body.subject].name.clone();
        match body.world_from_marker {
            Some(pose) => Object {
                name,
                position_mm: (pose.translation * MM_PER_M).into(),
                euler_xyz: convert::to_euler_xyz(&pose.rotation),
            },
            None => Object { name, ..Object::default() },
        }
    });
    Datagram { frame_number: frame.index, objects: objects.collect() }
}
