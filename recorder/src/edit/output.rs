//! The log that an edit writes.

use super::EditError;
use super::source::{Channel, RawMessage, Source};
use super::summary::{Counts, EditSummary, SourceFile};
use crate::log_writer::{ChannelId, LogOptions, LogWriter, RawSchema};
use mcap::Attachment;
use schemas::{Message, Stamp, metadata};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// What is asked for, apart from the edit itself.
#[derive(Debug, Clone)]
pub struct EditOptions {
    /// `slice`, `redact`, ...: stands in the log's record.
    pub operation: &'static str,
    /// What was asked for, as it shall stand in the record: anything that changes the result, and no paths.
    pub arguments: BTreeMap<String, serde_json::Value>,
    /// Number the messages of each topic anew from 0: for edits that leave messages out or mix sources, so that no reader
    /// takes a gap for a loss.
    pub renumber: bool,
    /// Do everything but write.
    pub dry_run: bool,
    /// How to write.
    pub log: LogOptions,
}

impl EditOptions {
    /// An edit that keeps numbers, with the container's usual options.
    #[must_use]
    pub fn new(operation: &'static str, arguments: BTreeMap<String, serde_json::Value>) -> Self {
        Self { operation, arguments, renumber: false, dry_run: false, log: LogOptions::default() }
    }
}

/// Looks at a log that is written but has no name yet, and so has replaced nothing.
pub(super) type Check<'c> = &'c mut dyn FnMut(&Path) -> Result<(), EditError>;

/// A channel of a source that is in the result.
#[derive(Debug, Clone)]
struct Open {
    topic: String,
    /// None in a dry run.
    id: Option<ChannelId>,
}

/// The log in the making, and the count of what goes in.
pub struct Output {
    /// None in a dry run.
    log: Option<LogWriter>,
    out: PathBuf,
    renumber: bool,
    /// By number of the source and of its channel.
    channels: BTreeMap<(usize, u16), Open>,
    /// Topics that some source has, and those that only the result has.
    source_topics: BTreeSet<String>,
    added_topics: BTreeSet<String>,
    /// The source whose message is at hand, and whether it went into the result.
    source: usize,
    used: bool,
    provenance_records: usize,
    summary: EditSummary,
}

impl Output {
    /// Starts the log that will stand at `out`.
    ///
    /// # Errors
    /// Something stands there (and `force` is off), it is one of the sources, or the file system refuses.
    pub fn create(out: &Path, sources: &[&Path], options: &EditOptions) -> Result<Self, EditError> {
        let same = |source: &&&Path| matches!((source.canonicalize(), out.canonicalize()), (Ok(source), Ok(out)) if source == out);
        if let Some(source) = sources.iter().find(same) {
            return Err(EditError::SameFile((*source).to_owned()));
        }
        let log = if options.dry_run { None } else { Some(LogWriter::create(out, &options.log)?) };
        Ok(Self {
            log,
            out: out.to_owned(),
            renumber: options.renumber,
            channels: BTreeMap::new(),
            source_topics: BTreeSet::new(),
            added_topics: BTreeSet::new(),
            source: 0,
            used: false,
            provenance_records: 0,
            summary: EditSummary::new(options.operation, options.arguments.clone()),
        })
    }

    /// Takes the message at hand over, byte for byte.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn keep(&mut self, message: &RawMessage<'_>) -> Result<(), EditError> {
        self.write(message, &message.data, |counts| counts.kept += 1)
    }

    /// Takes the message at hand over with other contents of the same type.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn replace(&mut self, message: &RawMessage<'_>, data: &[u8]) -> Result<(), EditError> {
        self.write(message, data, |counts| counts.changed += 1)
    }

    /// Adds a message on a topic that no source has. In a live recording the publish time is that of the message that it
    /// belongs to.
    ///
    /// # Errors
    /// A source has the topic, it carries another type, or the file system refuses.
    pub fn insert<'a, M: Message<'a>>(
        &mut self,
        topic: &str,
        log_time: Stamp,
        publish_time: Stamp,
        message: &M,
    ) -> Result<(), EditError> {
        if self.source_topics.contains(topic) {
            return Err(EditError::Refused(format!("the log has {topic} already: choose another name")));
        }
        self.added_topics.insert(topic.to_owned());
        if let Some(log) = &mut self.log {
            let channel = log.open_topic::<M>(topic, BTreeMap::new())?;
            log.append(channel, log_time, publish_time, &message.encode())?;
        }
        self.counts(topic).added += 1;
        Ok(())
    }

    /// Adds a metadata record, sealed with its checksum.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn metadata(&mut self, name: &str, values: BTreeMap<String, String>) -> Result<(), EditError> {
        self.keep_metadata(name, metadata::seal(name, values))
    }

    /// Takes a metadata record over as it is. A channel's second copy is left out: the new log has its own. Records of
    /// earlier edits are numbered on, whatever number they had.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn keep_metadata(&mut self, name: &str, values: BTreeMap<String, String>) -> Result<(), EditError> {
        if name.starts_with(metadata::CHANNEL_PREFIX) {
            return Ok(());
        }
        if name.starts_with(metadata::PROVENANCE_PREFIX) {
            return self.provenance(values);
        }
        if let Some(log) = &mut self.log {
            log.metadata_as_is(name, values)?;
        }
        Ok(())
    }

    fn provenance(&mut self, values: BTreeMap<String, String>) -> Result<(), EditError> {
        self.provenance_records += 1;
        let name = format!("{}{}", metadata::PROVENANCE_PREFIX, self.provenance_records);
        if let Some(log) = &mut self.log {
            log.metadata(&name, values)?;
        }
        Ok(())
    }

    /// Takes an attached file over.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn keep_attachment(&mut self, attachment: &Attachment<'_>) -> Result<(), EditError> {
        if let Some(log) = &mut self.log {
            log.attach_raw(attachment)?;
        }
        Ok(())
    }

    /// Opens a source's channel under `topic`; without one, its messages will be dropped.
    pub(super) fn open(&mut self, source: usize, channel: &Channel, topic: Option<String>) -> Result<(), EditError> {
        let Some(topic) = topic else { return Ok(()) };
        if self.added_topics.contains(&topic) {
            return Err(EditError::Refused(format!("the log has {topic} already: choose another name")));
        }
        let schema = channel.schema.as_ref();
        let schema = schema.map(|s| RawSchema { name: &s.name, encoding: &s.encoding, data: &s.data });
        let id = match &mut self.log {
            Some(log) => Some(log.add_channel(schema, &topic, &channel.encoding, &channel.metadata)?),
            None => None,
        };
        self.counts(&topic);
        self.source_topics.insert(topic.clone());
        self.channels.insert((source, channel.id), Open { topic, id });
        Ok(())
    }

    /// Starts on a message of a source; false if its channel is not in the result, which counts it as dropped.
    pub(super) fn begin(&mut self, source: usize, message: &RawMessage<'_>) -> bool {
        (self.source, self.used) = (source, false);
        let open = self.channels.contains_key(&(source, message.channel.id));
        if !open {
            self.counts(message.topic()).dropped += 1;
        }
        open
    }

    /// Counts the message at hand as dropped if it was not used.
    pub(super) fn end(&mut self, message: &RawMessage<'_>) {
        if !self.used
            && let Some(open) = self.channels.get(&(self.source, message.channel.id)).cloned()
        {
            self.counts(&open.topic).dropped += 1;
        }
    }

    fn write(&mut self, message: &RawMessage<'_>, data: &[u8], count: fn(&mut Counts)) -> Result<(), EditError> {
        let Some(Open { topic, id }) = self.channels.get(&(self.source, message.channel.id)).cloned() else {
            return Err(EditError::message(message, "its channel was not taken over"));
        };
        self.used = true;
        count(self.counts(&topic));
        if let (Some(log), Some(id)) = (&mut self.log, id) {
            let sequence = if self.renumber { log.next_sequence(id) } else { message.sequence };
            // Both were checked to be times when they were read.
            let (log_time, publish_time) = (message.log_time.0 as u64, message.publish_time.0 as u64);
            log.write_raw(id, sequence, log_time, publish_time, data)?;
        }
        Ok(())
    }

    fn counts(&mut self, topic: &str) -> &mut Counts {
        self.summary.topics.entry(topic.to_owned()).or_default()
    }

    /// Writes the record of what was done and closes the log, which gets its name only if `check` of the whole file has
    /// nothing to say against it.
    pub(super) fn finish(mut self, sources: &[Source], check: Check<'_>) -> Result<EditSummary, EditError> {
        let file = |source: &Source| SourceFile {
            file: source.path().to_owned(),
            bytes: source.file_bytes(),
            blake3: source.blake3(),
        };
        self.summary.sources = sources.iter().map(file).collect();
        self.summary.add_up();
        self.provenance(self.summary.metadata())?;
        if let Some(log) = self.log {
            let partial = log.partial().to_owned();
            // Half a copy is of no use: the sources still stand.
            let finished = log.finish_if(check).inspect_err(|_| drop(fs::remove_file(partial)));
            (self.summary.out_bytes, self.summary.out) = (finished?, Some(self.out));
        }
        Ok(self.summary)
    }

    /// Gives up: removes the unfinished file; the sources still stand.
    pub(super) fn discard(self) {
        if let Some(log) = self.log {
            log.discard();
        }
    }
}
