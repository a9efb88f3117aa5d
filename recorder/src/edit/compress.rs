//! The same log with its chunks packed otherwise, and the proof that it is the same.

use super::rewrite::rewrite_checked;
use super::{Edit, EditError, EditOptions, EditSummary, Item, Source};
use schemas::metadata;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// How chunks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Not at all.
    None,
    /// zstd, 1 (fast) to 22 (small).
    Zstd(u8),
}

/// Keeps everything.
struct Same;

impl Edit for Same {}

/// What a log holds: everything but how it is packed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Compressed {
    /// Messages, in the same order, with the same bytes, numbers and times.
    pub messages: u64,
    /// Their bytes.
    pub message_bytes: u64,
    /// Attached files and metadata records, but for those about channels and edits.
    pub records: u64,
    /// BLAKE3 over all of it, the same for the source and the result.
    pub content_blake3: String,
}

/// What [`compress`] did.
#[derive(Debug, Clone, Serialize)]
pub struct Compress {
    /// The edit.
    #[serde(flatten)]
    pub summary: EditSummary,
    /// What source and result were both read to hold; none in a dry run.
    pub proof: Option<Compressed>,
}

/// Packs a log's chunks anew, then reads both files and compares all that they hold. `progress` gets bytes read and bytes in
/// all, of the first pass.
///
/// # Errors
/// As [`super::rewrite()`]; a result that holds something else, which is thrown away: it never gets its name, and what stands
/// there stays.
pub fn compress(
    source: &Path,
    out: &Path,
    level: Level,
    mut options: EditOptions,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Compress, EditError> {
    options.log.compress = level != Level::None;
    if let Level::Zstd(level) = level {
        options.log.compression_level = level.into();
    }
    repack(source, out, &options, &mut Same, progress)
}

fn repack(
    source: &Path,
    out: &Path,
    options: &EditOptions,
    edit: &mut dyn Edit,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Compress, EditError> {
    let mut proof = None;
    let mut check = |new: &Path| {
        proof = Some(prove(source, new)?);
        Ok(())
    };
    let summary = rewrite_checked(source, out, options, edit, progress, &mut check)?;
    Ok(Compress { summary, proof })
}

/// What both logs hold.
fn prove(source: &Path, new: &Path) -> Result<Compressed, EditError> {
    let before = content(source)?;
    let what = match content(new) {
        Ok(after) if before == after => return Ok(before),
        Ok(after) => format!("{after} instead of {before}"),
        Err(error) => error.to_string(),
    };
    Err(EditError::Differs { source_log: source.to_owned(), what })
}

/// Reads a log whole for what it holds.
fn content(path: &Path) -> Result<Compressed, EditError> {
    let mut source = Source::open(path)?;
    let mut hash = blake3::Hasher::new();
    let text = |hash: &mut blake3::Hasher, bytes: &[u8]| {
        hash.update(&(bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    let (mut messages, mut message_bytes, mut records) = (0, 0, 0);
    while let Some(item) = source.next()? {
        match item {
            Item::Message(message) => {
                messages += 1;
                message_bytes += message.data.len() as u64;
                text(&mut hash, message.topic().as_bytes());
                for number in [i64::from(message.sequence), message.log_time.0, message.publish_time.0] {
                    hash.update(&number.to_le_bytes());
                }
                text(&mut hash, &message.data);
            }
            Item::Channel(channel) => {
                let (name, encoding, data) = match &channel.schema {
                    Some(schema) => (schema.name.as_str(), schema.encoding.as_str(), schema.data.as_slice()),
                    None => ("", "", &[][..]),
                };
                let texts = [channel.topic.as_str(), &channel.encoding, name, encoding];
                texts.iter().for_each(|part| text(&mut hash, part.as_bytes()));
                text(&mut hash, data);
                channel.metadata.iter().flat_map(|(k, v)| [k, v]).for_each(|part| text(&mut hash, part.as_bytes()));
            }
            Item::Metadata { name, .. }
                if [metadata::CHANNEL_PREFIX, metadata::PROVENANCE_PREFIX].iter().any(|p| name.starts_with(p)) => {}
            Item::Metadata { name, values } => {
                records += 1;
                text(&mut hash, name.as_bytes());
                values.iter().flat_map(|(k, v)| [k, v]).for_each(|part| text(&mut hash, part.as_bytes()));
            }
            Item::Attachment(file) => {
                records += 1;
                [&file.name, &file.media_type].iter().for_each(|part| text(&mut hash, part.as_bytes()));
                hash.update(&file.log_time.to_le_bytes());
                hash.update(&file.create_time.to_le_bytes());
                text(&mut hash, &file.data);
            }
        }
    }
    Ok(Compressed { messages, message_bytes, records, content_blake3: hash.finalize().to_hex().to_string() })
}

impl fmt::Display for Compressed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { messages, message_bytes, records, content_blake3 } = self;
        write!(f, "{messages} messages of {message_bytes} bytes and {records} records, blake3 {content_blake3}")
    }
}

impl fmt::Display for Compress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.summary.fmt(f)?;
        match &self.proof {
            Some(proof) => writeln!(f, "proven   both logs hold {proof}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Output, RawMessage};
    use super::*;
    use crate::{LogOptions, LogWriter};
    use schemas::Stamp;
    use schemas::msg::{Header, PoseStamped};
    use std::collections::BTreeMap;

    fn log(path: &Path, poses: i64) {
        let mut log = LogWriter::create(path, &LogOptions::default()).unwrap();
        for second in 0..poses {
            let stamp = Stamp(second * 1_000_000_000);
            let pose = PoseStamped { header: Header::new(stamp, "world").unwrap(), ..PoseStamped::default() };
            log.write("/pose", stamp, &pose).unwrap();
        }
        log.finish().unwrap();
    }

    /// Leaves a message out, as no packing may.
    struct Lossy(u32);

    impl Edit for Lossy {
        fn message(&mut self, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
            self.0 += 1;
            if self.0 == 2 { Ok(()) } else { out.keep(message) }
        }
    }

    #[test]
    fn a_result_that_differs_is_thrown_away_and_what_stands_there_stays() {
        let folder = tempfile::tempdir().unwrap();
        let [source, old] = ["a", "b"].map(|name| folder.path().join(format!("{name}.mcap")));
        log(&source, 3);
        log(&old, 7);
        let bytes = std::fs::read(&old).unwrap();
        let mut options = EditOptions::new("compress", BTreeMap::new());
        options.log.force = true;
        let error = repack(&source, &old, &options, &mut Lossy(0), &mut |_, _| {}).unwrap_err();
        assert!(matches!(error, EditError::Differs { .. }) && error.to_string().contains("2 messages"), "{error}");
        assert_eq!(std::fs::read(&old).unwrap(), bytes);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no unfinished file is left");
        let done = repack(&source, &old, &options, &mut Same, &mut |_, _| {}).unwrap();
        assert_eq!((done.proof.unwrap().messages, content(&old).unwrap().messages), (3, 3));
    }

    #[test]
    fn a_result_that_cannot_be_read_proves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let [source, cut] = ["a", "b"].map(|name| folder.path().join(format!("{name}.mcap")));
        [&source, &cut].into_iter().for_each(|path| log(path, 3));
        assert_eq!(prove(&source, &cut).unwrap().messages, 3);
        let bytes = std::fs::read(&cut).unwrap();
        std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
        assert!(matches!(prove(&source, &cut), Err(EditError::Differs { .. })));
    }
}
