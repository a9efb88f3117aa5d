//! One more metadata record in a closed log.
//!
//! Everything before the end of the data section is copied byte for byte; the record follows, and the summary is written
//! again with one index entry more. The MCAP layout is that of its specification (version 0, sections "Records" and
//! "Summary Section").

use crate::WriteError;
use crate::recover::Cursor;
use schemas::metadata;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const FOOTER: u8 = 0x02;
const STATISTICS: u8 = 0x0B;
const METADATA: u8 = 0x0C;
const METADATA_INDEX: u8 = 0x0D;
const SUMMARY_OFFSET: u8 = 0x0E;
const DATA_END: u8 = 0x0F;
/// Opcode and length.
const HEAD: u64 = 9;
const FOOTER_BYTES: u64 = HEAD + 20;
const DATA_END_BYTES: u64 = HEAD + 4;
/// A larger summary is none of ours.
const MAX_SUMMARY_BYTES: u64 = 1 << 30;
/// Where the metadata count stands in the statistics: after a u64, a u16 and two u32 (messages, schemas, channels,
/// attachments).
const METADATA_COUNT_AT: usize = 8 + 2 + 4 + 4;

/// Copies the log `source` to `out` with one metadata record more, sealed with its checksum. `out` may be `source`: the
/// result is complete under another name before it takes the place.
///
/// # Errors
/// `source` is not a closed log (see `pslam recover`), `out` exists and is another file, or the file system refuses.
pub fn append_record(
    source: &Path,
    out: &Path,
    name: &str,
    values: BTreeMap<String, String>,
    force: bool,
) -> Result<(), WriteError> {
    if out != source && !force && out.exists() {
        return Err(WriteError::Exists(out.to_owned()));
    }
    let mut partial = out.file_name().unwrap_or_default().to_owned();
    partial.push(".partial");
    let partial = out.with_file_name(partial);
    if partial.exists() && !force {
        return Err(WriteError::Unfinished(partial));
    }
    let done = copy(source, &partial, &metadata_record(name, &metadata::seal(name, values)))
        .and_then(|()| fs::rename(&partial, out));
    done.map_err(|error| {
        // Half a copy is of no use: the source still is whole.
        let _ = fs::remove_file(&partial);
        match error.kind() {
            io::ErrorKind::InvalidData => WriteError::Invalid(format!("{}: {error}", source.display())),
            _ => WriteError::Io { path: out.to_owned(), source: error },
        }
    })
}

fn invalid(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, format!("{what}: not a closed log, try `pslam recover` first"))
}

fn copy(source: &Path, partial: &Path, record: &[u8]) -> io::Result<()> {
    let mut input = BufReader::new(File::open(source)?);
    let length = input.get_ref().metadata()?.len();
    let (data_end, summary) = read_tail(&mut input, length)?;
    let mut output = BufWriter::new(File::create(partial)?);
    let mut hash = crc32fast::Hasher::new();
    input.seek(SeekFrom::Start(0))?;
    let mut block = vec![0; 1 << 20];
    let mut left = data_end;
    while left > 0 {
        let take = left.min(block.len() as u64) as usize;
        input.read_exact(&mut block[..take])?;
        hash.update(&block[..take]);
        output.write_all(&block[..take])?;
        left -= take as u64;
    }
    hash.update(record);
    output.write_all(record)?;
    let mut tail = Vec::new();
    push(&mut tail, DATA_END, &hash.finalize().to_le_bytes());
    let summary_start = data_end + record.len() as u64 + tail.len() as u64;
    let place = (data_end, record.len() as u64);
    tail.extend(summary_bytes(&summary, summary_start, place, record)?);
    output.write_all(&tail)?;
    output.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}

/// Where the data section ends, and the summary's records: opcode and body.
type Tail = (u64, Vec<(u8, Vec<u8>)>);

fn read_tail(input: &mut (impl Read + Seek), length: u64) -> io::Result<Tail> {
    let end = length.checked_sub(FOOTER_BYTES + MAGIC.len() as u64).ok_or_else(|| invalid("the file is too short"))?;
    input.seek(SeekFrom::Start(end))?;
    let mut footer = [0; FOOTER_BYTES as usize + 8];
    input.read_exact(&mut footer)?;
    if footer[0] != FOOTER || footer[FOOTER_BYTES as usize..] != *MAGIC {
        return Err(invalid("there is no footer at the end"));
    }
    let start = u64::from_le_bytes(footer[9..17].try_into().expect("eight bytes"));
    let size = end.checked_sub(start).filter(|size| start > DATA_END_BYTES && *size <= MAX_SUMMARY_BYTES);
    let size = size.ok_or_else(|| invalid("the footer names no summary"))?;
    input.seek(SeekFrom::Start(start - DATA_END_BYTES))?;
    let mut bytes = vec![0; (DATA_END_BYTES + size) as usize];
    input.read_exact(&mut bytes)?;
    if bytes[0] != DATA_END {
        return Err(invalid("no end of data stands before the summary"));
    }
    let mut cursor = Cursor(&bytes[DATA_END_BYTES as usize..]);
    let mut records = Vec::new();
    while !cursor.0.is_empty() {
        let record = cursor.u8().zip(cursor.u64()).and_then(|(op, length)| Some((op, cursor.take(length as usize)?)));
        let (opcode, body) = record.ok_or_else(|| invalid("the summary is cut off"))?;
        records.push((opcode, body.to_vec()));
    }
    Ok((start - DATA_END_BYTES, records))
}

/// Summary, summary offsets, footer and end mark. `place` is offset and length of the new metadata record.
fn summary_bytes(records: &[(u8, Vec<u8>)], start: u64, place: (u64, u64), record: &[u8]) -> io::Result<Vec<u8>> {
    let mut records: Vec<(u8, Vec<u8>)> = records.iter().filter(|(op, _)| *op != SUMMARY_OFFSET).cloned().collect();
    let mut index = [place.0.to_le_bytes(), place.1.to_le_bytes()].concat();
    let mut name = Cursor(&record[HEAD as usize..]);
    string(&mut index, &name.text().unwrap_or_default());
    // Behind its like, or at the end: records of a kind stand together.
    let at = records.iter().rposition(|(op, _)| *op == METADATA_INDEX).map_or(records.len(), |last| last + 1);
    records.insert(at, (METADATA_INDEX, index));
    for (_, body) in records.iter_mut().filter(|(op, _)| *op == STATISTICS) {
        let count =
            body.get_mut(METADATA_COUNT_AT..METADATA_COUNT_AT + 4).ok_or_else(|| invalid("statistics too short"))?;
        let more = u32::from_le_bytes([count[0], count[1], count[2], count[3]]).saturating_add(1);
        count.copy_from_slice(&more.to_le_bytes());
    }
    let mut bytes = Vec::new();
    let mut groups: Vec<(u8, u64, u64)> = Vec::new();
    for (opcode, body) in &records {
        let from = start + bytes.len() as u64;
        push(&mut bytes, *opcode, body);
        let length = start + bytes.len() as u64 - from;
        match groups.last_mut() {
            Some((last, _, size)) if last == opcode => *size += length,
            _ => groups.push((*opcode, from, length)),
        }
    }
    let offsets_start = start + bytes.len() as u64;
    for (opcode, from, size) in groups {
        push(&mut bytes, SUMMARY_OFFSET, &[&[opcode][..], &from.to_le_bytes(), &size.to_le_bytes()].concat());
    }
    // The footer's own checksum covers everything from the summary's start to itself.
    bytes.push(FOOTER);
    bytes.extend(20u64.to_le_bytes());
    bytes.extend(start.to_le_bytes());
    bytes.extend(offsets_start.to_le_bytes());
    let crc = crc32fast::hash(&bytes);
    bytes.extend(crc.to_le_bytes());
    bytes.extend(MAGIC);
    Ok(bytes)
}

fn metadata_record(name: &str, values: &BTreeMap<String, String>) -> Vec<u8> {
    let mut map = Vec::new();
    for (key, value) in values {
        string(&mut map, key);
        string(&mut map, value);
    }
    let mut body = Vec::new();
    string(&mut body, name);
    body.extend((map.len() as u32).to_le_bytes());
    body.extend(map);
    let mut record = Vec::new();
    push(&mut record, METADATA, &body);
    record
}

fn string(bytes: &mut Vec<u8>, text: &str) {
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(text.as_bytes());
}

fn push(bytes: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    bytes.push(opcode);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
}
