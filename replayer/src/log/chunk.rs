//! Chunks: compressed runs of records with a CRC over their contents.

use std::io::Read;

use mcap::records::{ChunkHeader, MessageHeader, Record, op};

/// No record or unpacked chunk of a camera's log comes near this; a damaged length field easily does.
pub const MAX_RECORD_BYTES: u64 = 512 << 20;
/// Opcode and length in front of each record.
pub const RECORD_HEADER_BYTES: usize = 9;
const MESSAGE_HEADER_BYTES: usize = 22;

/// Unpacks a chunk record's body and checks its CRC.
pub fn unpack(body: &[u8]) -> Result<Vec<u8>, String> {
    let (header, data) = match mcap::parse_record(op::CHUNK, body) {
        Ok(Record::Chunk { header, data }) => (header, data),
        Ok(_) => return Err("not a chunk".to_owned()),
        Err(error) => return Err(error.to_string()),
    };
    let contents = decompress(&header, &data)?;
    let found = crc32fast::hash(&contents);
    // Zero means that the writer computed none.
    if header.uncompressed_crc != 0 && header.uncompressed_crc != found {
        return Err(format!("CRC is {found:08x}, the writer had {:08x}", header.uncompressed_crc));
    }
    Ok(contents)
}

fn decompress(header: &ChunkHeader, data: &[u8]) -> Result<Vec<u8>, String> {
    let size = header.uncompressed_size;
    if size > MAX_RECORD_BYTES {
        return Err(format!("claims {size} bytes unpacked, more than the limit of {MAX_RECORD_BYTES}"));
    }
    // The claim is not trusted with memory: the buffer grows with what really comes out.
    let mut contents = Vec::with_capacity(size.min(4 << 20) as usize);
    let limit = size + 1;
    let read = match header.compression.as_str() {
        "" => data.take(limit).read_to_end(&mut contents),
        "zstd" => zstd::stream::read::Decoder::new(data).and_then(|d| d.take(limit).read_to_end(&mut contents)),
        "lz4" => lz4::Decoder::new(data).and_then(|d| d.take(limit).read_to_end(&mut contents)),
        other => return Err(format!("compression `{other}` is not known (zstd, lz4 or none)")),
    };
    read.map_err(|error| format!("cannot be unpacked: {error}"))?;
    if contents.len() as u64 != size {
        return Err(format!("unpacks to {} bytes where {size} are claimed", contents.len()));
    }
    Ok(contents)
}

/// Opcode, body, offset behind it.
pub type InnerRecord<'a> = (u8, &'a [u8], usize);

/// One record at `offset` of an unpacked chunk; `None` at the end.
pub fn inner_record(contents: &[u8], offset: usize) -> Result<Option<InnerRecord<'_>>, String> {
    if offset == contents.len() {
        return Ok(None);
    }
    let short = || format!("a record at byte {offset} of its {} unpacked bytes is cut off", contents.len());
    let head = contents.get(offset..offset + RECORD_HEADER_BYTES).ok_or_else(short)?;
    let len = usize::try_from(read_u64(&head[1..])).map_err(|_| short())?;
    let start = offset + RECORD_HEADER_BYTES;
    let end = start.checked_add(len).ok_or_else(short)?;
    Ok(Some((head[0], contents.get(start..end).ok_or_else(short)?, end)))
}

/// A message record's head and data.
pub fn message(body: &[u8]) -> Result<(MessageHeader, &[u8]), String> {
    if body.len() < MESSAGE_HEADER_BYTES {
        return Err(format!("a message record of {} bytes is too short", body.len()));
    }
    let (head, data) = body.split_at(MESSAGE_HEADER_BYTES);
    let header = MessageHeader {
        channel_id: u16::from_le_bytes([head[0], head[1]]),
        sequence: u32::from_le_bytes([head[2], head[3], head[4], head[5]]),
        log_time: read_u64(&head[6..]),
        publish_time: read_u64(&head[14..]),
    };
    Ok((header, data))
}

/// The first eight bytes, which the caller knows to be there.
pub fn read_u64(bytes: &[u8]) -> u64 {
    bytes.iter().take(8).rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}
