//! Packets: a tag, a length, and blocks with an object each.

use crate::mocap::buffer::{StreamBuffer, hex};
use crate::mocap::wire::{Input, Wire};

/// Begins each packet.
pub const TAG: u32 = 0x1A2B_0001;
const HEADER_BYTES: usize = 8;
/// Longest packet that is believed. A frame of a hundred subjects with all markers has less than a tenth; larger ones
/// carry video, which we never ask for.
pub const MAX_PACKET_BYTES: usize = 8 << 20;

/// Bytes that are no packet.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("byte {offset}: {what}")]
pub struct PacketError {
    /// Where in the stream, from 0.
    pub offset: u64,
    /// What is wrong.
    pub what: String,
}

/// A stream that is cut into packets, however its bytes arrive. Holds no more than one packet and one piece.
#[derive(Debug, Default)]
pub struct Inbox {
    buffer: StreamBuffer,
}

impl Inbox {
    /// Adds what has arrived.
    pub fn push(&mut self, piece: &[u8]) {
        self.buffer.push(piece);
    }

    /// What has arrived and is not used.
    #[must_use]
    pub fn rest(&self) -> &[u8] {
        self.buffer.rest()
    }

    /// The next whole packet, if it has arrived.
    ///
    /// # Errors
    /// No tag where one should be, a length beyond [`MAX_PACKET_BYTES`], or a block longer than its packet.
    pub fn next_packet(&mut self) -> Result<Option<Packet>, PacketError> {
        let offset = self.buffer.offset();
        let rest = self.buffer.rest();
        let shared = rest.len().min(4);
        if rest[..shared] != TAG.to_le_bytes()[..shared] {
            return Err(PacketError {
                offset,
                what: format!("{} is no packet's tag", hex(&rest[..rest.len().min(16)])),
            });
        }
        if rest.len() < HEADER_BYTES {
            return Ok(None);
        }
        let length = u32::from_le_bytes([rest[4], rest[5], rest[6], rest[7]]) as usize;
        if length > MAX_PACKET_BYTES {
            let what = format!("a packet of {length} bytes, more than {MAX_PACKET_BYTES}");
            return Err(PacketError { offset, what });
        }
        let Some(body) = rest.get(HEADER_BYTES..HEADER_BYTES + length) else { return Ok(None) };
        let packet = Packet::parse(body, offset + HEADER_BYTES as u64)?;
        self.buffer.consume(HEADER_BYTES + length);
        Ok(Some(packet))
    }
}

/// One object of a packet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// What it is, see [`id`](super::object::id).
    pub id: u32,
    /// Where its body begins in the stream.
    pub offset: u64,
    /// The object.
    pub body: Vec<u8>,
}

impl Block {
    /// The object. Bytes after it are allowed: newer servers may add fields.
    ///
    /// # Errors
    /// The body is shorter than the object.
    pub fn decode<T: Wire>(&self) -> Result<T, PacketError> {
        let wrong = |error| PacketError { offset: self.offset, what: format!("object {}: {error}", self.id) };
        T::read(&mut Input::new(&self.body)).map_err(wrong)
    }
}

/// A packet taken apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// In order.
    pub blocks: Vec<Block>,
}

impl Packet {
    fn parse(body: &[u8], offset: u64) -> Result<Self, PacketError> {
        let mut input = Input::new(body);
        let mut blocks = Vec::new();
        while !input.is_empty() {
            let at = offset + input.offset() as u64;
            let block = |input: &mut Input<'_>| {
                let id = u32::read(input)?;
                let length = u32::read(input)? as usize;
                let offset = offset + input.offset() as u64;
                Ok(Block { id, offset, body: input.take(length)?.to_vec() })
            };
            let wrong =
                |error: crate::mocap::wire::WireError| PacketError { offset: at, what: format!("block: {error}") };
            blocks.push(block(&mut input).map_err(wrong)?);
        }
        Ok(Self { blocks })
    }

    /// The object with this id, if there is one; the first of several.
    ///
    /// # Errors
    /// Its body is too short.
    pub fn find<T: Wire>(&self, id: u32) -> Result<Option<T>, PacketError> {
        self.blocks.iter().find(|block| block.id == id).map(Block::decode).transpose()
    }
}

/// Builds a packet.
#[derive(Debug)]
pub struct PacketWriter {
    bytes: Vec<u8>,
}

impl Default for PacketWriter {
    fn default() -> Self {
        let mut bytes = TAG.to_le_bytes().to_vec();
        0_u32.write(&mut bytes);
        Self { bytes }
    }
}

impl PacketWriter {
    /// Appends an object.
    pub fn add(&mut self, id: u32, object: &impl Wire) {
        id.write(&mut self.bytes);
        let at = self.bytes.len();
        0_u32.write(&mut self.bytes);
        object.write(&mut self.bytes);
        self.patch(at);
    }

    /// Appends an object whose body is written already.
    pub fn add_bytes(&mut self, id: u32, body: &[u8]) {
        id.write(&mut self.bytes);
        let at = self.bytes.len();
        0_u32.write(&mut self.bytes);
        self.bytes.extend_from_slice(body);
        self.patch(at);
    }

    /// Whether nothing was added.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.len() == HEADER_BYTES
    }

    /// The bytes to send.
    #[must_use]
    pub fn finish(mut self) -> Vec<u8> {
        self.patch(4);
        self.bytes
    }

    /// Writes at `at` how many bytes follow there.
    fn patch(&mut self, at: usize) {
        let length = u32::try_from(self.bytes.len() - at - 4).expect("our own packets are small");
        self.bytes[at..at + 4].copy_from_slice(&length.to_le_bytes());
    }
}

/// A packet with one object.
#[must_use]
pub fn packet_of(id: u32, object: &impl Wire) -> Vec<u8> {
    let mut writer = PacketWriter::default();
    writer.add(id, object);
    writer.finish()
}
