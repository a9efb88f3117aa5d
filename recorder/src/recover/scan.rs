//! Finds the records of a damaged file that a checksum vouches for.
//!
//! Every byte outside such records is tried as a start, so no damaged length can hide what follows. A chunk's head has
//! four signs (opcode, length of the compression's name, the name, two lengths that agree); one of them may be damaged,
//! since the CRC of the content decides in the end.

use super::records::Cursor;
use super::window::Window;
use mcap::Attachment;
use schemas::metadata;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::ops::Range;

const ATTACHMENT: u8 = 0x09;
const CHUNK: u8 = 0x06;
const METADATA: u8 = 0x0C;
/// Larger records are not tried: writers keep chunks at a few MiB.
pub const MAX_RECORD_BYTES: u64 = 256 << 20;
const MAX_METADATA_BYTES: u64 = 16 << 20;
/// Opcode and length before every record.
pub const RECORD_HEAD: u64 = 9;
/// Chunk fields before the compression's name: two times, size, CRC.
const CHUNK_HEAD: u64 = 28;
/// Chunk fields in all, without the compression's name and the content.
const CHUNK_FIXED: u64 = CHUNK_HEAD + 4 + 8;
/// Bytes of failed attempts, per byte of the file and at least: a hostile file cannot buy endless work.
const WORK_PER_BYTE: u64 = 64;
const MIN_WORK: u64 = 1 << 30;

/// A record with a valid checksum.
pub enum Found {
    /// Its uncompressed records.
    Chunk(Vec<u8>),
    /// An attached file.
    Attachment(Attachment<'static>),
    /// A table with a valid checksum of its own.
    Metadata {
        /// Its name.
        name: String,
        /// Its content.
        values: BTreeMap<String, String>,
    },
}

/// Walks over a file from verified record to verified record.
pub struct Scanner {
    at: u64,
    work_left: u64,
    gave_up: bool,
}

/// How a chunk at some offset could lie.
struct ChunkLayout {
    crc: u32,
    compression: &'static str,
    content: Range<u64>,
}

impl Scanner {
    /// Starts at the beginning of a file of this size.
    pub fn new(file_bytes: u64) -> Self {
        Self { at: 0, work_left: file_bytes.saturating_mul(WORK_PER_BYTE).max(MIN_WORK), gave_up: false }
    }

    /// Whether attempts cost so much that the rest of the file was not scanned.
    pub fn gave_up(&self) -> bool {
        self.gave_up
    }

    /// The next verified record and the bytes it takes.
    pub fn next(&mut self, window: &mut Window) -> io::Result<Option<(Range<u64>, Found)>> {
        while self.at + RECORD_HEAD <= window.len() {
            if self.work_left == 0 {
                self.gave_up = true;
                return Ok(None);
            }
            let start = self.at;
            let found = match self.chunk(window, start)? {
                Some(found) => Some(found),
                None => self.attachment_or_metadata(window, start)?,
            };
            if let Some((end, found)) = found {
                self.at = end;
                return Ok(Some((start..end, found)));
            }
            self.at += 1;
        }
        Ok(None)
    }

    fn chunk(&mut self, window: &mut Window, start: u64) -> io::Result<Option<(u64, Found)>> {
        for layout in chunk_layouts(window, start)? {
            let Range { start: from, end } = layout.content;
            let Some(bytes) = window.get(from, (end - from) as usize)? else { continue };
            let content = decompress(layout.compression, bytes);
            let cost = (end - from) + content.as_ref().map_or(0, |content| content.len() as u64);
            if let Some(content) = content.filter(|content| crc32fast::hash(content) == layout.crc) {
                return Ok(Some((end, Found::Chunk(content))));
            }
            self.work_left = self.work_left.saturating_sub(cost);
        }
        Ok(None)
    }

    fn attachment_or_metadata(&mut self, window: &mut Window, start: u64) -> io::Result<Option<(u64, Found)>> {
        let Some(head) = window.get(start, RECORD_HEAD as usize)? else { return Ok(None) };
        let mut cursor = Cursor(head);
        let (opcode, len) = (cursor.u8(), cursor.u64());
        let (Some(opcode @ (ATTACHMENT | METADATA)), Some(len)) = (opcode, len) else { return Ok(None) };
        let limit = if opcode == METADATA { MAX_METADATA_BYTES } else { MAX_RECORD_BYTES };
        if len > limit {
            return Ok(None);
        }
        let Some(body) = window.get(start + RECORD_HEAD, len as usize)? else { return Ok(None) };
        let found = if opcode == METADATA { verified_metadata(body) } else { verified_attachment(body) };
        if found.is_none() {
            self.work_left = self.work_left.saturating_sub(len);
        }
        Ok(found.map(|found| (start + RECORD_HEAD + len, found)))
    }
}

/// The layouts that a chunk at `start` could have, by at least three of its four signs.
fn chunk_layouts(window: &mut Window, start: u64) -> io::Result<Vec<ChunkLayout>> {
    let mut layouts = Vec::new();
    for compression in ["zstd", "lz4", ""] {
        let name_bytes = compression.len() as u64;
        let head_bytes = RECORD_HEAD + CHUNK_FIXED + name_bytes;
        let Some(head) = window.get(start, head_bytes as usize)? else { continue };
        let mut cursor = Cursor(head);
        let (Some(opcode), Some(record_len)) = (cursor.u8(), cursor.u64()) else { continue };
        cursor.skip(24);
        let (Some(crc), Some(name_len)) = (cursor.u32(), cursor.u32()) else { continue };
        let name_agrees = cursor.take(compression.len()) == Some(compression.as_bytes());
        let Some(content_len) = cursor.u64() else { continue };
        let lengths_agree = content_len.checked_add(CHUNK_FIXED + name_bytes) == Some(record_len);
        let signs = [opcode == CHUNK, u64::from(name_len) == name_bytes, name_agrees, lengths_agree];
        let enough = signs.iter().filter(|sign| **sign).count() >= 3;
        // Without a name, its comparison says nothing: the lengths have to agree.
        if !enough || (compression.is_empty() && !lengths_agree) || crc == 0 {
            continue;
        }
        let other_len = record_len.checked_sub(CHUNK_FIXED + name_bytes).filter(|len| *len != content_len);
        for len in std::iter::once(content_len).chain(other_len) {
            let from = start + head_bytes;
            if len > 0 && len <= MAX_RECORD_BYTES && from + len <= window.len() {
                layouts.push(ChunkLayout { crc, compression, content: from..from + len });
            }
        }
    }
    Ok(layouts)
}

/// A chunk's content; none if it cannot be unpacked or is larger than [`MAX_RECORD_BYTES`].
pub fn decompress(compression: &str, bytes: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    let read = match compression {
        "zstd" => zstd::Decoder::new(bytes).ok()?.take(MAX_RECORD_BYTES + 1).read_to_end(&mut out),
        "lz4" => lz4::Decoder::new(bytes).ok()?.take(MAX_RECORD_BYTES + 1).read_to_end(&mut out),
        _ => {
            out.extend_from_slice(bytes);
            Ok(out.len())
        }
    };
    read.ok().filter(|len| *len as u64 <= MAX_RECORD_BYTES)?;
    Some(out)
}

/// Times, name, media type, data and a CRC over all of them; a CRC of 0 means none and vouches for nothing.
fn verified_attachment(body: &[u8]) -> Option<Found> {
    let (content, crc) = body.split_last_chunk::<4>()?;
    let crc = u32::from_le_bytes(*crc);
    let mut cursor = Cursor(content);
    let (log_time, create_time) = (cursor.u64()?, cursor.u64()?);
    let (name, media_type) = (cursor.text()?, cursor.text()?);
    let data_len = cursor.u64()?;
    if data_len != cursor.0.len() as u64 || crc == 0 || crc32fast::hash(content) != crc {
        return None;
    }
    let data = Cow::Owned(cursor.0.to_vec());
    Some(Found::Attachment(Attachment { log_time, create_time, name, media_type, data }))
}

fn verified_metadata(body: &[u8]) -> Option<Found> {
    let mut cursor = Cursor(body);
    let name = cursor.text()?;
    let values = cursor.text_map()?;
    (cursor.0.is_empty() && metadata::verify(&name, &values) == Some(true)).then_some(Found::Metadata { name, values })
}
