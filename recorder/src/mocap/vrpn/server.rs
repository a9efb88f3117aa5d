//! The simulated server.

use super::message::{
    COOKIE, COOKIE_BYTES, Message, Names, PING, PONG, POS_QUAT, PosQuat, SENDER_DESCRIPTION, TYPE_DESCRIPTION,
    next_message,
};
use crate::mocap::MocapError;
use crate::mocap::buffer::StreamBuffer;
use crate::mocap::sim::{Fault, LineFaults, SimFrame, Stage, TICK, accept, spawn_client};
use crate::mocap::tcp::Tcp;
use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

const WRITE_TIMEOUT: Duration = Duration::from_secs(2);
const WAITING_PINGS: usize = 64;
/// Types by our ids.
const TYPES: [&str; 3] = [POS_QUAT, PING, PONG];
const POS_QUAT_ID: i32 = 0;
const PONG_ID: i32 = 2;

/// Listens on TCP and UDP until the script is over or the system is to stop. Gives the address.
pub fn listen(address: SocketAddr, stage: Arc<Stage>) -> io::Result<(SocketAddr, JoinHandle<()>)> {
    let listener = TcpListener::bind(address)?;
    let address = listener.local_addr()?;
    let udp = UdpSocket::bind(address)?;
    udp.set_read_timeout(Some(TICK))?;
    let thread = std::thread::spawn(move || {
        std::thread::scope(|scope| {
            scope.spawn(|| call_back(&udp, &stage));
            accept(&listener, &stage, serve);
        });
    });
    Ok((address, thread))
}

/// Connects to those who ask for it.
fn call_back(udp: &UdpSocket, stage: &Arc<Stage>) {
    let mut clients: Vec<JoinHandle<()>> = Vec::new();
    let mut datagram = [0; 256];
    while !stage.stopped() && !stage.is_over() {
        clients.retain(|client| !client.is_finished());
        let Ok(count) = udp.recv(&mut datagram) else { continue };
        let Some(address) = caller(&datagram[..count]) else { continue };
        // Who does not listen on the port that he named gets nothing.
        if let Ok(stream) = TcpStream::connect_timeout(&address, Duration::from_secs(1)) {
            clients.push(spawn_client(stream, stage, serve));
        }
    }
    for client in clients {
        let _ = client.join();
    }
}

/// `ADDRESS PORT` and a zero.
fn caller(datagram: &[u8]) -> Option<SocketAddr> {
    let text = std::str::from_utf8(datagram).ok()?.trim_end_matches('\0');
    let (ip, port) = text.split_once(' ')?;
    Some(SocketAddr::new(ip.parse().ok()?, port.trim().parse().ok()?))
}

/// Serves a client until it hangs up, the script is over, or the system is to stop.
fn serve(stream: TcpStream, stage: &Stage) -> Result<(), MocapError> {
    let address = stream.peer_addr().map_or_else(|_| String::new(), |peer| peer.to_string());
    let io_error = |source| MocapError::Io { address: address.clone(), source };
    let reader = Tcp::new(stream.try_clone().map_err(io_error)?, address.clone(), WRITE_TIMEOUT)?;
    let (sender, pings) = sync_channel(WAITING_PINGS);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            // Whatever ends the reading drops the sender, and that ends the writing.
            let _ = hear(reader, stage, &sender);
        });
        let tcp = Tcp::new(stream, address.clone(), WRITE_TIMEOUT)?;
        let mut session = Session { stage, line: LineFaults::new(tcp, stage, breaking_bytes), sequence: 0, known: 0 };
        let result = session.run(&pings);
        session.line.hang_up();
        result
    })
}

/// Reads what a client says; passes on the names of the senders that it pings.
fn hear(mut tcp: Tcp, stage: &Stage, pings: &SyncSender<String>) -> Result<(), MocapError> {
    let (mut buffer, mut names) = (StreamBuffer::default(), Names::default());
    let mut greeted = false;
    while !stage.stopped() {
        if let Some(piece) = tcp.receive(TICK)? {
            buffer.push(piece);
        }
        if !greeted && buffer.rest().len() >= COOKIE_BYTES {
            buffer.consume(COOKIE_BYTES);
            greeted = true;
        }
        if !greeted {
            continue;
        }
        let offset = buffer.offset();
        let wrong = |what| MocapError::Protocol { address: tcp.address().to_owned(), offset, what };
        while let Some(message) = next_message(&mut buffer).map_err(wrong)? {
            if names.learn(&message).map_err(wrong)? {
                continue;
            }
            if let Some((sender, PING)) = names.of(&message)
                && pings.send(sender.to_owned()).is_err()
            {
                return Ok(());
            }
        }
    }
    Ok(())
}

struct Session<'a> {
    stage: &'a Stage,
    line: LineFaults,
    sequence: u32,
    /// Subjects that the client was told of.
    known: usize,
}

impl Session<'_> {
    fn run(&mut self, pings: &Receiver<String>) -> Result<(), MocapError> {
        self.line.send_now(&COOKIE)?;
        for (id, name) in (0..).zip(TYPES) {
            self.line.send_now(&Message::description(TYPE_DESCRIPTION, id, name).encode())?;
        }
        let mut last = None;
        while !self.stage.stopped() {
            let index = self.stage.upcoming(last);
            match pings.recv_timeout(self.stage.until_sent(index).min(TICK)) {
                Ok(sender) => self.pong(&sender)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if !self.stage.until_sent(index).is_zero() {
                continue;
            }
            last = Some(index);
            let Some(frame) = self.stage.script.frame(index) else { break };
            if !self.stage.script.drops(index) {
                self.send(&frame)?;
            }
        }
        Ok(())
    }

    fn send(&mut self, frame: &SimFrame) -> Result<(), MocapError> {
        for body in frame.bodies.iter().skip(self.known) {
            let name = &self.stage.script.subjects[body.subject].name;
            let description = Message::description(SENDER_DESCRIPTION, body.subject as i32, name);
            self.line.send_now(&description.encode())?;
        }
        self.known = self.known.max(frame.bodies.len());
        let mut bytes = Vec::new();
        for body in &frame.bodies {
            let Some(pose) = body.world_from_marker else { continue };
            let pose = PosQuat { sensor: 0, position_m: pose.translation.into(), xyzw: pose.quaternion_xyzw() };
            let stamp_ns = self.stage.epoch_realtime_ns + frame.system_ns;
            bytes.extend(self.message(stamp_ns, body.subject as i32, POS_QUAT_ID, pose.encode()));
        }
        self.line.send_frame(&bytes)
    }

    fn pong(&mut self, sender: &str) -> Result<(), MocapError> {
        let subjects = &self.stage.script.subjects[..self.known];
        let Some(id) = subjects.iter().position(|subject| subject.name == sender) else { return Ok(()) };
        let stamp_ns = self.stage.epoch_realtime_ns + self.stage.now_ns();
        let pong = self.message(stamp_ns, id as i32, PONG_ID, Vec::new());
        self.line.send_now(&pong)
    }

    fn message(&mut self, stamp_ns: i64, sender: i32, kind: i32, payload: Vec<u8>) -> Vec<u8> {
        let message = Message { stamp_ns, sender, kind, sequence: self.sequence, payload };
        self.sequence = self.sequence.wrapping_add(1);
        message.encode()
    }
}

/// What comes down the line when a fault strikes.
fn breaking_bytes(fault: Fault) -> Vec<u8> {
    match fault {
        Fault::Oversize => [0xff; 24].to_vec(),
        _ => [0; 24].to_vec(),
    }
}
