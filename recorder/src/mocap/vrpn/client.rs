//! The client.

use super::DEFAULT_PORT;
use super::message::{COOKIE, COOKIE_BYTES, COOKIE_MAJOR, Message, Names, POS_QUAT, PosQuat, next_message};
use crate::Arrival;
use crate::mocap::buffer::{StreamBuffer, hex};
use crate::mocap::tcp::{Deadline, Tcp, resolve};
use crate::mocap::{MocapBody, MocapError, MocapFrame, MocapSource, convert};
use std::collections::BTreeMap;
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::time::Duration;

/// A lost call for a call-back is repeated so often.
const CALL_AGAIN: Duration = Duration::from_millis(500);
const LOOK_AGAIN: Duration = Duration::from_millis(5);
/// Sensors whose last pose is remembered; more have no rig.
const MOST_SENSORS: usize = 4096;

/// How to read a VRPN server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VrpnOptions {
    /// `tcp://HOST[:PORT]` for a plain connection; `HOST[:PORT]` for VRPN's own way: a UDP datagram asks the server to
    /// call back.
    pub address: String,
    /// Only these trackers; all if empty.
    pub subjects: Vec<String>,
    /// Longest time for connecting, the greeting, and each write.
    pub timeout: Duration,
}

impl VrpnOptions {
    /// All trackers; five seconds.
    #[must_use]
    pub fn new(address: &str) -> Self {
        Self { address: address.to_owned(), subjects: Vec::new(), timeout: Duration::from_secs(5) }
    }
}

/// A VRPN server as a source.
pub struct VrpnSource {
    options: VrpnOptions,
    connection: Option<Connection>,
}

struct Connection {
    tcp: Tcp,
    buffer: StreamBuffer,
    names: Names,
    heard: Arrival,
    /// The last pose of each tracker's sensors: an exactly repeated one is suspect.
    last: BTreeMap<(String, i32), PosQuat>,
    /// Read already, but of the next frame.
    ahead: Option<(i64, MocapBody)>,
}

impl VrpnSource {
    /// Not connected yet.
    #[must_use]
    pub fn new(options: VrpnOptions) -> Self {
        Self { options, connection: None }
    }
}

impl MocapSource for VrpnSource {
    fn describe(&self) -> String {
        format!("vrpn {}", self.options.address)
    }

    fn connect(&mut self) -> Result<(), MocapError> {
        self.connection = None;
        self.connection = Some(Connection::open(&self.options)?);
        Ok(())
    }

    fn next_frame(&mut self, timeout: Duration) -> Result<Option<MocapFrame>, MocapError> {
        let not_connected = || MocapError::NotConnected { address: self.options.address.clone() };
        let connection = self.connection.as_mut().ok_or_else(not_connected)?;
        let result = connection.next_frame(&self.options.subjects, timeout);
        if result.is_err() {
            self.connection = None;
        }
        result
    }
}

impl Connection {
    fn open(options: &VrpnOptions) -> Result<Self, MocapError> {
        let timeout = options.timeout;
        let tcp = match options.address.strip_prefix("tcp://") {
            Some(address) => Tcp::connect(address, DEFAULT_PORT, timeout)?,
            None => called_back(&options.address, timeout)?,
        };
        let (buffer, names, heard) = (StreamBuffer::default(), Names::default(), Arrival::default());
        let mut connection = Self { tcp, buffer, names, heard, last: BTreeMap::new(), ahead: None };
        connection.tcp.send(&COOKIE)?;
        let deadline = Deadline::after(timeout);
        while connection.buffer.rest().len() < COOKIE_BYTES {
            if !connection.fill(deadline)? {
                let address = connection.tcp.address().to_owned();
                return Err(MocapError::Silent { address, waited: timeout });
            }
            connection.check_cookie()?;
        }
        connection.buffer.consume(COOKIE_BYTES);
        Ok(connection)
    }

    /// Compares as much of the cookie as has arrived.
    fn check_cookie(&self) -> Result<(), MocapError> {
        let rest = self.buffer.rest();
        let shared = rest.len().min(COOKIE_MAJOR.len());
        if rest[..shared] == COOKIE_MAJOR[..shared] {
            return Ok(());
        }
        let address = self.tcp.address().to_owned();
        let what = if rest.starts_with(&crate::mocap::vicon::packet::TAG.to_le_bytes()) {
            "this is a Vicon DataStream port, VRPN is 3883".to_owned()
        } else {
            format!("the greeting {} is not that of VRPN 07", hex(&rest[..rest.len().min(COOKIE_BYTES)]))
        };
        Err(MocapError::WrongServer { address, what })
    }

    /// Waits for bytes; false if none came in time.
    fn fill(&mut self, deadline: Deadline) -> Result<bool, MocapError> {
        loop {
            match self.tcp.receive(deadline.left())? {
                Some(piece) => self.buffer.push(piece),
                None if deadline.left().is_zero() => return Ok(false),
                None => continue,
            }
            self.heard = Arrival::now();
            return Ok(true);
        }
    }

    /// Poses with one stamp are one frame, as far as they arrived together: VRPN does not say where a frame ends, and
    /// waiting for the next one would cost a frame's time.
    fn next_frame(&mut self, subjects: &[String], timeout: Duration) -> Result<Option<MocapFrame>, MocapError> {
        let deadline = Deadline::after(timeout);
        let address = self.tcp.address().to_owned();
        let mut is_late = false;
        let mut frame: Option<(i64, Vec<MocapBody>)> = self.ahead.take().map(|(stamp, body)| (stamp, vec![body]));
        loop {
            let offset = self.buffer.offset();
            let wrong = |what| MocapError::Protocol { address: address.clone(), offset, what };
            let Some(message) = next_message(&mut self.buffer).map_err(wrong)? else {
                if let Some((stamp_ns, bodies)) = frame {
                    return Ok(Some(self.frame(stamp_ns, bodies)));
                }
                // Messages without a pose must not keep us here for ever.
                if is_late || !self.fill(deadline)? {
                    return Ok(None);
                }
                is_late = deadline.left().is_zero();
                continue;
            };
            let Some(body) = self.body(&message, subjects).map_err(wrong)? else { continue };
            match &mut frame {
                None => frame = Some((message.stamp_ns, vec![body])),
                Some((stamp_ns, bodies)) if *stamp_ns == message.stamp_ns => bodies.push(body),
                Some((stamp_ns, bodies)) => {
                    self.ahead = Some((message.stamp_ns, body));
                    let (stamp_ns, bodies) = (*stamp_ns, std::mem::take(bodies));
                    return Ok(Some(self.frame(stamp_ns, bodies)));
                }
            }
        }
    }

    fn frame(&self, stamp_ns: i64, bodies: Vec<MocapBody>) -> MocapFrame {
        MocapFrame { arrival: self.heard, source_stamp_ns: Some(stamp_ns), bodies, ..MocapFrame::default() }
    }

    /// The body in a message, if it is a pose of one that is wanted.
    fn body(&mut self, message: &Message, subjects: &[String]) -> Result<Option<MocapBody>, String> {
        if self.names.learn(message)? {
            return Ok(None);
        }
        let Some((tracker, POS_QUAT)) = self.names.of(message) else { return Ok(None) };
        if !subjects.is_empty() && !subjects.iter().any(|subject| subject == tracker) {
            return Ok(None);
        }
        let pose = PosQuat::parse(&message.payload)?;
        let world_from_segment = convert::from_quaternion(pose.position_m, pose.xyzw);
        let segment = if pose.sensor == 0 { tracker.to_owned() } else { format!("sensor{}", pose.sensor) };
        let key = (tracker.to_owned(), pose.sensor);
        let is_repeated = self.last.get(&key) == Some(&pose);
        let body = MocapBody {
            subject: tracker.to_owned(),
            segment,
            suspect: is_repeated || world_from_segment.is_none(),
            world_from_segment,
            ..MocapBody::default()
        };
        if self.last.len() < MOST_SENSORS || self.last.contains_key(&key) {
            self.last.insert(key, pose);
        }
        Ok(Some(body))
    }
}

/// Asks the server by UDP to connect to a port of ours, and waits for it.
fn called_back(address: &str, timeout: Duration) -> Result<Tcp, MocapError> {
    let server = resolve(address, DEFAULT_PORT)?[0];
    let io_error = |source| MocapError::Io { address: server.to_string(), source };
    let any: SocketAddr = if server.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() };
    let udp = UdpSocket::bind(any).map_err(io_error)?;
    udp.connect(server).map_err(io_error)?;
    let ours = udp.local_addr().map_err(io_error)?.ip();
    let listener = TcpListener::bind((ours, 0)).map_err(io_error)?;
    listener.set_nonblocking(true).map_err(io_error)?;
    let port = listener.local_addr().map_err(io_error)?.port();
    let deadline = Deadline::after(timeout);
    while !deadline.left().is_zero() {
        udp.send(format!("{ours} {port}\0").as_bytes()).map_err(io_error)?;
        let again = Deadline::after(CALL_AGAIN.min(deadline.left()));
        while !again.left().is_zero() {
            if let Ok((stream, peer)) = listener.accept() {
                // Others may knock too; only the server was asked.
                if peer.ip() == server.ip() {
                    stream.set_nonblocking(false).map_err(io_error)?;
                    return Tcp::new(stream, server.to_string(), timeout);
                }
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }
    Err(MocapError::Silent { address: server.to_string(), waited: timeout })
}
