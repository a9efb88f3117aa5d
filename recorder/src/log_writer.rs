//! One log file. Bytes depend on the calls alone: every option of the container is pinned here.

mod chunks;
mod target;

use chunks::{CHUNK_BYTES, Chunks, MAX_CHUNK_BYTES};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, WriteOptions, Writer};
use schemas::{Message, Stamp, metadata, topics};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use target::Target;

/// Fixed, so that the same content gives the same bytes whatever the version of the container library.
const LIBRARY: &str = "panoptic-slam";
/// The fastest usual level: depth images at level 9 are a fifth smaller and take six times as long.
const COMPRESSION_LEVEL: u32 = 1;

/// An error with its causes: the container library calls every refusal of the disk an "I/O error".
fn in_full(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = error.source();
    }
    text
}

/// How to write a log.
#[derive(Debug, Clone)]
pub struct LogOptions {
    /// Replace an existing file.
    pub force: bool,
    /// Longest stretch of log time that a crash may lose, see [`LogWriter::flush_if_due`]; nanoseconds.
    pub flush_interval_ns: u64,
    /// Whether chunks are compressed (zstd); without, a recorder saves the time and pays in bytes.
    pub compress: bool,
    /// zstd's level for chunks, 1 (fast) to 22 (small).
    pub compression_level: u32,
    /// Whether chunks grow with the log, so that its index stays small however long it becomes; without, all have a megabyte.
    pub growing_chunks: bool,
    /// Space that the file owns ahead of its end, bytes, so that a full disk leaves room to close it; 0 = none. See
    /// [`LogWriter::is_disk_full`].
    pub ahead_bytes: u64,
}

impl Default for LogOptions {
    fn default() -> Self {
        Self {
            force: false,
            flush_interval_ns: 1_000_000_000,
            compress: true,
            compression_level: COMPRESSION_LEVEL,
            growing_chunks: false,
            ahead_bytes: 0,
        }
    }
}

/// Why a log cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Something stands at the target already.
    #[error("{} exists already: choose another name or ask to overwrite it", .0.display())]
    Exists(PathBuf),
    /// An earlier writer did not finish.
    #[error("{} is what an interrupted writer left: recover it, or ask to overwrite it", .0.display())]
    Unfinished(PathBuf),
    /// The file system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: io::Error,
    },
    /// The container library refuses.
    #[error("{}: {}", path.display(), in_full(source))]
    Container {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: mcap::McapError,
    },
    /// A message older than the one before it.
    #[error("message on {topic} at {stamp} s comes after one at {last} s: logs are written in order of time")]
    OutOfOrder {
        /// Topic of the message.
        topic: String,
        /// Its stamp.
        stamp: Stamp,
        /// Stamp of the message before it.
        last: Stamp,
    },
    /// A stamp that log or ROS time cannot hold.
    #[error("{0}")]
    Stamp(#[from] schemas::StampError),
    /// A message type other than the one that the topic carries.
    #[error("topic {topic} carries {wanted}, not {found}")]
    Type {
        /// The topic.
        topic: String,
        /// Type that it carries.
        wanted: &'static str,
        /// Type of the message.
        found: &'static str,
    },
    /// Pixels that do not fit the camera.
    #[error("{what} at {stamp} s has {found} pixels, the camera has {width}x{height}")]
    Pixels {
        /// Which image.
        what: &'static str,
        /// Its stamp.
        stamp: Stamp,
        /// Its pixel count.
        found: usize,
        /// Columns of the camera.
        width: u32,
        /// Rows of the camera.
        height: u32,
    },
    /// A specification that contradicts the conventions.
    #[error("{0}")]
    Invalid(String),
}

/// A channel of an open log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelId(u16);

/// An open log. Until [`LogWriter::finish`] it stands under `NAME.partial`; what was flushed survives a crash there.
pub struct LogWriter {
    writer: Writer<NoSeek<BufWriter<Target>>>,
    target: Target,
    path: PathBuf,
    partial: PathBuf,
    /// By topic: its channel and message type.
    channels: BTreeMap<String, (ChannelId, &'static str)>,
    /// Channels whose second definition is written.
    announced: BTreeSet<ChannelId>,
    next_sequence: BTreeMap<ChannelId, u32>,
    last_stamp: Option<Stamp>,
    last_flush: Option<Stamp>,
    flush_interval_ns: u64,
    /// Sizes of growing chunks.
    chunks: Option<Chunks>,
}

const PARTIAL: &str = "partial";

fn unfinished(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{suffix}"));
    PathBuf::from(name)
}

impl LogWriter {
    /// Starts a log that will stand at `path`.
    ///
    /// # Errors
    /// Something stands there (and `force` is off), or the file system refuses.
    pub fn create(path: &Path, options: &LogOptions) -> Result<Self, WriteError> {
        Self::create_as(path, PARTIAL, options)
    }

    /// Where a log stands until it is finished.
    pub(crate) fn partial_of(path: &Path) -> PathBuf {
        unfinished(path, PARTIAL)
    }

    /// As [`LogWriter::create`] with another suffix than `partial` for the unfinished file.
    pub(crate) fn create_as(path: &Path, suffix: &str, options: &LogOptions) -> Result<Self, WriteError> {
        let partial = unfinished(path, suffix);
        if !options.force {
            if path.exists() {
                return Err(WriteError::Exists(path.to_owned()));
            }
            if partial.exists() {
                return Err(WriteError::Unfinished(partial));
            }
        }
        let io_error = |source| WriteError::Io { path: partial.clone(), source };
        let file = File::create(&partial).map_err(io_error)?;
        let target = Target::new(file, options.ahead_bytes);
        let writer = WriteOptions::new()
            .profile("ros2")
            .library(LIBRARY)
            .compression(options.compress.then_some(Compression::Zstd))
            .compression_level(options.compression_level)
            .compression_threads(0)
            .chunk_size(Some(if options.growing_chunks { MAX_CHUNK_BYTES } else { CHUNK_BYTES }))
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(target.clone())))
            .map_err(|source| WriteError::Container { path: partial.clone(), source })?;
        Ok(Self {
            writer,
            target,
            path: path.to_owned(),
            partial,
            channels: BTreeMap::new(),
            announced: BTreeSet::new(),
            next_sequence: BTreeMap::new(),
            last_stamp: None,
            last_flush: None,
            flush_interval_ns: options.flush_interval_ns,
            chunks: options.growing_chunks.then(Chunks::default),
        })
    }

    /// Opens a topic with metadata of its own, before the first message on it.
    ///
    /// # Errors
    /// The topic carries another type (by [`topics::schema_name`], or since it was opened), or the file system refuses.
    pub fn open_topic<'a, M: Message<'a>>(
        &mut self,
        topic: &str,
        mut extra: BTreeMap<String, String>,
    ) -> Result<ChannelId, WriteError> {
        let open = self.channels.get(topic).copied();
        let wanted = open.map(|(_, schema)| schema).or_else(|| topics::schema_name(topic)).unwrap_or(M::SCHEMA_NAME);
        if wanted != M::SCHEMA_NAME {
            return Err(WriteError::Type { topic: topic.to_owned(), wanted, found: M::SCHEMA_NAME });
        }
        if let Some((id, _)) = open {
            return Ok(id);
        }
        extra.insert("offered_qos_profiles".to_owned(), String::new());
        let text = M::schema_text();
        let schema = RawSchema { name: M::SCHEMA_NAME, encoding: "ros2msg", data: text.as_bytes() };
        let id = self.add_channel(Some(schema), topic, "cdr", &extra)?;
        self.channels.insert(topic.to_owned(), (id, M::SCHEMA_NAME));
        Ok(id)
    }

    /// Appends a message; its log time and publish time are `stamp`.
    ///
    /// # Errors
    /// A stamp before the last message's or below zero, a wrong type for the topic, or the file system refuses.
    pub fn write<'a, M: Message<'a>>(&mut self, topic: &str, stamp: Stamp, message: &M) -> Result<(), WriteError> {
        if let Some(last) = self.last_stamp.filter(|last| stamp < *last) {
            return Err(WriteError::OutOfOrder { topic: topic.to_owned(), stamp, last });
        }
        let channel = self.open_topic::<M>(topic, BTreeMap::new())?;
        self.append(channel, stamp, stamp, &message.encode())?;
        self.last_stamp = Some(stamp);
        Ok(())
    }

    /// Appends an encoded message with any log time: a live recorder's messages come in order of arrival. The caller
    /// vouches that `data` is a message of the type that `channel` was opened with.
    ///
    /// # Errors
    /// A time below zero, or the file system refuses.
    pub fn append(
        &mut self,
        channel: ChannelId,
        log_time: Stamp,
        publish_time: Stamp,
        data: &[u8],
    ) -> Result<(), WriteError> {
        let time = |stamp: Stamp| u64::try_from(stamp.0).map_err(|_| schemas::StampError::NotRosTime(stamp.0));
        let (log_time, publish_time) = (time(log_time)?, time(publish_time)?);
        let sequence = self.next_sequence(channel);
        self.write_raw(channel, sequence, log_time, publish_time, data)
    }

    /// The number of the next message on a channel, from 0; counts on.
    pub(crate) fn next_sequence(&mut self, channel: ChannelId) -> u32 {
        let next = self.next_sequence.entry(channel).or_insert(0);
        let sequence = *next;
        *next = sequence.wrapping_add(1);
        sequence
    }

    /// Closes the chunk and brings it to the disk if `now` is a flush interval after the last time. Importers pass the
    /// stamp of the message they write; a live recorder passes its clock's.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn flush_if_due(&mut self, now: Stamp) -> Result<(), WriteError> {
        let last = *self.last_flush.get_or_insert(now);
        if now.abs_diff(last) >= self.flush_interval_ns {
            self.last_flush = Some(now);
            self.flush()?;
        }
        Ok(())
    }

    /// Closes the chunk and brings everything written so far to the disk.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.close_chunk()?;
        self.target.file().sync_data().map_err(|source| WriteError::Io { path: self.partial.clone(), source })
    }

    /// Closes the chunk and hands everything to the operating system: it survives this process, though not a power cut.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn close_chunk(&mut self) -> Result<(), WriteError> {
        self.chunks.iter_mut().for_each(Chunks::close);
        self.writer.flush().map_err(|source| self.container_error(source))
    }

    /// Another handle of the file, for a thread that brings it to the disk.
    ///
    /// # Errors
    /// The system has no more handles.
    pub fn file(&self) -> Result<File, WriteError> {
        self.target.file().try_clone().map_err(|source| WriteError::Io { path: self.partial.clone(), source })
    }

    /// Bytes in the file so far. Grows when a chunk is closed.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.target.bytes()
    }

    /// Whether the file could not own more space ahead, see [`LogOptions::ahead_bytes`]: what is left is enough to close
    /// the log, so that should be done now.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        self.target.is_disk_full()
    }

    /// The unfinished file.
    #[must_use]
    pub fn partial(&self) -> &Path {
        &self.partial
    }

    /// Appends a metadata record with its checksum ([`metadata::seal`]). Closes the current chunk.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn metadata(&mut self, name: &str, values: BTreeMap<String, String>) -> Result<(), WriteError> {
        self.metadata_as_is(name, metadata::seal(name, values))
    }

    /// The same with whatever checksum the record has, or none: another program's record stays as it is.
    pub(crate) fn metadata_as_is(&mut self, name: &str, values: BTreeMap<String, String>) -> Result<(), WriteError> {
        let record = Metadata { name: name.to_owned(), metadata: values };
        self.chunks.iter_mut().for_each(Chunks::close);
        self.writer.write_metadata(&record).map_err(|source| self.container_error(source))
    }

    /// Appends a file. `stamp` is its time in the container (the log's own time, never the wall clock's).
    ///
    /// # Errors
    /// The file system refuses.
    pub fn attach(&mut self, name: &str, media_type: &str, stamp: Stamp, data: &[u8]) -> Result<(), WriteError> {
        let time = u64::try_from(stamp.0).map_err(|_| schemas::StampError::NotRosTime(stamp.0))?;
        let (name, media_type) = (name.to_owned(), media_type.to_owned());
        self.attach_raw(&Attachment { log_time: time, create_time: time, name, media_type, data: Cow::Borrowed(data) })
    }

    pub(crate) fn attach_raw(&mut self, attachment: &Attachment<'_>) -> Result<(), WriteError> {
        self.writer.attach(attachment).map_err(|source| self.container_error(source))
    }

    /// Closes the log: writes the index, brings all to the disk, gives the file its name. Returns its size in bytes.
    ///
    /// # Errors
    /// The file system refuses; the `.partial` file then stays for `recover`.
    pub fn finish(self) -> Result<u64, WriteError> {
        self.finish_if(|_| Ok(()))
    }

    /// The same for a log that gets its name, and takes an older one's place, only if `check` of the whole file, still under
    /// its other name, has nothing to say against it.
    ///
    /// # Errors
    /// The file system refuses, or what `check` says; the `.partial` file then stays.
    pub(crate) fn finish_if<E: From<WriteError>>(self, check: impl FnOnce(&Path) -> Result<(), E>) -> Result<u64, E> {
        let Self { mut writer, target, path, partial, .. } = self;
        let io_error = |source| WriteError::Io { path: partial.clone(), source };
        writer.finish().map_err(|source| WriteError::Container { path: partial.clone(), source })?;
        writer.into_inner().into_inner().flush().map_err(io_error)?;
        let bytes = target.close().map_err(io_error)?;
        check(&partial)?;
        fs::rename(&partial, &path).map_err(io_error)?;
        Ok(bytes)
    }

    /// Gives up: removes the unfinished file. For importers, whose source still stands.
    pub fn discard(self) {
        let partial = self.partial.clone();
        drop(self);
        // The file may be gone already; nothing else depends on it.
        let _ = fs::remove_file(partial);
    }

    /// Opens a channel with any definition; the same definition again gives the same channel. A second copy of the
    /// definition goes outside the chunks ([`metadata::CHANNEL_PREFIX`]), as far as it is text.
    pub(crate) fn add_channel(
        &mut self,
        schema: Option<RawSchema<'_>>,
        topic: &str,
        encoding: &str,
        values: &BTreeMap<String, String>,
    ) -> Result<ChannelId, WriteError> {
        let schema_id = match schema {
            Some(RawSchema { name, encoding, data }) => self.writer.add_schema(name, encoding, data),
            None => Ok(0),
        };
        let schema_id = schema_id.map_err(|source| self.container_error(source))?;
        let id = self.writer.add_channel(schema_id, topic, encoding, values);
        let id = ChannelId(id.map_err(|source| self.container_error(source))?);
        let text = schema.and_then(|schema| Some((schema, std::str::from_utf8(schema.data).ok()?)));
        if let Some((schema, text)) = text.filter(|_| self.announced.insert(id)) {
            use metadata::channel as key;
            let own = values.iter().map(|(name, value)| (format!("{}{name}", key::METADATA_PREFIX), value.clone()));
            let mut record: BTreeMap<String, String> = own.collect();
            let (channel_id, schema_id) = (id.0.to_string(), schema_id.to_string());
            for (name, value) in [
                (key::ID, channel_id.as_str()),
                (key::TOPIC, topic),
                (key::ENCODING, encoding),
                (key::SCHEMA_ID, &schema_id),
                (key::SCHEMA_NAME, schema.name),
                (key::SCHEMA_ENCODING, schema.encoding),
                (key::SCHEMA_TEXT, text),
            ] {
                record.insert(name.to_owned(), value.to_owned());
            }
            self.metadata(&format!("{}{topic}", metadata::CHANNEL_PREFIX), record)?;
        }
        Ok(id)
    }

    pub(crate) fn write_raw(
        &mut self,
        channel: ChannelId,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        data: &[u8],
    ) -> Result<(), WriteError> {
        if self.chunks.as_ref().is_some_and(Chunks::is_full) {
            self.close_chunk()?;
        }
        self.chunks.iter_mut().for_each(|chunks| chunks.add(data.len()));
        let header = MessageHeader { channel_id: channel.0, sequence, log_time, publish_time };
        self.writer.write_to_known_channel(&header, data).map_err(|source| self.container_error(source))
    }

    fn container_error(&self, source: mcap::McapError) -> WriteError {
        WriteError::Container { path: self.partial.clone(), source }
    }
}

/// A schema as it stands in a file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RawSchema<'a> {
    pub name: &'a str,
    pub encoding: &'a str,
    pub data: &'a [u8],
}
