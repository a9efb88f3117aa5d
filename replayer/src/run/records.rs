//! `records.bin`: what every stage of every frame came to, as digests with readable values, and the chain over them.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `PSLAMREC` |
//! | 4 | version, 1 |
//! | ... | blocks: one header, one a frame, one end |
//!
//! A block is its kind (1 byte: 1 header, 2 frame, 3 end), the length of its payload (4 bytes), the payload and the
//! fingerprint so far (16 bytes): `chain(fingerprint before, xxh3-128(kind, payload))`, 0 before the header. The last
//! one is the run's fingerprint. All numbers are little endian; a text is its length (4 bytes) and UTF-8.
//!
//! | payload | fields |
//! |---|---|
//! | header | texts: program, log's BLAKE3, config (TOML), layer (empty: none); first frame, frame after the last (8 each) |
//! | frame | id (4), stamp in ns (8), count (4), then a field each: stage (1), name (text), xxh3-128 (16), value (text) |
//! | end | frames (4), xxh3-128 of `trajectory.txt` and of `trajectory_online.txt` (16 each) |
//!
//! The file of a saved state has blocks of kind 4 in place of the end, see `run/state.rs`.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write as _};
use std::ops::Range;
use std::path::{Path, PathBuf};

use schemas::Stamp;
use slam::FrameReport;
use slam::report::Stage;
use slam_math::{Digest, DigestWriter};

use super::RunError;

const MAGIC: &[u8; 8] = b"PSLAMREC";
const VERSION: u32 = 1;
/// A frame has some 20 fields of some 50 bytes, a configuration a few kilobytes.
const MAX_PAYLOAD_BYTES: u32 = 1 << 20;

/// Why records cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: io::Error,
    },
    /// Not a records file of a known version.
    #[error("{}: {reason}; replay the log again to get records of this version", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is there instead.
        reason: String,
    },
    /// Changed or cut off after it was written.
    #[error("{}: damaged at byte {offset} ({place}): {reason}; replay the log again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Start of the damaged block.
        offset: u64,
        /// Which block that is.
        place: String,
        /// What is wrong.
        reason: String,
    },
}

/// Everything that decides a run's result: what the fingerprint begins with.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RunHeader {
    /// Name and version of the program.
    pub program: String,
    /// BLAKE3 of the log.
    pub log_blake3: String,
    /// The whole configuration, TOML.
    pub config: String,
    /// Segmentation layer.
    pub layer: Option<String>,
    /// Frames of the log's timeline; the first of them has the id 0 in the run.
    pub frames: Range<usize>,
}

/// What one field of one stage came to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldEntry {
    /// Which stage.
    pub stage: Stage,
    /// Name of the field.
    pub field: String,
    /// Over the field's canonical bytes.
    pub digest: Digest,
    /// The value itself, or a count.
    pub value: String,
}

/// What one frame came to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameEntry {
    /// Id in the run.
    pub frame: u32,
    /// Sensor time.
    pub stamp: Stamp,
    /// In the order of the stages.
    pub fields: Vec<FieldEntry>,
}

impl From<&FrameReport> for FrameEntry {
    fn from(report: &FrameReport) -> Self {
        let fields = report.records.iter().flat_map(|record| {
            record.fields.iter().map(|field| FieldEntry {
                stage: record.stage,
                field: field.name.to_owned(),
                digest: field.digest,
                value: field.value.to_string(),
            })
        });
        Self { frame: report.id.0, stamp: Stamp(report.stamp.0), fields: fields.collect() }
    }
}

/// What the whole run came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunEnd {
    /// Frames replayed.
    pub frames: u32,
    /// Of the bytes of `trajectory.txt`.
    pub trajectory: Digest,
    /// Of the bytes of `trajectory_online.txt`.
    pub online: Digest,
}

/// One block of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Block {
    /// The first.
    Header(RunHeader),
    /// One a frame.
    Frame(FrameEntry),
    /// The last.
    End(RunEnd),
    /// In place of the end: a piece of a saved state.
    State {
        /// Pieces after this one.
        following: u32,
        /// The bytes.
        piece: Vec<u8>,
    },
}

/// xxh3-128 of some bytes.
#[must_use]
pub fn digest_of(bytes: &[u8]) -> Digest {
    let mut writer = DigestWriter::default();
    writer.bytes(bytes);
    writer.finish()
}

/// Turns blocks into the file's bytes and keeps the fingerprint.
#[derive(Debug, Clone, Default)]
pub struct RecordWriter {
    fingerprint: Digest,
}

impl RecordWriter {
    /// The bytes before the first block.
    #[must_use]
    pub fn preamble() -> Vec<u8> {
        [MAGIC.as_slice(), &VERSION.to_le_bytes()].concat()
    }

    /// The bytes of the next block.
    pub fn block(&mut self, block: &Block) -> Vec<u8> {
        let (kind, payload) = encode(block);
        self.fingerprint = link(self.fingerprint, kind, &payload);
        let mut bytes = vec![kind];
        bytes.extend_from_slice(&(payload.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&payload);
        bytes.extend_from_slice(&self.fingerprint.0.to_le_bytes());
        bytes
    }

    /// Over all blocks so far.
    #[must_use]
    pub fn fingerprint(&self) -> Digest {
        self.fingerprint
    }
}

/// A records file in the making.
pub(super) struct RecordFile {
    path: PathBuf,
    file: BufWriter<File>,
    writer: RecordWriter,
}

impl RecordFile {
    /// Begins the file.
    pub fn create(path: PathBuf, header: &RunHeader) -> Result<Self, RecordError> {
        let file = File::create(&path).map_err(|source| RecordError::Io { path: path.clone(), source })?;
        let mut records = Self { path, file: BufWriter::new(file), writer: RecordWriter::default() };
        records.write(&RecordWriter::preamble())?;
        let header = records.writer.block(&Block::Header(header.clone()));
        records.write(&header)?;
        Ok(records)
    }

    /// Adds a block.
    pub fn block(&mut self, block: &Block) -> Result<(), RunError> {
        let bytes = self.writer.block(block);
        Ok(self.write(&bytes)?)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), RecordError> {
        self.file.write_all(bytes).map_err(|source| RecordError::Io { path: self.path.clone(), source })
    }

    /// The path of the file, which holds all blocks so far.
    pub fn flushed(&mut self) -> Result<&Path, RecordError> {
        self.file.flush().map_err(|source| RecordError::Io { path: self.path.clone(), source })?;
        Ok(&self.path)
    }

    /// The fingerprint, when all is on the disk.
    pub fn finish(self) -> Result<String, RecordError> {
        let Self { path, file, writer } = self;
        let file = file.into_inner().map_err(io::IntoInnerError::into_error);
        file.and_then(|file| file.sync_all()).map_err(|source| RecordError::Io { path, source })?;
        Ok(writer.fingerprint().to_string())
    }
}

fn link(before: Digest, kind: u8, payload: &[u8]) -> Digest {
    let mut writer = DigestWriter::default();
    writer.u8(kind);
    writer.bytes(payload);
    before.chain(writer.finish())
}

fn encode(block: &Block) -> (u8, Vec<u8>) {
    let mut out = Vec::new();
    let text = |out: &mut Vec<u8>, text: &str| {
        out.extend_from_slice(&(text.len() as u32).to_le_bytes());
        out.extend_from_slice(text.as_bytes());
    };
    let kind = match block {
        Block::Header(header) => {
            let layer = header.layer.as_deref().unwrap_or_default();
            [&header.program, &header.log_blake3, &header.config, layer].iter().for_each(|t| text(&mut out, t));
            [header.frames.start, header.frames.end].iter().for_each(|v| out.extend((*v as u64).to_le_bytes()));
            1
        }
        Block::Frame(frame) => {
            out.extend(frame.frame.to_le_bytes());
            out.extend(frame.stamp.0.to_le_bytes());
            out.extend((frame.fields.len() as u32).to_le_bytes());
            for FieldEntry { stage, field, digest, value } in &frame.fields {
                out.push(*stage as u8);
                text(&mut out, field);
                out.extend(digest.0.to_le_bytes());
                text(&mut out, value);
            }
            2
        }
        Block::End(end) => {
            out.extend(end.frames.to_le_bytes());
            out.extend(end.trajectory.0.to_le_bytes());
            out.extend(end.online.0.to_le_bytes());
            3
        }
        Block::State { following, piece } => {
            out.extend(following.to_le_bytes());
            out.extend_from_slice(piece);
            4
        }
    };
    (kind, out)
}

/// Reads a records file block by block and checks the chain.
#[derive(Debug)]
pub struct RecordReader {
    path: PathBuf,
    file: BufReader<File>,
    offset: u64,
    blocks: u64,
    fingerprint: Digest,
    header: RunHeader,
    /// Whether the file ends with a state.
    with_state: bool,
    ended: bool,
}

impl RecordReader {
    /// Opens the file and reads its header.
    ///
    /// # Errors
    /// No records file, or damage before the first frame.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        Self::open_as(path, false)
    }

    /// The same for a file that ends with a state.
    pub(super) fn open_state(path: &Path) -> Result<Self, RecordError> {
        Self::open_as(path, true)
    }

    fn open_as(path: &Path, with_state: bool) -> Result<Self, RecordError> {
        let io = |source| RecordError::Io { path: path.to_owned(), source };
        let format = |reason: String| RecordError::Format { path: path.to_owned(), reason };
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let mut preamble = Vec::new();
        (&mut file).take(12).read_to_end(&mut preamble).map_err(io)?;
        let Some(version) = preamble.strip_prefix(MAGIC).and_then(|v| v.try_into().ok()).map(u32::from_le_bytes) else {
            return Err(format(format!("no records file, it starts with {preamble:02x?}")));
        };
        if version != VERSION {
            return Err(format(format!("records of version {version}, this program reads version {VERSION}")));
        }
        let mut reader = Self {
            path: path.to_owned(),
            file,
            offset: 12,
            blocks: 0,
            fingerprint: Digest::default(),
            header: RunHeader {
                program: String::new(),
                log_blake3: String::new(),
                config: String::new(),
                layer: None,
                frames: 0..0,
            },
            with_state,
            ended: false,
        };
        match reader.block()? {
            Block::Header(header) => reader.header = header,
            _ => return Err(reader.damaged("the first block is not the header")),
        }
        Ok(reader)
    }

    /// What was run.
    #[must_use]
    pub fn header(&self) -> &RunHeader {
        &self.header
    }

    /// Over all blocks read so far.
    #[must_use]
    pub fn fingerprint(&self) -> Digest {
        self.fingerprint
    }

    /// The next frame, or the end; nothing after the end.
    ///
    /// # Errors
    /// Damage: a wrong chain, a cut, a frame out of order.
    pub fn next_block(&mut self) -> Result<Option<Block>, RecordError> {
        if self.ended {
            return Ok(None);
        }
        let due = self.blocks - 1;
        let block = self.block()?;
        match &block {
            Block::Header(_) => return Err(self.damaged("a second header")),
            Block::Frame(frame) if u64::from(frame.frame) != due => {
                return Err(self.damaged(format!("frame {} where {due} is due", frame.frame)));
            }
            Block::End(end) if u64::from(end.frames) != due => {
                return Err(self.damaged(format!("{} frames announced, {due} are there", end.frames)));
            }
            Block::State { .. } if !self.with_state => {
                return Err(self.format("it is a saved state: `pslam replay --resume` takes it"));
            }
            Block::End(_) if self.with_state => return Err(self.format("it is the record of a run, not a saved state")),
            Block::Frame(_) | Block::State { following: 1.., .. } => {}
            Block::End(_) | Block::State { following: 0, .. } => {
                self.ended = true;
                let io = |source| RecordError::Io { path: self.path.clone(), source };
                if self.file.read(&mut [0]).map_err(io)? > 0 {
                    return Err(self.damaged("bytes after the end"));
                }
            }
        }
        Ok(Some(block))
    }

    fn format(&self, reason: &str) -> RecordError {
        RecordError::Format { path: self.path.clone(), reason: reason.to_owned() }
    }

    fn block(&mut self) -> Result<Block, RecordError> {
        let head = self.bytes(5)?;
        let (kind, len) = (head[0], u32::from_le_bytes([head[1], head[2], head[3], head[4]]));
        if !(1..=4).contains(&kind) || len > MAX_PAYLOAD_BYTES {
            return Err(self.damaged(format!("block of kind {kind} with {len} bytes")));
        }
        let payload = self.bytes(len as usize)?;
        let written = self.bytes(16)?;
        let fingerprint = link(self.fingerprint, kind, &payload);
        if written != fingerprint.0.to_le_bytes() {
            return Err(self.damaged("the chained fingerprint is wrong"));
        }
        let block = decode(kind, &payload).ok_or_else(|| self.damaged("the content breaks the format's rules"))?;
        self.fingerprint = fingerprint;
        self.offset += 5 + u64::from(len) + 16;
        self.blocks += 1;
        Ok(block)
    }

    fn bytes(&mut self, len: usize) -> Result<Vec<u8>, RecordError> {
        let mut bytes = Vec::new();
        let read = (&mut self.file).take(len as u64).read_to_end(&mut bytes);
        match read {
            Err(source) => Err(RecordError::Io { path: self.path.clone(), source }),
            Ok(read) if read < len => Err(self.damaged("cut off")),
            Ok(_) => Ok(bytes),
        }
    }

    fn damaged(&self, reason: impl Into<String>) -> RecordError {
        let place = match self.blocks {
            0 => "header".to_owned(),
            n => format!("frame {} or the end", n - 1),
        };
        RecordError::Damaged { path: self.path.clone(), offset: self.offset, place, reason: reason.into() }
    }
}

/// `None` for a payload that breaks the rules.
fn decode(kind: u8, payload: &[u8]) -> Option<Block> {
    let mut rest = Rest(payload);
    let block = match kind {
        1 => Block::Header(RunHeader {
            program: rest.text()?,
            log_blake3: rest.text()?,
            config: rest.text()?,
            layer: Some(rest.text()?).filter(|layer| !layer.is_empty()),
            frames: usize::try_from(rest.u64()?).ok()?..usize::try_from(rest.u64()?).ok()?,
        }),
        2 => {
            let (frame, stamp, count) = (rest.u32()?, Stamp(rest.u64()? as i64), rest.u32()?);
            let field = |_| {
                let stage = *Stage::ALL.get(usize::from(rest.take::<1>()?[0]))?;
                Some(FieldEntry { stage, field: rest.text()?, digest: rest.digest()?, value: rest.text()? })
            };
            Block::Frame(FrameEntry { frame, stamp, fields: (0..count).map(field).collect::<Option<_>>()? })
        }
        3 => Block::End(RunEnd { frames: rest.u32()?, trajectory: rest.digest()?, online: rest.digest()? }),
        4 => Block::State { following: rest.u32()?, piece: std::mem::take(&mut rest.0).to_vec() },
        _ => return None,
    };
    rest.0.is_empty().then_some(block)
}

struct Rest<'a>(&'a [u8]);

impl Rest<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn digest(&mut self) -> Option<Digest> {
        self.take().map(|bytes| Digest(u128::from_le_bytes(bytes)))
    }

    fn text(&mut self) -> Option<String> {
        let len = self.u32()? as usize;
        let (head, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        std::str::from_utf8(head).ok().map(str::to_owned)
    }
}
