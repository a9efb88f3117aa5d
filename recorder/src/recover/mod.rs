//! A damaged log to a valid one, without guessing.
//!
//! Only what a checksum vouches for is passed on: a chunk by the CRC of its content, an attachment by its CRC, a metadata
//! record by the checksum that [`schemas::metadata::seal`] gave it. No length, magic or index of the damaged file is
//! trusted: the scan looks at every byte outside verified records for the start of the next one. Everything else is lost
//! and listed. A result counts as complete only if a checksum proves it: that of the whole data section, or the counts
//! in a verified summary.

mod records;
mod report;
mod scan;
mod window;

pub use report::{ChannelReport, Damage, RecoverReport};

use crate::log_writer::{ChannelId, LogOptions, LogWriter, RawSchema, WriteError};
pub use records::SchemaDefinition;
use records::{ChannelDefinition, Summary};
pub(crate) use records::{Content, Cursor, MAGIC, parse};
use scan::Found;
pub(crate) use scan::{MAX_RECORD_BYTES, decompress};
use schemas::metadata;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use window::Window;

/// Why nothing could be recovered at all.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The damaged file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The file system's answer.
        source: io::Error,
    },
    /// Neither the start of an MCAP file nor anything with a valid checksum.
    #[error("{} is no MCAP file: no magic at its start, no intact chunk in {bytes} bytes", path.display())]
    NotALog {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// The log would replace the damaged file.
    #[error("{} is the damaged file itself: write the recovered log elsewhere", .0.display())]
    SameFile(PathBuf),
    /// The recovered log cannot be written.
    #[error("{0}")]
    Write(#[from] WriteError),
}

/// Writes every intact part of `damaged` into a new log at `out`.
///
/// # Errors
/// The damaged file cannot be read or is no log; the new one cannot be written. A lossy recovery is no error: see
/// [`RecoverReport::lossy`].
pub fn recover(damaged: &Path, out: &Path, force: bool) -> Result<RecoverReport, RecoverError> {
    let read_error = |source| RecoverError::Read { path: damaged.to_owned(), source };
    if let (Ok(a), Ok(b)) = (damaged.canonicalize(), out.canonicalize())
        && a == b
    {
        return Err(RecoverError::SameFile(out.to_owned()));
    }
    let mut window = Window::open(damaged).map_err(read_error)?;
    let summary = Summary::read(&mut window).map_err(read_error)?;
    let has_magic = window.get(0, MAGIC.len()).map_err(read_error)? == Some(MAGIC);
    // Not `.partial`: that may be the very file to recover.
    let log = LogWriter::create_as(out, "recovering", &LogOptions { force, ..LogOptions::default() })?;
    let mut copy = Copy::new(log, summary);
    match copy.run(&mut window) {
        Ok(()) => {}
        Err(error) => {
            copy.log.discard();
            return Err(match error {
                CopyError::Read(source) => read_error(source),
                CopyError::Write(error) => error.into(),
            });
        }
    }
    if !has_magic && copy.taken == 0 {
        copy.log.discard();
        return Err(RecoverError::NotALog { path: damaged.to_owned(), bytes: window.len() });
    }
    let data_section_ok = copy.data_section_ok(&mut window).map_err(read_error)?;
    copy.finish(damaged, out, window.len(), data_section_ok)
}

enum CopyError {
    Read(io::Error),
    Write(WriteError),
}

impl From<io::Error> for CopyError {
    fn from(error: io::Error) -> Self {
        Self::Read(error)
    }
}

impl From<WriteError> for CopyError {
    fn from(error: WriteError) -> Self {
        Self::Write(error)
    }
}

/// The copy in progress.
struct Copy {
    log: LogWriter,
    summary: Option<Summary>,
    schemas: BTreeMap<u16, SchemaDefinition>,
    channels: BTreeMap<u16, OpenChannel>,
    reports: BTreeMap<String, ChannelReport>,
    damage: Vec<Damage>,
    /// Verified records taken over: chunks, attachments, metadata.
    taken: u64,
    attachments: u64,
    metadata: u64,
    chunks: u64,
    orphans: BTreeMap<u16, u64>,
    span: Option<(u64, u64)>,
    end_of_verified: u64,
    gave_up: bool,
}

struct OpenChannel {
    id: ChannelId,
    topic: String,
}

impl Copy {
    fn new(log: LogWriter, summary: Option<Summary>) -> Self {
        Self {
            log,
            summary,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            reports: BTreeMap::new(),
            damage: Vec::new(),
            taken: 0,
            attachments: 0,
            metadata: 0,
            chunks: 0,
            orphans: BTreeMap::new(),
            span: None,
            end_of_verified: 0,
            gave_up: false,
        }
    }

    /// Definitions first from the verified summary (their chunk may be lost), then from each chunk and each copy outside
    /// the chunks as it comes.
    fn run(&mut self, window: &mut Window) -> Result<(), CopyError> {
        if let Some(summary) = &mut self.summary {
            self.schemas = std::mem::take(&mut summary.schemas);
            for (id, channel) in std::mem::take(&mut summary.channels) {
                self.define(id, &channel)?;
            }
        }
        let mut scanner = scan::Scanner::new(window.len());
        while let Some((range, found)) = scanner.next(window)? {
            self.damage.extend(records::damage_in(window, self.end_of_verified, range.start)?);
            self.end_of_verified = range.end;
            self.taken += 1;
            match found {
                Found::Chunk(content) => self.chunk(&content, range.start)?,
                Found::Attachment(attachment) => {
                    self.attachments += 1;
                    self.log.attach_raw(&attachment)?;
                }
                Found::Metadata { name, values } => {
                    self.metadata += 1;
                    match records::channel_copy(&name, &values) {
                        Some((id, channel, schema)) => {
                            self.schemas.insert(channel.schema_id, schema);
                            self.define(id, &channel)?;
                        }
                        None => self.log.metadata(&name, values)?,
                    }
                }
            }
        }
        self.gave_up = scanner.gave_up();
        self.damage.extend(records::damage_in(window, self.end_of_verified, window.len())?);
        Ok(())
    }

    /// Copies the messages of a chunk whose CRC agrees.
    fn chunk(&mut self, content: &[u8], offset: u64) -> Result<(), CopyError> {
        self.chunks += 1;
        for record in records::iterate(content) {
            match record {
                Some(Content::Schema(id, schema)) => {
                    self.schemas.insert(id, schema);
                }
                Some(Content::Channel(id, channel)) => self.define(id, &channel)?,
                Some(Content::Message(header, data)) => {
                    let Some(channel) = self.channels.get(&header.channel_id) else {
                        *self.orphans.entry(header.channel_id).or_default() += 1;
                        continue;
                    };
                    self.log.write_raw(channel.id, header.sequence, header.log_time, header.publish_time, data)?;
                    let (first, last) = self.span.unwrap_or((header.log_time, header.log_time));
                    self.span = Some((first.min(header.log_time), last.max(header.log_time)));
                    let report = self.reports.entry(channel.topic.clone()).or_default();
                    report.count(header.sequence, header.log_time);
                }
                Some(Content::Other) => {}
                None => {
                    let what = "chunk with a valid checksum but malformed records".to_owned();
                    self.damage.push(Damage { offset, bytes: content.len() as u64, what });
                }
            }
        }
        Ok(())
    }

    /// Opens a channel in the new log. One whose schema is unknown stays undefined: its messages are counted as lost.
    fn define(&mut self, id: u16, channel: &ChannelDefinition) -> Result<(), WriteError> {
        let schema = match (channel.schema_id, self.schemas.get(&channel.schema_id)) {
            (0, _) => None,
            (_, None) => return Ok(()),
            (_, Some(SchemaDefinition { name, encoding, data })) => Some(RawSchema { name, encoding, data }),
        };
        let opened = self.log.add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata)?;
        self.channels.insert(id, OpenChannel { id: opened, topic: channel.topic.clone() });
        self.reports.entry(channel.topic.clone()).or_default();
        Ok(())
    }

    /// Whether the checksum over the whole data section agrees: then nothing before the summary is damaged.
    fn data_section_ok(&self, window: &mut Window) -> io::Result<bool> {
        let known_end = self.summary.as_ref().map(|summary| summary.data_end);
        records::data_section_ok(window, known_end.unwrap_or(self.end_of_verified))
    }

    fn finish(
        mut self,
        damaged: &Path,
        out: &Path,
        bytes: u64,
        data_section_ok: bool,
    ) -> Result<RecoverReport, RecoverError> {
        let messages: u64 = self.reports.values().map(|report| report.messages).sum();
        let orphaned: u64 = self.orphans.values().sum();
        let mut counts_agree = false;
        if let Some(summary) = &self.summary {
            counts_agree = summary.message_count == messages
                && summary.attachment_count == self.attachments
                && summary.metadata_count == self.metadata;
            for (id, count) in &summary.messages_by_channel {
                let Some(channel) = self.channels.get(id) else { continue };
                let report = self.reports.entry(channel.topic.clone()).or_default();
                report.expected = Some(report.expected.unwrap_or(0) + count);
            }
        }
        let lossy = !(data_section_ok || counts_agree)
            || orphaned > 0
            || self.gave_up
            || self.reports.values().any(ChannelReport::lost_some);
        let mut report = RecoverReport {
            damaged: damaged.to_owned(),
            damaged_bytes: bytes,
            recovered: out.to_owned(),
            recovered_bytes: 0,
            lossy,
            summary_intact: self.summary.is_some(),
            data_section_intact: data_section_ok,
            chunks: self.chunks,
            messages,
            attachments: self.attachments,
            metadata: self.metadata,
            messages_without_channel: orphaned,
            first_stamp: self.span.map(|(first, _)| schemas::Stamp(i64::try_from(first).unwrap_or(i64::MAX))),
            last_stamp: self.span.map(|(_, last)| schemas::Stamp(i64::try_from(last).unwrap_or(i64::MAX))),
            channels: self.reports,
            damage: self.damage,
            gave_up: self.gave_up,
        };
        self.log.metadata(metadata::RECOVERY, report.metadata())?;
        report.recovered_bytes = self.log.finish()?;
        Ok(report)
    }
}
