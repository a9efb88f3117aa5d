//! One pass over a log file: every record in file order, every CRC checked.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use mcap::records::{ChunkIndex, Record, SchemaHeader, Statistics, op};
use schemas::Stamp;

use super::LogError;
use super::chunk::{MAX_RECORD_BYTES, RECORD_HEADER_BYTES, inner_record, message, read_u64, unpack};

/// A channel with its schema's name.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    pub topic: String,
    pub schema_name: String,
    pub encoding: String,
    pub metadata: BTreeMap<String, String>,
}

/// Where a message's bytes stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// File offset of the chunk record, or of the message record if it is in no chunk.
    pub record: u64,
    /// Offset of the message record in the unpacked chunk.
    pub inner: Option<usize>,
}

/// A message as it passes.
pub struct MessageEvent<'a> {
    pub channel: &'a Channel,
    pub sequence: u32,
    pub log_time: Stamp,
    pub data: &'a [u8],
    pub place: Place,
}

impl MessageEvent<'_> {
    pub fn error(&self, path: &Path, reason: impl Into<String>) -> LogError {
        let (topic, sequence, stamp) = (self.channel.topic.clone(), self.sequence, self.log_time);
        LogError::Message { path: path.to_owned(), topic, sequence, stamp, reason: reason.into() }
    }
}

/// What a pass meets, in file order.
pub enum Event<'a> {
    Header {
        profile: String,
        library: String,
    },
    Channel(&'a Channel),
    Chunk {
        offset: u64,
    },
    Message(MessageEvent<'a>),
    Metadata {
        name: String,
        values: BTreeMap<String, String>,
    },
    Attachment {
        name: String,
        media_type: String,
        data: &'a [u8],
    },
    Statistics(Statistics),
    ChunkIndex(ChunkIndex),
    /// The pass goes on behind it where it can, if the receiver returns `Ok`.
    Damage(LogError),
}

/// What is known after a pass.
pub struct Passed {
    /// BLAKE3 of the whole file, hexadecimal.
    pub blake3: String,
    /// Size of the file.
    pub file_bytes: u64,
}

type Sink<'s> = &'s mut dyn FnMut(Event<'_>) -> Result<(), LogError>;

/// Reads the file from start to end and hands every record to `sink`; its first error ends the pass.
pub fn scan(path: &Path, sink: Sink<'_>) -> Result<Passed, LogError> {
    let io = |source| LogError::io(path, source);
    let file = File::open(path).map_err(io)?;
    let metadata = file.metadata().map_err(io)?;
    if metadata.is_dir() {
        return Err(LogError::NotALog(path.to_owned()));
    }
    let mut scanner = Scanner {
        path: path.to_owned(),
        reader: BufReader::with_capacity(1 << 20, file),
        file_bytes: metadata.len(),
        offset: 0,
        hash: blake3::Hasher::new(),
        section_crc: crc32fast::Hasher::new(),
        tables: Tables::default(),
    };
    scanner.magic(true)?;
    // An error of the sink comes back to it as damage, and is returned if it insists.
    if let Err(damage) = scanner.records(sink).and_then(|()| scanner.close()) {
        sink(Event::Damage(damage))?;
    }
    scanner.drain()?;
    Ok(Passed { blake3: scanner.hash.finalize().to_hex().to_string(), file_bytes: scanner.file_bytes })
}

struct Scanner {
    path: PathBuf,
    reader: BufReader<File>,
    file_bytes: u64,
    offset: u64,
    hash: blake3::Hasher,
    /// Over the data section, then over the summary section.
    section_crc: crc32fast::Hasher,
    tables: Tables,
}

impl Scanner {
    fn read(&mut self, buffer: &mut [u8]) -> Result<(), LogError> {
        self.reader.read_exact(buffer).map_err(|source| LogError::io(&self.path, source))?;
        self.hash.update(buffer);
        self.offset += buffer.len() as u64;
        Ok(())
    }

    fn left(&self) -> u64 {
        self.file_bytes - self.offset
    }

    fn truncated(&self, offset: u64, what: &'static str) -> LogError {
        LogError::Truncated { path: self.path.clone(), offset, file_bytes: self.file_bytes, what }
    }

    fn magic(&mut self, at_start: bool) -> Result<(), LogError> {
        let mut magic = [0; mcap::MAGIC.len()];
        let offset = self.offset;
        if self.left() < magic.len() as u64 {
            return Err(if at_start {
                LogError::NotALog(self.path.clone())
            } else {
                self.truncated(offset, "inside the closing magic bytes")
            });
        }
        self.read(&mut magic)?;
        self.section_crc.update(&magic);
        match (magic == mcap::MAGIC, at_start) {
            (true, _) => Ok(()),
            (false, true) => Err(LogError::NotALog(self.path.clone())),
            (false, false) => Err(LogError::damaged(&self.path, "closing magic bytes", offset, "wrong bytes")),
        }
    }

    /// All records up to the footer. An error here means that the next record cannot be found.
    fn records(&mut self, sink: Sink<'_>) -> Result<(), LogError> {
        let mut body = Vec::new();
        loop {
            let offset = self.offset;
            let mut head = [0; RECORD_HEADER_BYTES];
            if self.left() < head.len() as u64 {
                let what = if self.left() == 0 { "without its closing records" } else { "inside a record" };
                return Err(self.truncated(offset, what));
            }
            self.read(&mut head)?;
            let (opcode, len) = (head[0], read_u64(&head[1..]));
            if len > self.left() {
                return Err(self.truncated(offset, "inside a record"));
            }
            if len > MAX_RECORD_BYTES {
                let reason = format!("opcode 0x{opcode:02x} claims {len} bytes, the limit is {MAX_RECORD_BYTES}");
                return Err(LogError::damaged(&self.path, "record", offset, reason));
            }
            body.resize(len as usize, 0);
            self.read(&mut body)?;
            match opcode {
                op::DATA_END => {
                    self.section_end("data section", offset, &body)?.map_or(Ok(()), |d| sink(Event::Damage(d)))?;
                }
                op::FOOTER => {
                    self.section_crc.update(&head);
                    self.section_crc.update(body.get(..16).unwrap_or_default());
                    let crc = body.get(16..).unwrap_or_default();
                    self.section_end("summary section", offset, crc)?.map_or(Ok(()), |d| sink(Event::Damage(d)))?;
                    return Ok(());
                }
                _ => {
                    self.section_crc.update(&head);
                    self.section_crc.update(&body);
                    self.record(opcode, offset, &body, sink)?;
                }
            }
        }
    }

    /// Compares the CRC over a section with the stored one; zero means that the writer computed none.
    fn section_end(&mut self, what: &'static str, offset: u64, stored: &[u8]) -> Result<Option<LogError>, LogError> {
        let found = std::mem::take(&mut self.section_crc).finalize();
        let Some(&[a, b, c, d]) = stored.get(..4) else {
            return Err(LogError::damaged(&self.path, what, offset, "its closing record is too short"));
        };
        let stored = u32::from_le_bytes([a, b, c, d]);
        let reason = || format!("CRC is {found:08x}, the writer had {stored:08x}");
        let bad = stored != 0 && stored != found;
        Ok(bad.then(|| LogError::damaged(&self.path, what, offset, reason())))
    }

    fn record(&mut self, opcode: u8, offset: u64, body: &[u8], sink: Sink<'_>) -> Result<(), LogError> {
        let done = match opcode {
            op::CHUNK => self.chunk(offset, body, sink)?,
            op::ATTACHMENT => self.attachment(body, sink)?,
            _ => self.tables.record(opcode, body, Place { record: offset, inner: None }, sink)?,
        };
        done.or_else(|reason| {
            let what = match opcode {
                op::CHUNK => "chunk",
                op::ATTACHMENT => "attachment",
                _ => "record",
            };
            sink(Event::Damage(LogError::damaged(&self.path, what, offset, reason)))
        })
    }

    /// The outer error is the sink's, the inner one damage.
    fn chunk(&mut self, offset: u64, body: &[u8], sink: Sink<'_>) -> Result<Result<(), String>, LogError> {
        sink(Event::Chunk { offset })?;
        let contents = match unpack(body) {
            Ok(contents) => contents,
            Err(reason) => return Ok(Err(reason)),
        };
        let mut inner = 0;
        loop {
            match inner_record(&contents, inner) {
                Ok(None) => return Ok(Ok(())),
                Err(reason) => return Ok(Err(reason)),
                Ok(Some((opcode, body, next))) => {
                    let place = Place { record: offset, inner: Some(inner) };
                    if let Err(reason) = self.tables.record(opcode, body, place, sink)? {
                        return Ok(Err(reason));
                    }
                    inner = next;
                }
            }
        }
    }

    fn attachment(&self, body: &[u8], sink: Sink<'_>) -> Result<Result<(), String>, LogError> {
        let Some((contents, crc)) = body.split_last_chunk::<4>() else { return Ok(Err("too short".to_owned())) };
        let (found, stored) = (crc32fast::hash(contents), u32::from_le_bytes(*crc));
        if stored != 0 && stored != found {
            return Ok(Err(format!("CRC is {found:08x}, the writer had {stored:08x}")));
        }
        match mcap::parse_record(op::ATTACHMENT, body) {
            Ok(Record::Attachment { header, data, .. }) => {
                let (name, media_type) = (header.name, header.media_type);
                sink(Event::Attachment { name, media_type, data: &data }).map(Ok)
            }
            Ok(_) => Ok(Err("not an attachment".to_owned())),
            Err(error) => Ok(Err(error.to_string())),
        }
    }

    /// Closing magic and nothing behind it.
    fn close(&mut self) -> Result<(), LogError> {
        self.magic(false)?;
        match self.left() {
            0 => Ok(()),
            left => Err(LogError::damaged(&self.path, "end", self.offset, format!("{left} bytes follow the log"))),
        }
    }

    /// Takes what damage made unreadable into the hash.
    fn drain(&mut self) -> Result<(), LogError> {
        let mut buffer = vec![0; 1 << 16];
        while self.left() > 0 {
            let len = self.left().min(buffer.len() as u64) as usize;
            self.read(&mut buffer[..len])?;
        }
        Ok(())
    }
}

/// Schemas and channels met so far.
#[derive(Default)]
struct Tables {
    schemas: BTreeMap<u16, SchemaHeader>,
    channels: BTreeMap<u16, Channel>,
}

impl Tables {
    /// A record that may stand in a chunk. The outer error is the sink's, the inner one damage.
    fn record(
        &mut self,
        opcode: u8,
        body: &[u8],
        place: Place,
        sink: Sink<'_>,
    ) -> Result<Result<(), String>, LogError> {
        if opcode == op::MESSAGE {
            return self.message(body, place, sink);
        }
        let known = [op::HEADER, op::SCHEMA, op::CHANNEL, op::METADATA, op::STATISTICS, op::CHUNK_INDEX];
        if !known.contains(&opcode) {
            return Ok(Ok(())); // message indexes and offsets: not needed for reading everything in order
        }
        match mcap::parse_record(opcode, body) {
            Ok(Record::Header(h)) => sink(Event::Header { profile: h.profile, library: h.library }).map(Ok),
            Ok(Record::Metadata(m)) => sink(Event::Metadata { name: m.name, values: m.metadata }).map(Ok),
            Ok(Record::Statistics(statistics)) => sink(Event::Statistics(statistics)).map(Ok),
            Ok(Record::ChunkIndex(index)) => sink(Event::ChunkIndex(index)).map(Ok),
            Ok(Record::Schema { header, .. }) => Ok(self.schema(header)),
            Ok(Record::Channel(channel)) => self.channel(channel, sink),
            Ok(_) => Ok(Ok(())),
            Err(error) => Ok(Err(format!("cannot be read: {error}"))),
        }
    }

    fn schema(&mut self, header: SchemaHeader) -> Result<(), String> {
        match self.schemas.get(&header.id) {
            Some(known) if *known != header => {
                Err(format!("schema {} is `{}` here and `{}` before", header.id, header.name, known.name))
            }
            _ => {
                self.schemas.insert(header.id, header);
                Ok(())
            }
        }
    }

    fn channel(&mut self, record: mcap::records::Channel, sink: Sink<'_>) -> Result<Result<(), String>, LogError> {
        let schema_name = self.schemas.get(&record.schema_id).map(|schema| schema.name.clone());
        let Some(schema_name) = schema_name.or_else(|| (record.schema_id == 0).then(String::new)) else {
            return Ok(Err(format!("channel {} names schema {}, which is not there", record.topic, record.schema_id)));
        };
        let (topic, encoding, metadata) = (record.topic, record.message_encoding, record.metadata);
        let channel = Channel { topic, schema_name, encoding, metadata };
        match self.channels.get(&record.id) {
            Some(known) if *known == channel => Ok(Ok(())),
            Some(known) => {
                Ok(Err(format!("channel {} is {} here and {} before", record.id, channel.topic, known.topic)))
            }
            None => {
                sink(Event::Channel(&channel))?;
                self.channels.insert(record.id, channel);
                Ok(Ok(()))
            }
        }
    }

    fn message(&self, body: &[u8], place: Place, sink: Sink<'_>) -> Result<Result<(), String>, LogError> {
        let (header, data) = match message(body) {
            Ok(parsed) => parsed,
            Err(reason) => return Ok(Err(reason)),
        };
        let Some(channel) = self.channels.get(&header.channel_id) else {
            return Ok(Err(format!(
                "message {} names channel {}, which is not there",
                header.sequence, header.channel_id
            )));
        };
        let Ok(log_time) = i64::try_from(header.log_time) else {
            return Ok(Err(format!(
                "message {} on {} has a time beyond the year 2262",
                header.sequence, channel.topic
            )));
        };
        sink(Event::Message(MessageEvent {
            channel,
            sequence: header.sequence,
            log_time: Stamp(log_time),
            data,
            place,
        }))
        .map(Ok)
    }
}
