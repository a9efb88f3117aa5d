//! The simulated server's side of one connection.

use super::body;
use super::object::{self, Contents, Filter, ObjectEnums, Ping, RequestFrame, RequestNextFrame, id};
use super::packet::{Inbox, Packet, PacketError, PacketWriter, TAG, packet_of};
use crate::mocap::MocapError;
use crate::mocap::sim::{Fault, LineFaults, Stage, TICK};
use crate::mocap::tcp::Tcp;
use crate::mocap::wire::Wire as _;
use std::collections::{BTreeMap, BTreeSet};
use std::net::TcpStream;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// Messages of a client that wait; a client that sends more waits itself.
const WAITING_ASKS: usize = 64;
/// [`Fault::StaticOnce`]: every so many frames the qualities are sent again, and they alone.
const QUALITY_PERIOD: u32 = 10;
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);

/// What a client asks for.
enum Ask {
    Want(BTreeSet<u32>),
    Frame { streaming: bool },
    Next(u32),
    Ping(u64),
    Only(BTreeMap<u32, BTreeSet<u32>>),
}

/// Serves a client until it hangs up, the script is over, or the system is to stop.
pub(crate) fn serve(stream: TcpStream, stage: &Stage) -> Result<(), MocapError> {
    let address = stream.peer_addr().map_or_else(|_| String::new(), |peer| peer.to_string());
    let io_error = |source| MocapError::Io { address: address.clone(), source };
    let reader = Tcp::new(stream.try_clone().map_err(io_error)?, address.clone(), WRITE_TIMEOUT)?;
    let (sender, asks) = sync_channel(WAITING_ASKS);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            // Whatever ends the reading drops the sender, and that ends the writing.
            let _ = listen(reader, stage, &sender);
        });
        let tcp = Tcp::new(stream, address.clone(), WRITE_TIMEOUT)?;
        let mut session = Session::new(stage, tcp);
        let result = session.run(&asks);
        session.line.hang_up();
        result
    })
}

/// Reads what a client says.
fn listen(mut tcp: Tcp, stage: &Stage, asks: &SyncSender<Ask>) -> Result<(), MocapError> {
    let mut inbox = Inbox::default();
    let address = tcp.address().to_owned();
    let wrong = |e: PacketError| MocapError::Protocol { address: address.clone(), offset: e.offset, what: e.what };
    while !stage.stopped() {
        if let Some(piece) = tcp.receive(TICK)? {
            inbox.push(piece);
        }
        while let Some(packet) = inbox.next_packet().map_err(wrong)? {
            for ask in understand(&packet).map_err(wrong)? {
                if asks.send(ask).is_err() {
                    return Ok(());
                }
            }
        }
    }
    Ok(())
}

fn understand(packet: &Packet) -> Result<Vec<Ask>, PacketError> {
    let mut asks = Vec::new();
    for block in &packet.blocks {
        asks.push(match block.id {
            id::OBJECT_ENUMS => Ask::Want(block.decode::<ObjectEnums>()?.ids),
            id::REQUEST_FRAME => Ask::Frame { streaming: block.decode::<RequestFrame>()?.streaming },
            id::REQUEST_NEXT_FRAME => Ask::Next(block.decode::<RequestNextFrame>()?.count),
            id::PING => Ask::Ping(block.decode::<Ping>()?.id),
            id::FILTER => Ask::Only(block.decode::<Filter>()?.by_object),
            _ => continue,
        });
    }
    Ok(asks)
}

struct Session<'a> {
    stage: &'a Stage,
    line: LineFaults,
    wanted: BTreeSet<u32>,
    only: BTreeMap<u32, BTreeSet<u32>>,
    /// Every frame is sent.
    streaming: bool,
    /// So many of the next frames are sent.
    next: u32,
    /// So many times the frame that is there is sent.
    now: u32,
    pings: Vec<u64>,
    last: Option<u32>,
    /// What the client wanted, and how many subjects there were, when the static objects were sent.
    told: Option<(BTreeSet<u32>, usize)>,
}

impl<'a> Session<'a> {
    fn new(stage: &'a Stage, tcp: Tcp) -> Self {
        Self {
            stage,
            line: LineFaults::new(tcp, stage, breaking_bytes),
            wanted: BTreeSet::new(),
            only: BTreeMap::new(),
            streaming: false,
            next: 0,
            now: 0,
            pings: Vec::new(),
            last: None,
            told: None,
        }
    }

    fn run(&mut self, asks: &Receiver<Ask>) -> Result<(), MocapError> {
        self.line.send_now(&packet_of(id::OBJECT_ENUMS, &ObjectEnums { ids: body::offered() }))?;
        while !self.stage.stopped() {
            let due = if self.streaming || self.next > 0 { self.stage.until_sent(self.upcoming()) } else { TICK };
            match asks.recv_timeout(due.min(TICK)) {
                Ok(ask) => self.take(ask),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let newest = self.stage.script.newest(self.stage.now_ns());
            let sent = match newest.filter(|_| self.now > 0) {
                Some(newest) => {
                    self.now -= 1;
                    self.send(newest)?
                }
                None => self.send_upcoming()?,
            };
            let is_asked = self.streaming || self.next > 0 || self.now > 0;
            if !sent || !is_asked && self.stage.is_over() {
                break;
            }
        }
        Ok(())
    }

    fn take(&mut self, ask: Ask) {
        match ask {
            Ask::Want(ids) => (self.wanted, self.told) = (ids, None),
            Ask::Frame { streaming: true } => self.streaming = true,
            Ask::Frame { streaming: false } => (self.streaming, self.now) = (false, self.now.saturating_add(1)),
            Ask::Next(count) => (self.streaming, self.next) = (false, self.next.saturating_add(count)),
            // The oldest are forgotten when a client sends pings but asks for no frames.
            Ask::Ping(ping) => {
                self.pings.truncate(WAITING_ASKS);
                self.pings.push(ping);
            }
            Ask::Only(by_object) => self.only = by_object,
        }
    }

    /// The next frame in order.
    fn upcoming(&self) -> u32 {
        self.stage.upcoming(self.last)
    }

    /// Sends the next frame if it is wanted and time; false after the last one.
    fn send_upcoming(&mut self) -> Result<bool, MocapError> {
        let index = self.upcoming();
        if !(self.streaming || self.next > 0) || !self.stage.until_sent(index).is_zero() {
            return Ok(true);
        }
        if self.stage.script.drops(index) {
            self.last = Some(index);
            return Ok(true);
        }
        self.next = self.next.saturating_sub(1);
        self.send(index)
    }

    fn send(&mut self, mut index: u32) -> Result<bool, MocapError> {
        self.last = Some(index);
        while self.stage.script.drops(index) && index > 0 {
            index -= 1;
        }
        let Some(frame) = self.stage.script.frame(index) else { return Ok(false) };
        let mut blocks: Vec<(u32, Vec<u8>)> = Vec::new();
        let mut contents = Contents::default();
        let again = (self.wanted.clone(), frame.bodies.len());
        let told = self.stage.script.has(Fault::StaticOnce) && self.told.as_ref() == Some(&again);
        for object in object::STATIC.into_iter().chain(object::DYNAMIC).filter(|o| self.wanted.contains(o)) {
            if told && is_unchanged(object, index) {
                contents.unchanged.insert(object);
                continue;
            }
            let mut bodies = body::blocks(object, &self.stage.script, &frame);
            bodies.retain(|body| self.is_wanted(object, body));
            if !bodies.is_empty() {
                contents.counts.insert(object, u32::try_from(bodies.len()).unwrap_or(u32::MAX));
            }
            blocks.extend(bodies.into_iter().map(|body| (object, body)));
        }
        self.told = Some(again);
        let mut packet = PacketWriter::default();
        packet.add(id::CONTENTS, &contents);
        blocks.iter().for_each(|(object, body)| packet.add_bytes(*object, body));
        self.pings.drain(..).for_each(|ping| packet.add(id::PING, &Ping { id: ping }));
        self.line.send_frame(&packet.finish())?;
        Ok(true)
    }

    /// Whether the client's filter lets an object pass; all that it can filter begin with the subject's id.
    fn is_wanted(&self, object: u32, body: &[u8]) -> bool {
        let subject = body.get(..4).and_then(|id| id.try_into().ok()).map(u32::from_le_bytes);
        self.only.get(&object).is_none_or(|only| subject.is_some_and(|subject| only.contains(&subject)))
    }
}

/// With [`Fault::StaticOnce`]: what need not be sent with this frame.
fn is_unchanged(object: u32, index: u32) -> bool {
    let quality_again = index.is_multiple_of(QUALITY_PERIOD);
    match object {
        id::OBJECT_QUALITY | id::SUBJECT_HEALTH => !quality_again,
        id::FRAME_RATE_INFO | id::UNLABELED_RECONS => true,
        _ => object::STATIC.contains(&object),
    }
}

/// What comes down the line when a fault strikes.
fn breaking_bytes(fault: Fault) -> Vec<u8> {
    match fault {
        Fault::Truncate => {
            let mut packet = PacketWriter::default();
            packet.add_bytes(id::FRAME_INFO, &[1, 2]);
            packet.finish()
        }
        Fault::Oversize => {
            let mut header = Vec::new();
            TAG.write(&mut header);
            u32::MAX.write(&mut header);
            header
        }
        _ => b"\xde\xad\xbe\xef is no packet".to_vec(),
    }
}
