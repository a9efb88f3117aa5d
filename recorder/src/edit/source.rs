//! A log as a stream of records in file order, every checksum verified.
//!
//! Memory is one chunk, whatever the size of the file. The first sign of damage ends the stream: what is edited must be
//! whole, and `recover` is there to make it so.

use super::EditError;
use crate::recover::{Content, Cursor, MAGIC, MAX_RECORD_BYTES, SchemaDefinition, decompress, parse};
use mcap::records::{Record, op};
use mcap::{Attachment, parse_record};
use schemas::{Stamp, metadata, topics};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Opcode and length in front of each record.
const HEAD: usize = 9;

/// A channel as it is defined in its file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Its number in the file.
    pub id: u16,
    /// The topic.
    pub topic: String,
    /// Message type; some encodings need none.
    pub schema: Option<SchemaDefinition>,
    /// Message encoding, `cdr`.
    pub encoding: String,
    /// The channel's own metadata.
    pub metadata: BTreeMap<String, String>,
}

impl Channel {
    /// Name of the message type; empty without one.
    #[must_use]
    pub fn schema_name(&self) -> &str {
        self.schema.as_ref().map_or("", |schema| &schema.name)
    }
}

/// A message as it stands in the file.
#[derive(Debug, Clone)]
pub struct RawMessage<'a> {
    /// Its channel.
    pub channel: Arc<Channel>,
    /// Its number on the channel, as the writer counted.
    pub sequence: u32,
    /// Log time.
    pub log_time: Stamp,
    /// Publish time.
    pub publish_time: Stamp,
    /// Encoded message.
    pub data: Cow<'a, [u8]>,
}

impl RawMessage<'_> {
    /// The topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.channel.topic
    }

    /// The header's stamp; log time for types without a header or unknown to this program.
    ///
    /// # Errors
    /// Bytes that are no header, in words.
    pub fn stamp(&self) -> Result<Stamp, String> {
        use schemas::cdr::{Cdr as _, Reader};
        if self.channel.encoding != "cdr" || !topics::has_header(self.channel.schema_name()) {
            return Ok(self.log_time);
        }
        let header = Reader::new(&self.data).and_then(|mut reader| schemas::msg::Header::read(&mut reader));
        header.map(|header| header.stamp.into()).map_err(|error| error.to_string())
    }

    /// The message, decoded.
    ///
    /// # Errors
    /// Bytes of another type, in words.
    pub fn decode<'m, M: schemas::Message<'m>>(&'m self) -> Result<M, String> {
        let (found, wanted) = (self.channel.schema_name(), M::SCHEMA_NAME);
        if found != wanted || self.channel.encoding != "cdr" {
            return Err(format!("the topic carries {found} in `{}`, wanted {wanted} in `cdr`", self.channel.encoding));
        }
        M::decode(&self.data).map_err(|error| error.to_string())
    }

    /// The same with bytes of its own.
    #[must_use]
    pub fn into_owned(self) -> RawMessage<'static> {
        RawMessage { data: Cow::Owned(self.data.into_owned()), ..self }
    }
}

/// What a log holds, in file order. Indexes and statistics are checked and kept back: a writer makes its own.
#[derive(Debug)]
pub enum Item<'a> {
    /// A channel, once, before its first message.
    Channel(Arc<Channel>),
    /// A message.
    Message(RawMessage<'a>),
    /// A metadata record, its checksum verified if it has one.
    Metadata {
        /// Its name.
        name: String,
        /// Its content, checksum included.
        values: BTreeMap<String, String>,
    },
    /// An attached file.
    Attachment(Attachment<'a>),
}

/// A log that is read from start to end.
pub struct Source {
    path: PathBuf,
    reader: BufReader<File>,
    file_bytes: u64,
    /// Behind the last record that was read.
    offset: u64,
    hash: blake3::Hasher,
    /// Over the data section, then over the summary section.
    section_crc: crc32fast::Hasher,
    /// The record at hand: head and body.
    record: Vec<u8>,
    record_offset: u64,
    /// Schemas, channels and messages at hand: a chunk's content, or one record that stands outside.
    block: Vec<u8>,
    /// Where the next one starts in `block`.
    next_in_block: usize,
    schemas: BTreeMap<u16, SchemaDefinition>,
    channels: BTreeMap<u16, Arc<Channel>>,
    messages: u64,
    /// Messages as the writer counted them.
    claimed_messages: Option<u64>,
    ended: bool,
}

/// What was met, as places in the source's buffers.
enum Step {
    Channel(u16),
    Message { channel: u16, sequence: u32, log_time: Stamp, publish_time: Stamp, data: Range<usize> },
    Metadata(String, BTreeMap<String, String>),
    Attachment,
    End,
}

impl Source {
    /// Opens a log and reads its first record.
    ///
    /// # Errors
    /// The file cannot be read, is no MCAP file or not one of ROS 2 messages.
    pub fn open(path: &Path) -> Result<Self, EditError> {
        let io = |source| EditError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(io)?;
        let about = file.metadata().map_err(io)?;
        if about.is_dir() {
            return Err(EditError::NotALog(path.to_owned()));
        }
        let mut source = Self {
            path: path.to_owned(),
            reader: BufReader::with_capacity(1 << 20, file),
            file_bytes: about.len(),
            offset: 0,
            hash: blake3::Hasher::new(),
            section_crc: crc32fast::Hasher::new(),
            record: Vec::new(),
            record_offset: 0,
            block: Vec::new(),
            next_in_block: 0,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            messages: 0,
            claimed_messages: None,
            ended: false,
        };
        if source.file_bytes < MAGIC.len() as u64 {
            return Err(EditError::NotALog(path.to_owned()));
        }
        source.read(0, MAGIC.len())?;
        if source.record != MAGIC {
            return Err(EditError::NotALog(path.to_owned()));
        }
        source.section_crc.update(MAGIC);
        source.read_record()?;
        source.header()?;
        Ok(source)
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Size of the file, bytes.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Bytes read so far.
    #[must_use]
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// BLAKE3 of what was read so far: of the whole file after the last item.
    #[must_use]
    pub fn blake3(&self) -> String {
        self.hash.finalize().to_hex().to_string()
    }

    /// The next item; none at the end, when every checksum of the file has been verified.
    ///
    /// # Errors
    /// Damage, with its place, or the file system refuses.
    #[expect(clippy::should_implement_trait, reason = "an item borrows from the source")]
    pub fn next(&mut self) -> Result<Option<Item<'_>>, EditError> {
        Ok(Some(match self.step()? {
            Step::End => return Ok(None),
            Step::Channel(id) => Item::Channel(Arc::clone(&self.channels[&id])),
            Step::Metadata(name, values) => Item::Metadata { name, values },
            Step::Attachment => Item::Attachment(attachment(&self.record[HEAD..]).map_err(|why| self.damaged(why))?),
            Step::Message { channel, sequence, log_time, publish_time, data } => Item::Message(RawMessage {
                channel: Arc::clone(&self.channels[&channel]),
                sequence,
                log_time,
                publish_time,
                data: Cow::Borrowed(&self.block[data]),
            }),
        }))
    }

    fn step(&mut self) -> Result<Step, EditError> {
        while !self.ended {
            if self.next_in_block < self.block.len() {
                if let Some(step) = self.step_in_block()? {
                    return Ok(step);
                }
                continue;
            }
            self.read_record()?;
            if let Some(step) = self.step_over_record()? {
                return Ok(step);
            }
        }
        Ok(Step::End)
    }

    /// Takes the record at hand; none if it holds nothing to pass on, or holds it in the block.
    fn step_over_record(&mut self) -> Result<Option<Step>, EditError> {
        let body = &self.record[HEAD..];
        match self.record[0] {
            op::CHUNK => {
                self.block = unpack(body).map_err(|why| self.damaged(why))?;
                self.next_in_block = 0;
            }
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                self.block.clone_from(&self.record);
                self.next_in_block = 0;
            }
            op::METADATA => {
                let mut cursor = Cursor(body);
                let (name, values) = (cursor.text(), cursor.text_map());
                let (Some(name), Some(values)) = (name, values) else { return Err(self.damaged("unreadable")) };
                if metadata::verify(&name, &values) == Some(false) {
                    return Err(self.damaged(format!("metadata {name} does not agree with its checksum")));
                }
                return Ok(Some(Step::Metadata(name, values)));
            }
            op::ATTACHMENT => return Ok(Some(Step::Attachment)),
            op::STATISTICS => self.claimed_messages = Cursor(body).u64(),
            op::DATA_END => self.end_section(0)?,
            op::FOOTER => {
                self.end_section(16)?;
                self.close()?;
            }
            _ => {} // indexes
        }
        Ok(None)
    }

    fn step_in_block(&mut self) -> Result<Option<Step>, EditError> {
        let mut cursor = Cursor(&self.block[self.next_in_block..]);
        let record = cursor.record();
        let end = self.block.len() - cursor.0.len();
        let Some(content) = record.and_then(|(opcode, body)| parse(opcode, body)) else {
            return Err(self.damaged("malformed records inside"));
        };
        self.next_in_block = end;
        Ok(match content {
            Content::Schema(id, schema) => {
                if self.schemas.get(&id).is_some_and(|known| *known != schema) {
                    return Err(self.damaged(format!("schema {id} is {} here and another before", schema.name)));
                }
                self.schemas.insert(id, schema);
                None
            }
            Content::Channel(id, channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned();
                if schema.is_none() && channel.schema_id != 0 {
                    return Err(self.damaged(format!("channel {} names a schema that is not there", channel.topic)));
                }
                let (topic, encoding, metadata) = (channel.topic, channel.message_encoding, channel.metadata);
                let channel = Channel { id, topic, schema, encoding, metadata };
                match self.channels.get(&id) {
                    Some(known) if **known == channel => None,
                    Some(_) => {
                        return Err(self.damaged(format!("channel {id} is {} here, another before", channel.topic)));
                    }
                    None => {
                        self.channels.insert(id, Arc::new(channel));
                        Some(Step::Channel(id))
                    }
                }
            }
            Content::Message(fields, data) => {
                let (sequence, channel, data) = (fields.sequence, fields.channel_id, end - data.len()..end);
                if !self.channels.contains_key(&channel) {
                    return Err(self.damaged(format!("message {sequence} names channel {channel}, which is not there")));
                }
                let time = |ns: u64| i64::try_from(ns).map(Stamp);
                let (Ok(log_time), Ok(publish_time)) = (time(fields.log_time), time(fields.publish_time)) else {
                    return Err(self.damaged(format!("message {sequence} has a time beyond the year 2262")));
                };
                self.messages += 1;
                Some(Step::Message { channel, sequence, log_time, publish_time, data })
            }
            Content::Other => None,
        })
    }

    fn header(&mut self) -> Result<(), EditError> {
        let profile = match parse_record(self.record[0], &self.record[HEAD..]) {
            Ok(Record::Header(header)) => header.profile,
            _ => return Err(self.damaged("is not the header that a log starts with")),
        };
        if profile == "ros2" {
            return Ok(());
        }
        let path = self.path.display();
        Err(EditError::Refused(format!("{path}: profile `{profile}`, only logs of ROS 2 messages (`ros2`) are edited")))
    }

    /// The next record; it is in the section's checksum unless it closes the section.
    fn read_record(&mut self) -> Result<(), EditError> {
        self.record_offset = self.offset;
        let left = self.file_bytes - self.offset;
        if left < HEAD as u64 {
            return Err(EditError::Truncated { path: self.path.clone(), offset: self.offset });
        }
        self.read(0, HEAD)?;
        let length = Cursor(&self.record[1..]).u64().unwrap_or(u64::MAX);
        if length > left - HEAD as u64 {
            return Err(EditError::Truncated { path: self.path.clone(), offset: self.record_offset });
        }
        if length > MAX_RECORD_BYTES {
            return Err(self.damaged(format!("claims {length} bytes, the limit is {MAX_RECORD_BYTES}")));
        }
        self.read(HEAD, length as usize)?;
        let hashed = match self.record[0] {
            op::DATA_END => 0,
            op::FOOTER => self.record.len().min(HEAD + 16),
            _ => self.record.len(),
        };
        self.section_crc.update(&self.record[..hashed]);
        Ok(())
    }

    /// Reads bytes into `record` behind its first `kept`.
    fn read(&mut self, kept: usize, len: usize) -> Result<(), EditError> {
        self.record.resize(kept + len, 0);
        let bytes = &mut self.record[kept..];
        self.reader.read_exact(bytes).map_err(|source| EditError::Io { path: self.path.clone(), source })?;
        self.hash.update(bytes);
        self.offset += len as u64;
        Ok(())
    }

    /// Compares the section's checksum with the one that stands in the record at hand, `at` bytes into its body.
    fn end_section(&mut self, at: usize) -> Result<(), EditError> {
        let found = std::mem::take(&mut self.section_crc).finalize();
        let mut cursor = Cursor(self.record.get(HEAD + at..).unwrap_or_default());
        match cursor.u32() {
            None => Err(self.damaged("too short")),
            // Zero: the writer computed none.
            Some(stored) if stored != 0 && stored != found => {
                Err(self.damaged(format!("the section before has CRC {found:08x}, the writer had {stored:08x}")))
            }
            Some(_) => Ok(()),
        }
    }

    /// Behind the footer: the closing magic, and nothing else.
    fn close(&mut self) -> Result<(), EditError> {
        let (left, footer) = (self.file_bytes - self.offset, self.record.len());
        let whole = left == MAGIC.len() as u64 && {
            self.read(footer, MAGIC.len())?;
            self.record[footer..] == *MAGIC
        };
        if !whole {
            return Err(self.damaged(format!("{left} bytes follow it, wanted the closing magic")));
        }
        if let Some(claimed) = self.claimed_messages.filter(|claimed| *claimed != self.messages) {
            return Err(self.damaged(format!("{} messages were read, the writer counted {claimed}", self.messages)));
        }
        self.ended = true;
        Ok(())
    }

    fn damaged(&self, reason: impl Into<String>) -> EditError {
        let what = match self.record.first() {
            Some(&op::CHUNK) => "chunk",
            Some(&op::METADATA) => "metadata",
            Some(&op::ATTACHMENT) => "attachment",
            Some(&op::DATA_END) => "end of data",
            Some(&op::FOOTER) => "footer",
            _ => "record",
        };
        EditError::Damaged { path: self.path.clone(), what, offset: self.record_offset, reason: reason.into() }
    }
}

/// A chunk's content, its checksum verified.
fn unpack(body: &[u8]) -> Result<Vec<u8>, String> {
    let (header, data) = match parse_record(op::CHUNK, body) {
        Ok(Record::Chunk { header, data }) => (header, data),
        Ok(_) => return Err("is no chunk".to_owned()),
        Err(error) => return Err(error.to_string()),
    };
    if !["", "zstd", "lz4"].contains(&header.compression.as_str()) {
        return Err(format!("compression `{}` is not known (zstd, lz4 or none)", header.compression));
    }
    let content = decompress(&header.compression, &data).ok_or("cannot be unpacked")?;
    let (found, stored) = (crc32fast::hash(&content), header.uncompressed_crc);
    if content.len() as u64 != header.uncompressed_size {
        return Err(format!("unpacks to {} bytes where {} are claimed", content.len(), header.uncompressed_size));
    }
    if stored != 0 && stored != found {
        return Err(format!("CRC is {found:08x}, the writer had {stored:08x}"));
    }
    Ok(content)
}

fn attachment(body: &[u8]) -> Result<Attachment<'_>, String> {
    let (content, stored) = body.split_last_chunk::<4>().ok_or("too short")?;
    let (found, stored) = (crc32fast::hash(content), u32::from_le_bytes(*stored));
    if stored != 0 && stored != found {
        return Err(format!("CRC is {found:08x}, the writer had {stored:08x}"));
    }
    match parse_record(op::ATTACHMENT, body) {
        Ok(Record::Attachment { header, data, .. }) => Ok(Attachment {
            log_time: header.log_time,
            create_time: header.create_time,
            name: header.name,
            media_type: header.media_type,
            data,
        }),
        Ok(_) => Err("is no attachment".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}
