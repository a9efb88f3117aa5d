//! MCAP records as bytes: what stands inside a verified chunk, the summary, and what lies between verified records.

use super::report::Damage;
use super::scan::RECORD_HEAD;
use super::window::Window;
use schemas::metadata;
use std::collections::BTreeMap;
use std::io;

/// First and last bytes of a file.
pub const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const ATTACHMENT: u8 = 0x09;
const STATISTICS: u8 = 0x0B;
const METADATA: u8 = 0x0C;
const DATA_END: u8 = 0x0F;
const FOOTER_BYTES: u64 = RECORD_HEAD + 20;
const DATA_END_BYTES: u64 = RECORD_HEAD + 4;
const MAX_SUMMARY_BYTES: u64 = 256 << 20;

/// Takes little-endian fields off the front; none when the bytes end before.
pub struct Cursor<'a>(pub &'a [u8]);

impl<'a> Cursor<'a> {
    pub fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(head)
    }

    pub fn skip(&mut self, len: usize) {
        self.take(len);
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.number::<1>().map(|b| b[0])
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    pub fn text(&mut self) -> Option<String> {
        let len = self.u32()? as usize;
        std::str::from_utf8(self.take(len)?).ok().map(str::to_owned)
    }

    pub fn text_map(&mut self) -> Option<BTreeMap<String, String>> {
        let len = self.u32()? as usize;
        let mut inner = Cursor(self.take(len)?);
        let mut map = BTreeMap::new();
        while !inner.0.is_empty() {
            map.insert(inner.text()?, inner.text()?);
        }
        Some(map)
    }

    /// Opcode and body of the next record.
    pub fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let opcode = self.u8()?;
        let len = usize::try_from(self.u64()?).ok()?;
        Some((opcode, self.take(len)?))
    }
}

/// A schema record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaDefinition {
    /// Type, as `sensor_msgs/msg/Image`.
    pub name: String,
    /// Language of the text, as `ros2msg`.
    pub encoding: String,
    /// The definition.
    pub data: Vec<u8>,
}

/// A channel record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelDefinition {
    pub schema_id: u16,
    pub topic: String,
    pub message_encoding: String,
    pub metadata: BTreeMap<String, String>,
}

/// The definitions in a verified metadata record, if it is a channel's second copy.
pub fn channel_copy(
    name: &str,
    values: &BTreeMap<String, String>,
) -> Option<(u16, ChannelDefinition, SchemaDefinition)> {
    use metadata::channel as key;
    name.strip_prefix(metadata::CHANNEL_PREFIX)?;
    let text = |key: &str| values.get(key).cloned();
    let id = values.get(key::ID)?.parse().ok()?;
    let schema = SchemaDefinition {
        name: text(key::SCHEMA_NAME)?,
        encoding: text(key::SCHEMA_ENCODING)?,
        data: text(key::SCHEMA_TEXT)?.into_bytes(),
    };
    let own = values.iter().filter_map(|(key, value)| Some((key.strip_prefix(key::METADATA_PREFIX)?, value)));
    let channel = ChannelDefinition {
        schema_id: values.get(key::SCHEMA_ID)?.parse().ok()?,
        topic: text(key::TOPIC)?,
        message_encoding: text(key::ENCODING)?,
        metadata: own.map(|(key, value)| (key.to_owned(), value.clone())).collect(),
    };
    Some((id, channel, schema))
}

/// A message's own fields.
#[derive(Debug, Clone, Copy)]
pub struct MessageFields {
    pub channel_id: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
}

/// One record of a chunk.
pub enum Content<'a> {
    Schema(u16, SchemaDefinition),
    Channel(u16, ChannelDefinition),
    Message(MessageFields, &'a [u8]),
    Other,
}

/// The records of a chunk; a single `None` where they stop making sense.
pub fn iterate(content: &[u8]) -> impl Iterator<Item = Option<Content<'_>>> {
    let mut cursor = Cursor(content);
    std::iter::from_fn(move || {
        if cursor.0.is_empty() {
            return None;
        }
        let parsed = cursor.record().and_then(|(opcode, body)| parse(opcode, body));
        if parsed.is_none() {
            cursor.0 = &[];
        }
        Some(parsed)
    })
}

/// A record that may stand in a chunk.
pub fn parse(opcode: u8, body: &[u8]) -> Option<Content<'_>> {
    let mut cursor = Cursor(body);
    Some(match opcode {
        SCHEMA => {
            let (id, name, encoding) = (cursor.u16()?, cursor.text()?, cursor.text()?);
            let len = cursor.u32()? as usize;
            let data = cursor.take(len)?.to_vec();
            Content::Schema(id, SchemaDefinition { name, encoding, data })
        }
        CHANNEL => {
            let (id, schema_id, topic) = (cursor.u16()?, cursor.u16()?, cursor.text()?);
            let (message_encoding, metadata) = (cursor.text()?, cursor.text_map()?);
            Content::Channel(id, ChannelDefinition { schema_id, topic, message_encoding, metadata })
        }
        MESSAGE => {
            let (channel_id, sequence) = (cursor.u16()?, cursor.u32()?);
            let (log_time, publish_time) = (cursor.u64()?, cursor.u64()?);
            Content::Message(MessageFields { channel_id, sequence, log_time, publish_time }, cursor.0)
        }
        _ => Content::Other,
    })
}

/// The end of a file, if its checksum agrees.
pub struct Summary {
    pub schemas: BTreeMap<u16, SchemaDefinition>,
    pub channels: BTreeMap<u16, ChannelDefinition>,
    pub message_count: u64,
    pub attachment_count: u64,
    pub metadata_count: u64,
    pub messages_by_channel: BTreeMap<u16, u64>,
    /// Where the data section's end record should stand.
    pub data_end: u64,
}

impl Summary {
    /// Reads and verifies the summary; none if the file is cut, or the summary damaged, absent or without checksum.
    pub fn read(window: &mut Window) -> io::Result<Option<Self>> {
        let Some(footer_at) = window.len().checked_sub(FOOTER_BYTES + MAGIC.len() as u64) else { return Ok(None) };
        let Some(footer) = window.get(footer_at, FOOTER_BYTES as usize)? else { return Ok(None) };
        let mut cursor = Cursor(footer);
        let fields = (cursor.u8(), cursor.u64(), cursor.u64(), cursor.u64(), cursor.u32());
        let (Some(FOOTER), Some(20), Some(start), Some(_), Some(crc)) = fields else { return Ok(None) };
        // The checksum covers the summary and the footer up to the checksum itself.
        let crc_end = footer_at + FOOTER_BYTES - 4;
        if crc == 0 || start < DATA_END_BYTES || start > footer_at || crc_end - start > MAX_SUMMARY_BYTES {
            return Ok(None);
        }
        let Some(bytes) = window.get(start, (crc_end - start) as usize)? else { return Ok(None) };
        if crc32fast::hash(bytes) != crc {
            return Ok(None);
        }
        Ok(Self::parse(&bytes[..(footer_at - start) as usize], start - DATA_END_BYTES))
    }

    fn parse(bytes: &[u8], data_end: u64) -> Option<Self> {
        let (mut schemas, mut channels) = (BTreeMap::new(), BTreeMap::new());
        let mut statistics = None;
        let mut cursor = Cursor(bytes);
        while !cursor.0.is_empty() {
            let (opcode, body) = cursor.record()?;
            match parse(opcode, body)? {
                Content::Schema(id, schema) => drop(schemas.insert(id, schema)),
                Content::Channel(id, channel) => drop(channels.insert(id, channel)),
                _ if opcode == STATISTICS => statistics = Some(body),
                _ => {}
            }
        }
        let mut cursor = Cursor(statistics?);
        let message_count = cursor.u64()?;
        cursor.skip(2 + 4);
        let (attachment_count, metadata_count) = (cursor.u32()?.into(), cursor.u32()?.into());
        cursor.skip(4 + 8 + 8);
        let len = cursor.u32()? as usize;
        let mut counts = Cursor(cursor.take(len)?);
        let mut messages_by_channel = BTreeMap::new();
        while !counts.0.is_empty() {
            messages_by_channel.insert(counts.u16()?, counts.u64()?);
        }
        Some(Self { schemas, channels, message_count, attachment_count, metadata_count, messages_by_channel, data_end })
    }
}

/// Whether a data-end record at or after `from` holds the checksum of everything before it.
pub fn data_section_ok(window: &mut Window, from: u64) -> io::Result<bool> {
    let mut candidates = Vec::new();
    let mut at = from;
    // Behind the last verified record stand only small ones: a few MiB are enough to look for the end.
    while at + DATA_END_BYTES <= window.len().min(from + MAX_SUMMARY_BYTES) {
        let Some(bytes) = window.get(at, DATA_END_BYTES as usize)? else { break };
        let mut cursor = Cursor(bytes);
        if let (Some(DATA_END), Some(4), Some(crc)) = (cursor.u8(), cursor.u64(), cursor.u32())
            && crc != 0
        {
            candidates.push((at, crc));
        }
        at += 1;
    }
    let ends: Vec<u64> = candidates.iter().map(|(at, _)| *at).collect();
    let sums = window.crcs(0, &ends)?;
    Ok(candidates.iter().zip(sums).any(|((_, crc), sum)| *crc == sum))
}

/// What is wrong between two verified records: nothing, if the bytes are whole records that carry no data of their own
/// (indexes, header, summary).
pub fn damage_in(window: &mut Window, mut at: u64, end: u64) -> io::Result<Vec<Damage>> {
    let mut damage = Vec::new();
    while at < end {
        if is_magic(window, at, end)? {
            at += MAGIC.len() as u64;
            continue;
        }
        let head = if end - at >= RECORD_HEAD { window.get(at, RECORD_HEAD as usize)? } else { None };
        let mut cursor = Cursor(head.unwrap_or_default());
        let whole = match (cursor.u8(), cursor.u64()) {
            (Some(opcode @ HEADER..=DATA_END), Some(len)) if len <= end - at - RECORD_HEAD => Some((opcode, len)),
            _ => None,
        };
        let Some((opcode, len)) = whole else {
            let what = "unreadable bytes".to_owned();
            damage.push(Damage { offset: at, bytes: end - at, what });
            break;
        };
        let lost = match opcode {
            CHUNK => Some("chunk whose checksum is absent or disagrees"),
            ATTACHMENT => Some("attachment whose checksum is absent or disagrees"),
            METADATA => Some("metadata whose checksum is absent or disagrees"),
            MESSAGE => Some("message outside a chunk: nothing vouches for it"),
            _ => None,
        };
        let bytes = RECORD_HEAD + len;
        damage.extend(lost.map(|what| Damage { offset: at, bytes, what: what.to_owned() }));
        at += bytes;
    }
    Ok(damage)
}

/// The magic stands at the start and at the end of a file.
fn is_magic(window: &mut Window, at: u64, end: u64) -> io::Result<bool> {
    let place = at == 0 || at + MAGIC.len() as u64 == window.len();
    Ok(place && at + MAGIC.len() as u64 <= end && window.get(at, MAGIC.len())? == Some(MAGIC))
}
