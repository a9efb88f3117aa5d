//! Several logs to one.
//!
//! Messages go in order of log time across the logs, each log's own order kept; equal times in the order of the logs. What
//! two logs both say is kept once. What they say differently is refused where a reader could only take one of them
//! (channels, calibration, categories, messages of one stamp, scales), and kept under a name of its own where it only
//! describes the log (`NAME/merged/N`, N from 2: the number of the log).

use super::summary::EditSummary;
use super::{Channel, EditError, EditOptions, Item, Output, RawMessage, Source};
use schemas::msg::{CameraInfo, CategoryTable, Header, SegmentTable};
use schemas::topics::{self, LayerTopics};
use schemas::{Message, Stamp, metadata};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// New names of segmentation layers: number of the log from 0, old name, new name.
pub type LayerNames = BTreeMap<(usize, String), String>;

/// Records that a reader takes one of: they must not differ.
const SINGLE: [&str; 3] = [metadata::DEPTH, metadata::PAIRING, metadata::SYNC];

/// Topics of several messages a stamp.
fn holds_several(topic: &str) -> bool {
    [topics::EXTRINSICS, topics::DROPS, topics::EVENTS, topics::TF, topics::TF_STATIC].contains(&topic)
        || topics::schema_name(topic).is_none()
}

/// Merges logs into `out`. `progress` gets bytes read and bytes in all.
///
/// # Errors
/// As [`super::rewrite`]; fewer than two logs, or a conflict, with the log and the way out.
pub fn merge(
    sources: &[&Path],
    out: &Path,
    layers: &LayerNames,
    options: &EditOptions,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<EditSummary, EditError> {
    if sources.len() < 2 {
        return Err(EditError::Refused("a merge takes two logs or more".to_owned()));
    }
    let mut opened = sources.iter().map(|path| Source::open(path)).collect::<Result<Vec<_>, _>>()?;
    let mut output = Output::create(out, sources, &EditOptions { renumber: true, ..options.clone() })?;
    match Merge::new(opened.len(), layers).run(&mut opened, &mut output, progress) {
        Ok(()) => output.finish(&opened, &mut |_| Ok(())),
        Err(error) => {
            output.discard();
            Err(error)
        }
    }
}

struct Merge<'a> {
    layers: &'a LayerNames,
    renamed: BTreeSet<(usize, String)>,
    /// The next message of each log.
    heads: Vec<Option<RawMessage<'static>>>,
    /// By topic of the result: the channel, and the log that has it.
    channels: BTreeMap<String, (usize, Arc<Channel>)>,
    /// Topics of more than one log, with hashes of their messages by stamp.
    shared: BTreeMap<String, BTreeMap<Stamp, Vec<blake3::Hash>>>,
    records: BTreeMap<String, BTreeMap<String, String>>,
    files: BTreeMap<String, blake3::Hash>,
    /// Calibrations and categories by topic, without their stamps.
    states: BTreeMap<String, Vec<u8>>,
}

impl<'a> Merge<'a> {
    fn new(logs: usize, layers: &'a LayerNames) -> Self {
        Self {
            layers,
            renamed: BTreeSet::new(),
            heads: vec![None; logs],
            channels: BTreeMap::new(),
            shared: BTreeMap::new(),
            records: BTreeMap::new(),
            files: BTreeMap::new(),
            states: BTreeMap::new(),
        }
    }

    fn run(
        &mut self,
        sources: &mut [Source],
        out: &mut Output,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<(), EditError> {
        let all: u64 = sources.iter().map(Source::file_bytes).sum();
        // What two logs both have must be known before the first message of either.
        self.find_shared(sources)?;
        for (number, source) in sources.iter_mut().enumerate() {
            self.advance(number, source, out)?;
        }
        loop {
            let time = |number: &usize| self.heads[*number].as_ref().map(|message| message.log_time);
            let next = (0..sources.len()).filter(|n| time(n).is_some()).min_by_key(|n| (time(n), *n));
            let Some(number) = next else { break };
            if let Some(message) = self.heads[number].take() {
                self.message(number, &message, out)?;
            }
            self.advance(number, &mut sources[number], out)?;
            progress(sources.iter().map(Source::offset).sum(), all);
        }
        match self.layers.keys().find(|layer| !self.renamed.contains(*layer)) {
            Some((number, layer)) => {
                Err(EditError::Refused(format!("log {} has no layer `{layer}` to rename", number + 1)))
            }
            None => Ok(()),
        }
    }

    /// The topics of each log, from a pass of their own.
    fn find_shared(&mut self, sources: &[Source]) -> Result<(), EditError> {
        let mut seen = BTreeSet::new();
        for (number, source) in sources.iter().enumerate() {
            let mut source = Source::open(source.path())?;
            let mut own = BTreeSet::new();
            while let Some(item) = source.next()? {
                if let Item::Channel(channel) = item {
                    own.insert(self.topic(number, &channel.topic));
                }
            }
            self.shared.extend(own.intersection(&seen).map(|topic: &String| (topic.clone(), BTreeMap::new())));
            seen.extend(own);
        }
        Ok(())
    }

    /// Takes what stands before a log's next message.
    fn advance(&mut self, number: usize, source: &mut Source, out: &mut Output) -> Result<(), EditError> {
        while let Some(item) = source.next()? {
            match item {
                Item::Channel(channel) => self.channel(number, &channel, out)?,
                Item::Metadata { name, values } => self.record(number, &name, values, out)?,
                Item::Attachment(mut file) => {
                    let hash = blake3::hash(&file.data);
                    if number > 0 && self.files.get(&file.name).is_some_and(|known| *known != hash) {
                        file.name = merged_name(&file.name, number);
                    }
                    if self.files.insert(file.name.clone(), hash) != Some(hash) {
                        out.keep_attachment(&file)?;
                    }
                }
                Item::Message(message) => {
                    self.heads[number] = Some(message.into_owned());
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// A topic's name in the result.
    fn topic(&self, number: usize, topic: &str) -> String {
        let renamed = topics::layer_of(topic).and_then(|layer| self.layers.get(&(number, layer.to_owned())));
        match (renamed, topic.rsplit_once('/')) {
            (Some(name), Some((_, leaf))) => {
                let LayerTopics { class, .. } = LayerTopics::new(name);
                format!("{}{leaf}", class.trim_end_matches("class"))
            }
            _ => topic.to_owned(),
        }
    }

    fn channel(&mut self, number: usize, channel: &Arc<Channel>, out: &mut Output) -> Result<(), EditError> {
        let topic = self.topic(number, &channel.topic);
        if let Some(layer) = topics::layer_of(&channel.topic) {
            self.renamed.insert((number, layer.to_owned()));
        }
        if let Some((other, known)) = self.channels.get(&topic) {
            let same = (&known.schema, &known.encoding, &known.metadata)
                == (&channel.schema, &channel.encoding, &channel.metadata);
            if !same && *other != number {
                return Err(EditError::Refused(format!(
                    "{topic} is {} in log {} and {} with other definitions in log {}: leave one out with `pslam filter` first",
                    known.schema_name(),
                    other + 1,
                    channel.schema_name(),
                    number + 1
                )));
            }
        }
        self.channels.entry(topic.clone()).or_insert_with(|| (number, Arc::clone(channel)));
        out.open(number, channel, Some(topic))
    }

    fn record(
        &mut self,
        number: usize,
        name: &str,
        values: BTreeMap<String, String>,
        out: &mut Output,
    ) -> Result<(), EditError> {
        if [metadata::CHANNEL_PREFIX, metadata::PROVENANCE_PREFIX].iter().any(|prefix| name.starts_with(prefix)) {
            return out.keep_metadata(name, values);
        }
        let layer = name.strip_prefix(metadata::SEGMENTATION_PREFIX);
        let renamed = layer.and_then(|layer| self.layers.get(&(number, layer.to_owned())));
        let is_renamed = renamed.is_some();
        let mut name = renamed.map_or(name.to_owned(), |new| format!("{}{new}", metadata::SEGMENTATION_PREFIX));
        let differs = |name: &str| self.records.get(name).is_some_and(|known| *known != values);
        if number > 0 && differs(&name) {
            if SINGLE.contains(&name.as_str()) || layer.is_some() {
                let help = if layer.is_some() { "give one layer another name" } else { "they do not belong together" };
                let log = number + 1;
                return Err(EditError::Refused(format!(
                    "record {name} of log {log} says otherwise than before: {help}"
                )));
            }
            name = merged_name(&name, number);
        }
        let sealed = if values.contains_key(metadata::CHECKSUM_KEY) && (is_renamed || number > 0) {
            metadata::seal(&name, values)
        } else {
            values
        };
        if self.records.insert(name.clone(), sealed.clone()).as_ref() == Some(&sealed) {
            return Ok(());
        }
        out.keep_metadata(&name, sealed)
    }

    fn message(&mut self, number: usize, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
        out.begin(number, message);
        let topic = self.topic(number, message.topic());
        let data = self.contents(number, message, &topic)?;
        if !self.is_duplicate(number, &topic, message, &data)? {
            if data == message.data { out.keep(message)? } else { out.replace(message, &data)? }
        }
        out.end(message);
        Ok(())
    }

    /// A message with its layer's new name inside; states are compared with those of the other logs.
    fn contents<'m>(
        &mut self,
        number: usize,
        message: &'m RawMessage<'_>,
        topic: &str,
    ) -> Result<Cow<'m, [u8]>, EditError> {
        use topics::{COLOR_INFO, DEPTH_INFO, DEPTH_NATIVE_INFO, RIGHT_INFO};
        let error = |why: String| EditError::message(message, why);
        let new = topics::layer_of(message.topic()).and_then(|old| self.layers.get(&(number, old.to_owned()))).cloned();
        let leaf = topics::layer_of(topic).and_then(|_| topic.rsplit('/').next());
        let mut data = Cow::Borrowed(&*message.data);
        match leaf {
            Some("categories") => {
                let mut table: CategoryTable = message.decode().map_err(error)?;
                if let Some(layer) = new {
                    table.layer = layer;
                    data = Cow::Owned(table.encode());
                }
                self.state(number, topic, &CategoryTable { header: Header::default(), ..table }.encode())?;
            }
            Some("segments") => {
                if let Some(layer) = new {
                    let table: SegmentTable = message.decode().map_err(error)?;
                    data = Cow::Owned(SegmentTable { layer, ..table }.encode());
                }
            }
            _ if [COLOR_INFO, DEPTH_INFO, RIGHT_INFO, DEPTH_NATIVE_INFO].contains(&topic) => {
                let info: CameraInfo = message.decode().map_err(error)?;
                self.state(number, topic, &CameraInfo { header: Header::default(), ..info }.encode())?;
            }
            _ => {}
        }
        Ok(data)
    }

    fn state(&mut self, number: usize, topic: &str, state: &[u8]) -> Result<(), EditError> {
        if !self.shared.contains_key(topic) {
            return Ok(());
        }
        let known = self.states.entry(topic.to_owned()).or_insert_with(|| state.to_vec());
        if known == state {
            return Ok(());
        }
        let log = number + 1;
        Err(EditError::Refused(format!(
            "{topic} of log {log} says otherwise than before: these are not one camera or layer"
        )))
    }

    /// Whether another log had this very message. Another one of the same stamp is a conflict.
    fn is_duplicate(
        &mut self,
        number: usize,
        topic: &str,
        message: &RawMessage<'_>,
        data: &[u8],
    ) -> Result<bool, EditError> {
        let Some(seen) = self.shared.get_mut(topic) else { return Ok(false) };
        let stamp = message.stamp().map_err(|why| EditError::message(message, why))?;
        let hash = blake3::hash(data);
        let at_stamp = seen.entry(stamp).or_default();
        if at_stamp.contains(&hash) {
            return Ok(true);
        }
        if !at_stamp.is_empty() && !holds_several(topic) {
            let log = number + 1;
            return Err(EditError::Refused(format!(
                "{topic} at {stamp} s of log {log} is another message than before: slice or filter one of the logs first"
            )));
        }
        at_stamp.push(hash);
        Ok(false)
    }
}

fn merged_name(name: &str, number: usize) -> String {
    format!("{name}/merged/{}", number + 1)
}
