//! The client: greeting, wishes, frames.

use super::DEFAULT_PORT;
use super::object::{Filter, ObjectEnums, Ping, RequestFrame, RequestNextFrame, id};
use super::packet::{Inbox, Packet, PacketError, PacketWriter, packet_of};
use super::scene::Scene;
use crate::Arrival;
use crate::mocap::tcp::{Deadline, Tcp};
use crate::mocap::{MocapError, MocapFrame, MocapSource};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// How frames are fetched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ViconMode {
    /// The server sends every frame as soon as it exists: lowest latency, nothing skipped.
    #[default]
    ServerPush,
    /// One request a frame, answered when the next frame exists.
    Prefetch,
    /// One request a frame, answered with the frame that is there; a slow reader skips frames.
    Pull,
}

/// Which poses are asked for. All end up as poses in the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Segments {
    /// Poses in the world.
    #[default]
    Global,
    /// Poses in the parent segment.
    Local,
    /// The same in 32 bits, for slow links.
    Lightweight,
}

/// How to read a DataStream server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ViconOptions {
    /// `HOST` or `HOST:PORT`; the usual port is [`DEFAULT_PORT`].
    pub address: String,
    /// How frames are fetched.
    pub mode: ViconMode,
    /// Which poses.
    pub segments: Segments,
    /// Only these subjects; all if empty.
    pub subjects: Vec<String>,
    /// Markers too.
    pub markers: bool,
    /// Longest time for connecting, the greeting, and each write.
    pub timeout: Duration,
}

impl ViconOptions {
    /// The usual: every frame, poses in the world, all subjects, no markers; five seconds, as the SDK has.
    #[must_use]
    pub fn new(address: &str) -> Self {
        Self {
            address: address.to_owned(),
            mode: ViconMode::default(),
            segments: Segments::default(),
            subjects: Vec::new(),
            markers: false,
            timeout: Duration::from_secs(5),
        }
    }

    /// Everything that a recorder can use.
    fn wanted(&self) -> BTreeSet<u32> {
        let mut wanted = BTreeSet::from([
            id::CONTENTS,
            id::STREAM_INFO,
            id::SUBJECT_INFO,
            id::FRAME_INFO,
            id::HARDWARE_FRAME_INFO,
            id::TIMECODE,
            id::LATENCY_INFO,
            id::APPLICATION_INFO,
            id::SUBJECT_HEALTH,
            id::OBJECT_QUALITY,
            id::FRAME_RATE_INFO,
            id::PING,
        ]);
        wanted.insert(self.segments.object_id());
        if self.markers {
            wanted.extend([id::LABELED_RECONS, id::UNLABELED_RECONS]);
        }
        wanted
    }
}

impl Segments {
    fn object_id(self) -> u32 {
        match self {
            Self::Global => id::GLOBAL_SEGMENTS,
            Self::Local => id::LOCAL_SEGMENTS,
            Self::Lightweight => id::LIGHTWEIGHT_SEGMENTS,
        }
    }
}

/// A DataStream server as a source.
pub struct ViconSource {
    options: ViconOptions,
    connection: Option<Connection>,
}

struct Connection {
    tcp: Tcp,
    inbox: Inbox,
    scene: Scene,
    /// When the last bytes came.
    heard: Arrival,
    /// A frame is asked for and not here yet (not with [`ViconMode::ServerPush`]).
    asked: bool,
    /// Number of the last frame: a pull may give it again.
    last_number: Option<u64>,
    pings: Pings,
    /// Subject ids that the server was asked to restrict itself to.
    filtered: BTreeSet<u32>,
}

/// One ping at a time is on its way.
#[derive(Default)]
struct Pings {
    next_id: u64,
    /// Id and monotonic time of the one under way.
    under_way: Option<(u64, i64)>,
    round_trip_s: Option<f64>,
}

impl ViconSource {
    /// Not connected yet.
    #[must_use]
    pub fn new(options: ViconOptions) -> Self {
        Self { options, connection: None }
    }
}

impl MocapSource for ViconSource {
    fn describe(&self) -> String {
        format!("vicon {}", self.options.address)
    }

    fn connect(&mut self) -> Result<(), MocapError> {
        self.connection = None;
        self.connection = Some(Connection::open(&self.options)?);
        Ok(())
    }

    fn next_frame(&mut self, timeout: Duration) -> Result<Option<MocapFrame>, MocapError> {
        let not_connected = || MocapError::NotConnected { address: self.options.address.clone() };
        let connection = self.connection.as_mut().ok_or_else(not_connected)?;
        let result = connection.next_frame(&self.options, timeout);
        if result.is_err() {
            self.connection = None;
        }
        result
    }
}

impl Connection {
    fn open(options: &ViconOptions) -> Result<Self, MocapError> {
        let tcp = Tcp::connect(&options.address, DEFAULT_PORT, options.timeout)?;
        let mut connection = Self {
            tcp,
            inbox: Inbox::default(),
            scene: Scene::default(),
            heard: Arrival::default(),
            asked: false,
            last_number: None,
            pings: Pings::default(),
            filtered: BTreeSet::new(),
        };
        let deadline = Deadline::after(options.timeout);
        let offered = loop {
            let packet = connection.packet(deadline)?.filter(|_| !deadline.left().is_zero());
            let Some(packet) = packet else {
                let address = connection.tcp.address().to_owned();
                return Err(MocapError::Silent { address, waited: options.timeout });
            };
            let offer = packet.find::<ObjectEnums>(id::OBJECT_ENUMS).map_err(|e| connection.protocol(e))?;
            if let Some(offer) = offer {
                break offer.ids;
            }
        };
        if !offered.contains(&options.segments.object_id()) {
            let what = format!("the server has no {:?} segments; ask for others", options.segments);
            return Err(MocapError::WrongServer { address: connection.tcp.address().to_owned(), what });
        }
        let mut ids: BTreeSet<u32> = options.wanted().intersection(&offered).copied().collect();
        ids.insert(id::CONTENTS);
        let mut hello = PacketWriter::default();
        hello.add(id::OBJECT_ENUMS, &ObjectEnums { ids });
        if options.mode == ViconMode::ServerPush {
            hello.add(id::REQUEST_FRAME, &RequestFrame { streaming: true });
        }
        connection.tcp.send(&hello.finish())?;
        Ok(connection)
    }

    fn next_frame(&mut self, options: &ViconOptions, timeout: Duration) -> Result<Option<MocapFrame>, MocapError> {
        let deadline = Deadline::after(timeout);
        loop {
            if !self.asked {
                self.ask(options.mode)?;
            }
            let Some(packet) = self.packet(deadline)? else { return Ok(None) };
            self.pings.echoed(&packet, self.heard);
            if !self.scene.take(packet).map_err(|error| self.protocol(error))? {
                // Packets without a frame must not keep us here for ever.
                if deadline.left().is_zero() {
                    return Ok(None);
                }
                continue;
            }
            self.asked = false;
            let frame = self.scene.frame(options.segments, &options.subjects);
            let mut frame = frame.map_err(|error| self.protocol(error))?;
            if options.mode == ViconMode::Pull && frame.number == self.last_number {
                // The next one is a part of a frame away.
                std::thread::sleep(Duration::from_millis(1).min(deadline.left()));
                if deadline.left().is_zero() {
                    return Ok(None);
                }
                continue;
            }
            self.last_number = frame.number;
            self.restrict(options)?;
            frame.arrival = self.heard;
            frame.ping_round_trip_s = self.pings.round_trip_s;
            return Ok(Some(frame));
        }
    }

    /// Asks for a frame, if this mode wants that, and adds a ping.
    fn ask(&mut self, mode: ViconMode) -> Result<(), MocapError> {
        let mut message = PacketWriter::default();
        match mode {
            ViconMode::ServerPush => {}
            ViconMode::Prefetch => message.add(id::REQUEST_NEXT_FRAME, &RequestNextFrame { count: 1 }),
            ViconMode::Pull => message.add(id::REQUEST_FRAME, &RequestFrame { streaming: false }),
        }
        if let Some(ping) = self.pings.begin() {
            message.add(id::PING, &ping);
        }
        if !message.is_empty() {
            self.tcp.send(&message.finish())?;
        }
        self.asked = true;
        Ok(())
    }

    /// Tells the server which subjects are wanted, once their ids are known and whenever they change.
    fn restrict(&mut self, options: &ViconOptions) -> Result<(), MocapError> {
        if options.subjects.is_empty() {
            return Ok(());
        }
        let mut subjects = self.scene.subjects().map_err(|error| self.protocol(error))?;
        subjects.retain(|subject| options.subjects.contains(&subject.name));
        let ids: BTreeSet<u32> = subjects.iter().map(|subject| subject.subject).collect();
        if ids != self.filtered && !ids.is_empty() {
            let by_object = BTreeMap::from([(options.segments.object_id(), ids.clone())]);
            self.tcp.send(&packet_of(id::FILTER, &Filter { by_object }))?;
            self.filtered = ids;
        }
        Ok(())
    }

    fn packet(&mut self, deadline: Deadline) -> Result<Option<Packet>, MocapError> {
        let mut is_late = false;
        loop {
            if let Some(packet) = self.inbox.next_packet().map_err(|error| self.protocol(error))? {
                return Ok(Some(packet));
            }
            // A packet that comes in drops must not hold up a recorder that is to stop.
            if is_late {
                return Ok(None);
            }
            if let Some(piece) = self.tcp.receive(deadline.left())? {
                self.inbox.push(piece);
                self.heard = Arrival::now();
            }
            is_late = deadline.left().is_zero();
        }
    }

    /// An error of the bytes; if they are another server's greeting, that server.
    fn protocol(&self, error: PacketError) -> MocapError {
        let address = self.tcp.address().to_owned();
        if error.offset == 0 && self.inbox.rest().starts_with(b"vrpn: ver.") {
            let what = "this is Tracker's VRPN port, DataStream is 801".to_owned();
            return MocapError::WrongServer { address, what };
        }
        MocapError::Protocol { address, offset: error.offset, what: error.what }
    }
}

impl Pings {
    /// The ping to send now, if none is under way.
    fn begin(&mut self) -> Option<Ping> {
        if self.under_way.is_some() {
            return None;
        }
        self.next_id += 1;
        self.under_way = Some((self.next_id, Arrival::now().monotonic_ns));
        Some(Ping { id: self.next_id })
    }

    /// Looks for the echo.
    fn echoed(&mut self, packet: &Packet, heard: Arrival) {
        let Some((id, sent_ns)) = self.under_way else { return };
        let echoes = packet.blocks.iter().filter(|block| block.id == id::PING);
        if echoes.filter_map(|block| block.decode::<Ping>().ok()).any(|ping| ping.id == id) {
            self.round_trip_s = Some((heard.monotonic_ns - sent_ns) as f64 * 1e-9);
            self.under_way = None;
        }
    }
}
