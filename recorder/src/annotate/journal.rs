//! Finished labels beside the log in the making: `OUT.labels`. An interrupted run loses the pictures in work, no more.
//!
//! After the head (magic and a digest of what was asked for) one record a picture: payload length, CRC-32, payload; integers
//! are little endian. A record that is cut off or damaged ends the journal.

use super::AnnotateError;
use schemas::Stamp;
use schemas::msg::Segment;
use segment::Mask;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"pslamLB1";
const HEAD: u64 = 8 + 32;
/// No mask needs more: 16384 x 16384 pixels in runs of one.
const MAX_PAYLOAD: u32 = 1 << 31;

/// The labels of one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    pub stamp: Stamp,
    /// BLAKE3 of the picture's message.
    pub picture: [u8; 32],
    /// Columns and rows.
    pub size: (u32, u32),
    /// None: nobody labelled it.
    pub mask: Option<Mask>,
}

impl Entry {
    /// Whether it was made from this picture.
    pub fn is_of(&self, stamp: Stamp, picture: &[u8; 32]) -> bool {
        self.stamp == stamp && self.picture == *picture
    }

    fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        out.extend(self.stamp.0.to_le_bytes());
        out.extend(self.picture);
        out.extend(self.size.0.to_le_bytes());
        out.extend(self.size.1.to_le_bytes());
        let Some(mask) = &self.mask else { return out };
        out.extend((mask.segments.len() as u32).to_le_bytes());
        for s in &mask.segments {
            out.extend(s.id.to_le_bytes());
            out.extend(s.category_id.to_le_bytes());
            out.extend(s.score.to_le_bytes());
            [s.x, s.y, s.width, s.height, s.area, u32::from(s.is_crowd)]
                .iter()
                .for_each(|v| out.extend(v.to_le_bytes()));
        }
        for run in mask.instance.chunk_by(|a, b| a == b) {
            out.extend((run.len() as u32).to_le_bytes());
            out.extend(run[0].to_le_bytes());
        }
        out
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        let mut rest = bytes;
        let stamp = Stamp(i64::from_le_bytes(take(&mut rest)?));
        let picture = take(&mut rest)?;
        let size = (u32::from_le_bytes(take(&mut rest)?), u32::from_le_bytes(take(&mut rest)?));
        if rest.is_empty() {
            return Some(Self { stamp, picture, size, mask: None });
        }
        let count = u32::from_le_bytes(take(&mut rest)?);
        let mut segments = Vec::new();
        for _ in 0..count {
            let (id, category_id) = (u16::from_le_bytes(take(&mut rest)?), u16::from_le_bytes(take(&mut rest)?));
            let score = f32::from_le_bytes(take(&mut rest)?);
            let mut number = || Some(u32::from_le_bytes(take(&mut rest)?));
            let [x, y, width, height, area, crowd] = [number()?, number()?, number()?, number()?, number()?, number()?];
            segments.push(Segment { id, category_id, score, x, y, width, height, area, is_crowd: crowd != 0 });
        }
        let pixels = u64::from(size.0) * u64::from(size.1);
        let mut mask = Mask { class: Vec::new(), instance: Vec::new(), segments };
        while !rest.is_empty() {
            let (count, id) = (u32::from_le_bytes(take(&mut rest)?), u16::from_le_bytes(take(&mut rest)?));
            if mask.instance.len() as u64 + u64::from(count) > pixels {
                return None;
            }
            let class = mask.segment(id).map_or(0, |segment| segment.category_id);
            mask.instance.resize(mask.instance.len() + count as usize, id);
            mask.class.resize(mask.instance.len(), class);
        }
        (mask.instance.len() as u64 == pixels).then_some(Self { stamp, picture, size, mask: Some(mask) })
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

/// The file of finished labels.
pub struct Journal {
    path: PathBuf,
    file: File,
    reader: Reader,
    /// End of the last entry that holds.
    end: u64,
}

impl Journal {
    /// Where the journal of a log in the making stands.
    pub fn path_of(out: &Path) -> PathBuf {
        let mut name = out.as_os_str().to_owned();
        name.push(".labels");
        PathBuf::from(name)
    }

    /// Opens the journal of a log in the making; one that was started for something else starts anew. A file that is no
    /// journal is refused.
    pub fn open(out: &Path, request: &[u8; 32]) -> Result<Self, AnnotateError> {
        let path = Self::path_of(out);
        let at = |source| AnnotateError::Journal { path: path.clone(), source };
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(at)?;
        let mut head = Vec::new();
        (&file).take(HEAD).read_to_end(&mut head).map_err(at)?;
        if !head.iter().zip(MAGIC).all(|(a, b)| a == b) {
            return Err(at(io::Error::other(
                "stands where labels are kept meanwhile and is none of them: move it away",
            )));
        }
        let wanted = [MAGIC.as_slice(), request].concat();
        if head != wanted {
            file.set_len(0).map_err(at)?;
            file.seek(SeekFrom::Start(0)).map_err(at)?;
            file.write_all(&wanted).map_err(at)?;
        }
        let reader = Reader::open(&path).map_err(at)?;
        Ok(Self { file, reader, end: HEAD, path })
    }

    /// The next entry of an earlier run; the one before was taken.
    pub fn resume(&mut self) -> Result<Option<Entry>, AnnotateError> {
        self.end = self.reader.offset;
        self.reader.next().map_err(|source| self.error(source))
    }

    /// Ends resuming: what was not taken is cut off.
    pub fn write_on(&mut self) -> Result<(), AnnotateError> {
        let end = self.end;
        let cut = self.file.set_len(end).and_then(|()| self.file.seek(SeekFrom::Start(end)).map(drop));
        cut.map_err(|source| self.error(source))
    }

    /// Appends an entry.
    pub fn write(&mut self, entry: &Entry) -> Result<(), AnnotateError> {
        let payload = entry.encode();
        let mut record = Vec::with_capacity(payload.len() + 8);
        record.extend((payload.len() as u32).to_le_bytes());
        record.extend(crc32fast::hash(&payload).to_le_bytes());
        record.extend(payload);
        self.file.write_all(&record).map_err(|source| self.error(source))
    }

    /// All entries from the first.
    pub fn reader(&self) -> Result<Reader, AnnotateError> {
        Reader::open(&self.path).map_err(|source| self.error(source))
    }

    /// Removes the file: the log is whole.
    pub fn remove(self) -> Result<(), AnnotateError> {
        fs::remove_file(&self.path).map_err(|source| self.error(source))
    }

    fn error(&self, source: io::Error) -> AnnotateError {
        AnnotateError::Journal { path: self.path.clone(), source }
    }
}

/// Reads entries in order.
pub struct Reader {
    file: BufReader<File>,
    offset: u64,
}

impl Reader {
    fn open(path: &Path) -> io::Result<Self> {
        let mut file = BufReader::new(File::open(path)?);
        file.seek(SeekFrom::Start(HEAD))?;
        Ok(Self { file, offset: HEAD })
    }

    /// The next entry; none at the end, and where a record is cut off or damaged.
    pub fn next(&mut self) -> io::Result<Option<Entry>> {
        let mut head = [0; 8];
        if !self.fill(&mut head)? {
            return Ok(None);
        }
        let [length, crc] = [0, 4].map(|at| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]));
        if length > MAX_PAYLOAD {
            return Ok(None);
        }
        let mut payload = Vec::new();
        (&mut self.file).take(u64::from(length)).read_to_end(&mut payload)?;
        let whole = payload.len() as u64 == u64::from(length) && crc32fast::hash(&payload) == crc;
        let entry = Entry::decode(&payload).filter(|_| whole);
        self.offset += if entry.is_some() { 8 + u64::from(length) } else { 0 };
        Ok(entry)
    }

    fn fill(&mut self, bytes: &mut [u8]) -> io::Result<bool> {
        match self.file.read_exact(bytes) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(stamp: i64) -> Entry {
        let segment =
            Segment { id: 3, category_id: 9, score: 0.5, x: 1, y: 0, width: 2, height: 1, area: 2, is_crowd: false };
        let mask = Mask { class: vec![0, 9, 9, 0], instance: vec![0, 3, 3, 0], segments: vec![segment] };
        Entry { stamp: Stamp(stamp), picture: [7; 32], size: (4, 1), mask: (stamp % 2 == 0).then_some(mask) }
    }

    #[test]
    fn what_was_cut_off_or_changed_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.mcap");
        let mut journal = Journal::open(&out, &[1; 32]).unwrap();
        assert!(journal.resume().unwrap().is_none());
        journal.write_on().unwrap();
        (0..3).for_each(|stamp| journal.write(&entry(stamp)).unwrap());
        let path = journal.path.clone();
        let bytes = fs::read(&path).unwrap();
        let resumed = |bytes: &[u8], request: &[u8; 32]| {
            fs::write(&path, bytes).unwrap();
            let mut journal = Journal::open(&out, request).unwrap();
            let mut stamps = Vec::new();
            while let Some(known) = journal.resume().unwrap() {
                assert_eq!(known, entry(known.stamp.0));
                stamps.push(known.stamp.0);
            }
            journal.write_on().unwrap();
            assert!(fs::metadata(&path).unwrap().len() <= bytes.len() as u64);
            stamps
        };
        assert_eq!(resumed(&bytes, &[1; 32]), [0, 1, 2]);
        assert_eq!(resumed(&bytes[..bytes.len() - 1], &[1; 32]), [0, 1]);
        assert_eq!(resumed(&bytes, &[2; 32]), [] as [i64; 0], "another request");
        let mut damaged = bytes.clone();
        damaged[HEAD as usize + 20] ^= 1;
        assert_eq!(resumed(&damaged, &[1; 32]), [] as [i64; 0]);
    }
}
