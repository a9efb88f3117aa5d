//! The one thread that writes the log, and the one that brings it to the disk.

use super::effort::Effort;
use super::encode::{Encoded, Measurement};
use super::inlet::{EndedBy, Shared};
use super::lane::{Lane, Taken, Wait};
use super::latency::Latency;
use super::ledger::Cause;
use super::stream::Stream;
use crate::sync::Gathering;
use crate::{LogWriter, WriteError};
use schemas::msg::level;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::sync::mpsc::{Receiver, SyncSender};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// What goes into the log.
pub(super) enum Item {
    /// The messages of one measurement.
    Measured { stream: Stream, counter: u64, arrival_ns: i64, messages: Vec<Encoded> },
    /// Other messages.
    Messages(Vec<Encoded>),
    /// A metadata record.
    Metadata { name: Cow<'static, str>, values: BTreeMap<String, String> },
}

/// Encodes what comes through a lane until it closes.
pub(super) fn encode_all(lane: &Lane<Measurement>, shared: &Shared) {
    let mut effort = Effort::default();
    loop {
        let measurement = match lane.pop(Duration::from_secs(1)) {
            Taken::Item(measurement) => measurement,
            Taken::Nothing => continue,
            Taken::Closed => return,
        };
        let (stream, counter) = (measurement.stream, measurement.counter);
        if stream == Stream::Color
            && let Some(text) = effort.look(shared.encoder.encoding(), lane.load(), shared.outbox.load())
        {
            shared.event(level::WARN, "color.encoding", text);
        }
        let stamp = measurement.picture_stamp();
        match shared.encoder.encode(&measurement, effort.packing()) {
            Ok(messages) => {
                let arrival_ns = measurement.arrival.monotonic_ns;
                drop(measurement);
                let weight = messages.iter().map(|message| message.bytes.len()).sum();
                let item = Item::Measured { stream, counter, arrival_ns, messages };
                // The disk is slower: the encoder waits, its lane fills, and the lane gives up the oldest.
                for lost in shared.outbox.push(item, weight, Wait::Forever) {
                    shared.unwritten(&lost);
                }
            }
            Err(error) => {
                shared.event(level::ERROR, "measurement.unfit", &error.to_string());
                shared.lost(&measurement, Cause::Disk);
            }
        }
        if let (Stream::Color, Some(labels), Some(stamp)) = (stream, &shared.labels, stamp) {
            labels.passed(stamp);
        }
    }
}

impl Shared {
    /// An item that the log did not take.
    fn unwritten(&self, item: &Item) {
        if let Item::Measured { stream, counter, .. } = item {
            let loss = self.book().ledger.lost(*stream, Cause::Disk, *counter);
            self.record_loss(loss);
        }
    }
}

/// The writer's side of the status.
#[derive(Default)]
pub(super) struct Progress {
    pub bytes: u64,
    pub latency: Latency,
    /// What the synchronisation needs of what was written.
    pub signals: Gathering,
}

/// The writing thread.
pub(super) struct Scribe<'a> {
    pub shared: &'a Shared,
    pub progress: &'a Mutex<Progress>,
    pub flush_interval: Duration,
    /// Wakes the thread that brings the file to the disk.
    pub sync: SyncSender<()>,
}

impl Scribe<'_> {
    /// Writes everything that comes; returns the log when the outbox is closed and empty. After a failure the log is left
    /// as it is, and all that follows is counted as lost.
    pub fn write_all(&self, mut log: LogWriter) -> Option<LogWriter> {
        match self.write_until_closed(&mut log) {
            Ok(()) => Some(log),
            Err(error) => {
                self.shared.end(EndedBy::WriteFailed(error.to_string()));
                self.shared.book().ledger.torn();
                for item in self.shared.outbox.abandon() {
                    self.shared.unwritten(&item);
                }
                None
            }
        }
    }

    fn write_until_closed(&self, log: &mut LogWriter) -> Result<(), WriteError> {
        // Twice an interval: what arrives just before a flush may still be with its encoder.
        let pace_ns = self.flush_interval.as_nanos() as i64 / 2;
        let mut flushed_ns = self.shared.clock.now().monotonic_ns;
        let mut pending: Vec<i64> = Vec::new();
        loop {
            let now_ns = self.shared.clock.now().monotonic_ns;
            let left_ns = (flushed_ns + pace_ns - now_ns).clamp(0, pace_ns.max(0));
            if left_ns == 0 {
                log.close_chunk()?;
                flushed_ns = now_ns;
                self.settle(log, &mut pending);
                self.shared.book().ledger.flushed();
                // Full: the disk still works at the one before.
                let _ = self.sync.try_send(());
                continue;
            }
            let bytes = log.bytes();
            match self.shared.outbox.pop(Duration::from_nanos(left_ns.unsigned_abs())) {
                Taken::Closed => return Ok(()),
                Taken::Nothing => {}
                Taken::Item(item) => self.write(log, &item, bytes, &mut pending)?,
            }
            if log.is_disk_full() && !self.shared.is_stopping() {
                self.shared.end(EndedBy::DiskFull);
            }
        }
    }

    fn write(&self, log: &mut LogWriter, item: &Item, bytes: u64, pending: &mut Vec<i64>) -> Result<(), WriteError> {
        let messages = match item {
            Item::Metadata { name, values } => return log.metadata(name, values.clone()),
            Item::Messages(messages) | Item::Measured { messages, .. } => messages,
        };
        if let Err(error) = append(log, messages) {
            self.shared.unwritten(item);
            return Err(error);
        }
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        // Our own messages can be decoded.
        messages.iter().for_each(|message| drop(progress.signals.take(&message.topic, &message.bytes)));
        drop(progress);
        if log.bytes() != bytes {
            // A chunk was closed: what came before this item is in the file.
            self.settle(log, pending);
        }
        if let Item::Measured { stream, arrival_ns, .. } = item {
            pending.push(*arrival_ns);
            self.shared.book().ledger.written(*stream);
        }
        Ok(())
    }

    /// Takes the time of everything that is in the file now.
    fn settle(&self, log: &LogWriter, pending: &mut Vec<i64>) {
        let now_ns = self.shared.clock.now().monotonic_ns;
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        progress.bytes = log.bytes();
        pending.drain(..).for_each(|arrival_ns| progress.latency.add(now_ns - arrival_ns));
    }
}

/// Appends encoded messages.
pub(super) fn append(log: &mut LogWriter, messages: &[Encoded]) -> Result<(), WriteError> {
    for message in messages {
        let channel = (message.open)(log, &message.topic)?;
        log.append(channel, message.log_time, message.publish_time, &message.bytes)?;
    }
    Ok(())
}

/// Brings the file to the disk each time it is told to, until the teller is gone; its speed holds nobody up.
pub(super) fn sync_all(file: &File, told: &Receiver<()>, shared: &Shared) {
    while told.recv().is_ok() {
        if let Err(error) = file.sync_data() {
            shared.end(EndedBy::WriteFailed(format!("the disk did not take what was written: {error}")));
        }
    }
}
