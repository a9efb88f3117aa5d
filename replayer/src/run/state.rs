//! The state of a replay between two frames, in a file: a replay that goes on from it ends as if it had never stopped, with
//! the same records, trajectories and fingerprint.
//!
//! The file is a records file (see [`super::records`]) up to that frame, so that the records of the whole run can be made from
//! it, followed by the state instead of the end: blocks of kind 4, chained like all others. Their payloads are the number of
//! such blocks that follow (4 bytes) and a piece of [`VERSION`] (4 bytes) and `Saved` in the encoding of postcard.

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;

use serde::{Deserialize, Serialize};
use slam::State;

use super::diff::header_differences;
use super::records::{Block, FrameEntry, RecordReader, RecordWriter, RunHeader};
use super::{RunError, RunResult};
use crate::OutputError;

/// To be raised whenever a type within a state changes: the encoding has no names in it.
const VERSION: u32 = 4;
/// Bytes of the state in one block.
const PIECE_BYTES: usize = 1 << 19;

/// All that a replay carries from frame to frame.
#[derive(Serialize, Deserialize)]
pub(super) struct Saved<'a> {
    /// Counts and events so far.
    pub result: Cow<'a, RunResult>,
    /// The slam.
    pub slam: State<'a>,
}

impl Saved<'_> {
    pub fn encode(&self) -> Vec<u8> {
        let bytes = VERSION.to_le_bytes().to_vec();
        postcard::to_extend(self, bytes).expect("sequences know their length, and memory can be written")
    }
}

impl Saved<'static> {
    fn decode(path: &Path, bytes: &[u8]) -> Result<Self, RunError> {
        let wrong = |reason: String| RunError::State { path: path.to_owned(), reason };
        let (version, rest) = bytes.split_first_chunk::<4>().ok_or_else(|| wrong("it is empty".to_owned()))?;
        let version = u32::from_le_bytes(*version);
        if version != VERSION {
            return Err(wrong(format!("it has version {version}, this program knows version {VERSION}")));
        }
        match postcard::take_from_bytes(rest) {
            Ok((saved, [])) => Ok(saved),
            Ok((_, more)) => Err(wrong(format!("{} bytes too many", more.len()))),
            Err(error) => Err(wrong(error.to_string())),
        }
    }
}

/// Writes the state file from the records so far, which must be flushed, and an encoded [`Saved`].
pub(super) fn save(out: &Path, force: bool, records: &Path, frames: usize, state: &[u8]) -> Result<(), RunError> {
    if !force && out.exists() {
        return Err(OutputError::Exists { path: out.to_owned() }.into());
    }
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    let partial = out.with_file_name(name);
    let io = |source| RunError::Output(OutputError::Io { path: out.to_owned(), source });
    let mut reader = RecordReader::open(records)?;
    let mut file = BufWriter::new(File::create(&partial).map_err(io)?);
    let mut writer = RecordWriter::default();
    file.write_all(&RecordWriter::preamble()).map_err(io)?;
    file.write_all(&writer.block(&Block::Header(reader.header().clone()))).map_err(io)?;
    for _ in 0..frames {
        let block = reader.next_block()?.expect("the caller counts the frames");
        file.write_all(&writer.block(&block)).map_err(io)?;
    }
    let pieces = state.chunks(PIECE_BYTES);
    for (following, piece) in (0..pieces.len() as u32).rev().zip(pieces) {
        file.write_all(&writer.block(&Block::State { following, piece: piece.to_vec() })).map_err(io)?;
    }
    let file = file.into_inner().map_err(|error| io(error.into_error()))?;
    file.sync_all().and_then(|()| fs::rename(&partial, out)).map_err(io)
}

/// Reads a state that a run with this header can go on from; `each` gets the records so far.
pub(super) fn load(
    path: &Path,
    header: &RunHeader,
    each: &mut dyn FnMut(FrameEntry) -> Result<(), RunError>,
) -> Result<Saved<'static>, RunError> {
    let mut reader = RecordReader::open_state(path)?;
    let mut frames = 0;
    let saved = reader.header();
    let mut expected = header.clone();
    // A run may go on for longer than the one that saved was asked to.
    expected.frames.end = saved.frames.end;
    let differences = header_differences(saved, &expected);
    if !differences.is_empty() {
        let texts: Vec<String> = differences.iter().map(ToString::to_string).collect();
        return Err(RunError::OtherState { path: path.to_owned(), differences: texts.join("\n") });
    }
    let mut bytes = Vec::new();
    while let Some(block) = reader.next_block()? {
        match block {
            Block::Frame(entry) => {
                frames += 1;
                each(entry)?;
            }
            Block::State { piece, .. } => bytes.extend(piece),
            Block::Header(_) | Block::End(_) => unreachable!("the reader refuses them"),
        }
    }
    let saved = Saved::decode(path, &bytes)?;
    let wrong = |reason: String| RunError::State { path: path.to_owned(), reason };
    if saved.slam.frames() != frames || saved.result.frames != frames {
        return Err(wrong(format!("{} frames have gone into it, it has records of {frames}", saved.slam.frames())));
    }
    if frames > header.frames.len() {
        return Err(wrong(format!("it comes after {frames} frames, the replay is to have {}", header.frames.len())));
    }
    Ok(saved)
}
