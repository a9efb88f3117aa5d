//! Messages. Numbers are big-endian.

use crate::mocap::buffer::{StreamBuffer, hex};
use std::collections::BTreeMap;

/// What both sides send first: version, log mode 0, zeros.
pub const COOKIE: [u8; COOKIE_BYTES] = *b"vrpn: ver. 07.38  0\0\0\0\0\0";
/// Length of the cookie.
pub const COOKIE_BYTES: usize = 24;
/// As far as cookies must be the same: the major version.
pub const COOKIE_MAJOR: &[u8] = b"vrpn: ver. 07";
const HEADER_BYTES: usize = 24;
const ALIGNMENT: usize = 8;
/// Longest message that is believed: the size of VRPN's own buffers.
pub const MAX_MESSAGE_BYTES: usize = 64_000;
/// Names that one side may describe; VRPN itself allows 2000 types.
const MOST_NAMES: usize = 4096;

/// Message type of a sender's description.
pub const SENDER_DESCRIPTION: i32 = -1;
/// Message type of a type's description.
pub const TYPE_DESCRIPTION: i32 = -2;
/// Type of tracker poses.
pub const POS_QUAT: &str = "vrpn_Tracker Pos_Quat";
/// Type of the question whether a server is alive.
pub const PING: &str = "vrpn_Base ping_message";
/// Type of its answer.
pub const PONG: &str = "vrpn_Base pong_message";

/// One message.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Message {
    /// Sender's time of day, nanoseconds since 1970.
    pub stamp_ns: i64,
    /// Sender id; in a description the id that is described.
    pub sender: i32,
    /// Type id.
    pub kind: i32,
    /// Count of the connection's messages.
    pub sequence: u32,
    /// Content.
    pub payload: Vec<u8>,
}

impl Message {
    /// The bytes, padded.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let length = (HEADER_BYTES + self.payload.len()) as u32;
        let (seconds, rest_ns) = (self.stamp_ns.div_euclid(1_000_000_000), self.stamp_ns.rem_euclid(1_000_000_000));
        let words =
            [length, seconds as u32, (rest_ns / 1000) as u32, self.sender as u32, self.kind as u32, self.sequence];
        let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        bytes.extend_from_slice(&self.payload);
        bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), 0);
        bytes
    }

    /// Names an id of this side.
    #[must_use]
    pub fn description(kind: i32, id: i32, name: &str) -> Self {
        let mut payload = (name.len() as u32 + 1).to_be_bytes().to_vec();
        payload.extend_from_slice(name.as_bytes());
        payload.push(0);
        Self { sender: id, kind, payload, ..Self::default() }
    }

    /// The name in a description.
    fn described(&self) -> Option<String> {
        let (length, text) = self.payload.split_first_chunk()?;
        let text = text.get(..u32::from_be_bytes(*length) as usize)?;
        let end = text.iter().position(|byte| *byte == 0).unwrap_or(text.len());
        Some(String::from_utf8_lossy(&text[..end]).into_owned())
    }
}

/// The next whole message, if it has arrived.
///
/// # Errors
/// A length that is shorter than a header or beyond [`MAX_MESSAGE_BYTES`].
pub(crate) fn next_message(buffer: &mut StreamBuffer) -> Result<Option<Message>, String> {
    let Some((header, rest)) = buffer.rest().split_first_chunk::<HEADER_BYTES>() else { return Ok(None) };
    let word = |i: usize| u32::from_be_bytes([header[4 * i], header[4 * i + 1], header[4 * i + 2], header[4 * i + 3]]);
    let length = word(0) as usize;
    if !(HEADER_BYTES..=MAX_MESSAGE_BYTES).contains(&length) {
        return Err(format!("a message of {length} bytes ({}...)", hex(header)));
    }
    let padded = length.next_multiple_of(ALIGNMENT);
    let Some(body) = rest.get(..padded - HEADER_BYTES) else { return Ok(None) };
    let message = Message {
        stamp_ns: i64::from(word(1)) * 1_000_000_000 + i64::from(word(2)) * 1000,
        sender: word(3) as i32,
        kind: word(4) as i32,
        sequence: word(5),
        payload: body[..length - HEADER_BYTES].to_vec(),
    };
    buffer.consume(padded);
    Ok(Some(message))
}

/// All whole messages at the front of some bytes, and what ended them if it was no lack of bytes.
#[must_use]
pub fn read_all(bytes: &[u8]) -> (Vec<Message>, Option<String>) {
    let mut buffer = StreamBuffer::default();
    buffer.push(bytes);
    let (mut messages, mut names) = (Vec::new(), Names::default());
    loop {
        match next_message(&mut buffer) {
            Ok(Some(message)) => {
                if let Err(error) = names.learn(&message) {
                    return (messages, Some(error));
                }
                messages.push(message);
            }
            Ok(None) => return (messages, None),
            Err(error) => return (messages, Some(error)),
        }
    }
}

/// The other side's names for its ids.
#[derive(Debug, Default)]
pub struct Names {
    senders: BTreeMap<i32, String>,
    kinds: BTreeMap<i32, String>,
}

impl Names {
    /// Learns from a message; false if it is no description.
    ///
    /// # Errors
    /// A description without a name, or the 4097th.
    pub fn learn(&mut self, message: &Message) -> Result<bool, String> {
        let names = match message.kind {
            SENDER_DESCRIPTION => &mut self.senders,
            TYPE_DESCRIPTION => &mut self.kinds,
            _ => return Ok(false),
        };
        let name = message.described().ok_or_else(|| "a description without a name".to_owned())?;
        if names.len() >= MOST_NAMES && !names.contains_key(&message.sender) {
            return Err(format!("more than {MOST_NAMES} descriptions"));
        }
        names.insert(message.sender, name);
        Ok(true)
    }

    /// Sender and type of a message, if both were described.
    #[must_use]
    pub fn of(&self, message: &Message) -> Option<(&str, &str)> {
        Some((self.senders.get(&message.sender)?, self.kinds.get(&message.kind)?))
    }
}

/// A tracker's pose.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PosQuat {
    /// Sensor of the tracker, from 0.
    pub sensor: i32,
    /// Metres.
    pub position_m: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub xyzw: [f64; 4],
}

impl PosQuat {
    /// Bytes of a payload.
    pub const BYTES: usize = 64;

    /// Reads a payload; longer ones are fine.
    ///
    /// # Errors
    /// It is too short.
    pub fn parse(payload: &[u8]) -> Result<Self, String> {
        let short = || format!("a pose of {} bytes, {} wanted", payload.len(), Self::BYTES);
        let bytes: &[u8; Self::BYTES] = payload.first_chunk().ok_or_else(short)?;
        let number = |i: usize| f64::from_be_bytes(std::array::from_fn(|k| bytes[8 + 8 * i + k]));
        Ok(Self {
            sensor: i32::from_be_bytes(std::array::from_fn(|k| bytes[k])),
            position_m: std::array::from_fn(number),
            xyzw: std::array::from_fn(|i| number(i + 3)),
        })
    }

    /// The payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.sensor.to_be_bytes().to_vec();
        bytes.extend_from_slice(&[0; 4]);
        bytes.extend(self.position_m.iter().chain(&self.xyzw).flat_map(|number| number.to_be_bytes()));
        bytes
    }
}
