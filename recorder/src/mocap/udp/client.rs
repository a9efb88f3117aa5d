//! The receiver.

use super::DEFAULT_PORT;
use super::datagram::{Datagram, Object};
use crate::Arrival;
use crate::mocap::buffer::hex;
use crate::mocap::tcp::{Deadline, is_timeout, resolve};
use crate::mocap::{MocapBody, MocapError, MocapFrame, MocapSource, convert};
use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::time::Duration;

/// Larger than any UDP datagram.
const LARGEST_BYTES: usize = 1 << 16;
/// Names whose last pose is remembered; more have no rig.
const MOST_NAMES: usize = 4096;

/// How to receive Tracker's object stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdpOptions {
    /// Where to listen: `ADDRESS` or `ADDRESS:PORT` of this computer, `0.0.0.0` for all of its networks.
    pub listen: String,
    /// Only these objects; all if empty.
    pub subjects: Vec<String>,
}

impl Default for UdpOptions {
    fn default() -> Self {
        Self { listen: format!("0.0.0.0:{DEFAULT_PORT}"), subjects: Vec::new() }
    }
}

/// Tracker's object stream as a source.
pub struct UdpSource {
    options: UdpOptions,
    socket: Option<UdpSocket>,
    buffer: Vec<u8>,
    /// The last datagram's poses by name: an exactly repeated one is suspect.
    last: BTreeMap<String, Object>,
    /// Datagrams since the last frame that were none.
    discarded: u32,
}

impl UdpSource {
    /// Not bound yet.
    #[must_use]
    pub fn new(options: UdpOptions) -> Self {
        Self { options, socket: None, buffer: vec![0; LARGEST_BYTES], last: BTreeMap::new(), discarded: 0 }
    }

    fn frame(&mut self, datagram: Datagram, arrival: Arrival) -> MocapFrame {
        let mut bodies = Vec::new();
        for object in datagram.objects {
            if !self.options.subjects.is_empty() && !self.options.subjects.contains(&object.name) {
                continue;
            }
            let is_zero = object.position_mm == [0.0; 3] && object.euler_xyz == [0.0; 3];
            let pose = convert::from_euler_xyz(object.euler_xyz, object.position_mm).filter(|_| !is_zero);
            let is_repeated = self.last.get(&object.name) == Some(&object);
            bodies.push(MocapBody {
                subject: object.name.clone(),
                segment: object.name.clone(),
                suspect: pose.is_none() || is_repeated,
                world_from_segment: pose,
                ..MocapBody::default()
            });
            if self.last.len() < MOST_NAMES || self.last.contains_key(&object.name) {
                self.last.insert(object.name.clone(), object);
            }
        }
        let discarded = std::mem::take(&mut self.discarded);
        MocapFrame { number: Some(datagram.frame_number.into()), arrival, bodies, discarded, ..MocapFrame::default() }
    }
}

impl MocapSource for UdpSource {
    fn describe(&self) -> String {
        format!("vicon-udp {}", self.options.listen)
    }

    /// Binds the socket; there is nobody to connect to.
    fn connect(&mut self) -> Result<(), MocapError> {
        self.socket = None;
        let io_error = |source| MocapError::Io { address: self.options.listen.clone(), source };
        let addresses = resolve(&self.options.listen, DEFAULT_PORT)?;
        self.socket = Some(UdpSocket::bind(addresses.as_slice()).map_err(io_error)?);
        Ok(())
    }

    /// Datagrams that are not the protocol are counted; if nothing else comes in time, the last one is the error.
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<MocapFrame>, MocapError> {
        let address = self.options.listen.clone();
        let Some(socket) = &self.socket else { return Err(MocapError::NotConnected { address }) };
        let deadline = Deadline::after(timeout);
        let mut wrong = None;
        loop {
            let left = deadline.left().max(Duration::from_millis(1));
            let received = socket.set_read_timeout(Some(left)).and_then(|()| socket.recv(&mut self.buffer));
            match received {
                Ok(count) => match Datagram::parse(&self.buffer[..count]) {
                    Ok(datagram) => return Ok(Some(self.frame(datagram, Arrival::now()))),
                    Err(error) => {
                        self.discarded = self.discarded.saturating_add(1);
                        let head = hex(&self.buffer[..count.min(16)]);
                        wrong = Some(format!("no frame of Tracker's UDP object stream ({head}...): {error}"));
                    }
                },
                Err(error) if is_timeout(&error) => {}
                Err(source) => return Err(MocapError::Io { address, source }),
            }
            if deadline.left().is_zero() {
                return wrong.map_or(Ok(None), |what| Err(MocapError::Protocol { address, offset: 0, what }));
            }
        }
    }
}
