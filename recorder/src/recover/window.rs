//! Reads a file of any size through a buffer that moves along.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes read at once.
const READ_BYTES: usize = 4 << 20;

/// A file seen through a moving buffer.
pub struct Window {
    file: File,
    len: u64,
    start: u64,
    buffer: Vec<u8>,
}

impl Window {
    /// Opens a file.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let len = file.metadata()?.len();
        Ok(Self { file, len, start: 0, buffer: Vec::new() })
    }

    /// Size of the file.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Bytes at an offset; none if the file ends before.
    pub fn get(&mut self, offset: u64, len: usize) -> io::Result<Option<&[u8]>> {
        if offset.checked_add(len as u64).is_none_or(|end| end > self.len) {
            return Ok(None);
        }
        let inside = offset >= self.start && offset + len as u64 <= self.start + self.buffer.len() as u64;
        if !inside {
            let wanted = (len.max(READ_BYTES) as u64).min(self.len - offset);
            self.buffer.resize(wanted as usize, 0);
            self.file.seek(SeekFrom::Start(offset))?;
            self.file.read_exact(&mut self.buffer)?;
            self.start = offset;
        }
        let at = (offset - self.start) as usize;
        Ok(self.buffer.get(at..at + len))
    }

    /// CRC-32 of the bytes from `start` to each of the ends, which ascend.
    pub fn crcs(&mut self, start: u64, ends: &[u64]) -> io::Result<Vec<u32>> {
        let mut hasher = crc32fast::Hasher::new();
        let mut at = start;
        let mut sums = Vec::with_capacity(ends.len());
        for end in ends {
            while at < *end {
                let len = (*end - at).min(READ_BYTES as u64) as usize;
                let Some(bytes) = self.get(at, len)? else { return Ok(sums) };
                hasher.update(bytes);
                at += len as u64;
            }
            sums.push(hasher.clone().finalize());
        }
        Ok(sums)
    }
}
