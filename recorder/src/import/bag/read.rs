//! The messages of an MCAP file in the order of the file, every CRC checked.

use super::super::ImportError;
use mcap::records::{self, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Larger records are refused rather than read into memory.
const MAX_RECORD_BYTES: usize = 512 << 20;

/// What is met.
pub enum Record<'a> {
    Message(Message<'a>),
    /// A metadata record's name.
    Metadata(String),
}

/// A message with its channel.
pub struct Message<'a> {
    pub topic: &'a str,
    /// `package/msg/Type`.
    pub schema: &'a str,
    /// `cdr`.
    pub encoding: &'a str,
    pub data: &'a [u8],
}

struct Channel {
    topic: String,
    schema: String,
    encoding: String,
}

/// Hands every record of a file to `sink`.
pub fn read(path: &Path, sink: &mut dyn FnMut(Record<'_>) -> Result<(), ImportError>) -> Result<(), ImportError> {
    let io = |source| ImportError::Io { path: path.to_owned(), source, hint: String::new() };
    let mut file = BufReader::with_capacity(1 << 20, File::open(path).map_err(io)?);
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = LinearReader::new_with_options(options);
    let mut tables = Tables::default();
    let damaged =
        |error: mcap::McapError| ImportError::content(path, format!("{error}; `pslam recover` keeps what is whole"));
    while let Some(event) = reader.next_event() {
        match event.map_err(damaged)? {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted)).map_err(io)?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => tables.record(path, opcode, data, sink)?,
        }
    }
    Ok(())
}

#[derive(Default)]
struct Tables {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
}

impl Tables {
    fn record(
        &mut self,
        path: &Path,
        opcode: u8,
        data: &[u8],
        sink: &mut dyn FnMut(Record<'_>) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        if ![op::SCHEMA, op::CHANNEL, op::MESSAGE, op::METADATA].contains(&opcode) {
            return Ok(());
        }
        let record = mcap::parse_record(opcode, data).map_err(|error| ImportError::content(path, error.to_string()))?;
        match record {
            records::Record::Schema { header, .. } => drop(self.schemas.insert(header.id, header.name)),
            records::Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let (topic, encoding) = (channel.topic, channel.message_encoding);
                self.channels.insert(channel.id, Channel { topic, schema, encoding });
            }
            records::Record::Metadata(record) => sink(Record::Metadata(record.name))?,
            records::Record::Message { header, data } => {
                let Some(Channel { topic, schema, encoding }) = self.channels.get(&header.channel_id) else {
                    let what = format!("a message names channel {}, which is not there", header.channel_id);
                    return Err(ImportError::content(path, what));
                };
                sink(Record::Message(Message { topic, schema, encoding, data: &data }))?;
            }
            _ => {}
        }
        Ok(())
    }
}
