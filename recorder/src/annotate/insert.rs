//! The edit that puts labels into a log, each behind what has its picture's stamp.

use super::journal::{Entry, Reader};
use super::pictures::is_picture;
use crate::edit::{Edit, EditError, Output, RawMessage};
use crate::layer::{Layer, Sink};
use schemas::{Message, Stamp};
use std::collections::BTreeMap;

pub struct Insert {
    layer: Layer,
    /// The layer's description, until it is written.
    record: Option<BTreeMap<String, String>>,
    labels: Reader,
    /// Labels whose picture is in the log, with their publish time.
    held: Option<(Entry, Stamp)>,
}

impl Insert {
    pub fn new(layer: Layer, record: BTreeMap<String, String>, labels: Reader) -> Self {
        Self { layer, record: Some(record), labels, held: None }
    }

    fn release(&mut self, out: &mut Output) -> Result<(), EditError> {
        match self.held.take() {
            Some((Entry { stamp, size, mask: Some(mask), .. }, publish)) => {
                self.layer.write(out, (stamp, publish), size.0, &mask)
            }
            _ => Ok(()),
        }
    }
}

impl Sink for Output {
    type Error = EditError;

    fn put<'a, M: Message<'a>>(&mut self, topic: &str, times: (Stamp, Stamp), message: &M) -> Result<(), EditError> {
        self.insert(topic, times.0, times.1, message)
    }
}

impl Edit for Insert {
    fn message(&mut self, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
        if let Some(record) = self.record.take() {
            out.metadata(&self.layer.record_name(), record)?;
        }
        if self.held.as_ref().is_some_and(|(entry, _)| message.log_time > entry.stamp || is_picture(message.topic())) {
            self.release(out)?;
        }
        out.keep(message)?;
        if is_picture(message.topic()) {
            let next = self.labels.next().map_err(|error| EditError::Refused(format!("finished labels: {error}")))?;
            self.held = next.map(|entry| (entry, message.publish_time));
            let stamp = message.stamp().map_err(|reason| EditError::message(message, reason))?;
            if self.held.as_ref().is_some_and(|(entry, _)| entry.stamp != stamp) {
                return Err(EditError::message(message, "the log has changed since its pictures were labelled"));
            }
        }
        Ok(())
    }

    fn finish(&mut self, out: &mut Output) -> Result<(), EditError> {
        self.release(out)
    }
}
