//! Who lost what: every measurement that a stream's counter tells of is either in the log or in here.

use super::stream::Stream;
use serde::Serialize;

/// Who lost a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Cause {
    /// The sensor or the way from it: it never reached this program.
    Device,
    /// This program: its queue was full.
    Queue,
    /// This program: the log could not take it.
    Disk,
}

impl Cause {
    /// Name in the log.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Device => "device",
            Self::Queue => "queue",
            Self::Disk => "disk",
        }
    }
}

/// A run of lost measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loss {
    /// Stream.
    pub stream: Stream,
    /// Who lost them.
    pub cause: Cause,
    /// Counter of the first.
    pub first: u64,
    /// Counter of the last.
    pub last: u64,
    /// How many.
    pub count: u64,
}

/// Counts of one stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// Came in.
    pub received: u64,
    /// Stand in the log.
    pub written: u64,
    /// Survive the death of this process.
    pub flushed: u64,
    /// Lost before they came in.
    pub dropped_device: u64,
    /// Lost by this program.
    pub dropped_host: u64,
    /// Times that the counter began anew or repeated itself.
    pub restarts: u64,
}

/// What a counter says about a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The next one, or the first.
    Next,
    /// Some are missing before it.
    Gap(Loss),
    /// The counter went back or stood still: from this to that.
    Back(u64, u64),
}

/// The book of a recording.
#[derive(Debug, Clone, Default)]
pub struct Ledger {
    counts: [Counts; Stream::ALL.len()],
    last: [Option<u64>; Stream::ALL.len()],
}

impl Ledger {
    /// A measurement came in with this counter; `None` if its source does not count.
    pub fn received(&mut self, stream: Stream, counter: Option<u64>) -> Step {
        let counts = &mut self.counts[stream.index()];
        counts.received += 1;
        let Some(counter) = counter else { return Step::Next };
        match self.last[stream.index()].replace(counter) {
            Some(last) if counter <= last => {
                counts.restarts += 1;
                Step::Back(last, counter)
            }
            Some(last) if counter > last + 1 => {
                let count = counter - last - 1;
                counts.dropped_device += count;
                Step::Gap(Loss { stream, cause: Cause::Device, first: last + 1, last: counter - 1, count })
            }
            _ => Step::Next,
        }
    }

    /// A gap in time where the counter shows none: `count` measurements never came.
    pub fn missing(&mut self, stream: Stream, counter: u64, count: u64) -> Loss {
        self.counts[stream.index()].dropped_device += count;
        Loss { stream, cause: Cause::Device, first: counter, last: counter, count }
    }

    /// A new connection: the next counter follows nothing.
    pub fn reconnected(&mut self, streams: &[Stream]) {
        streams.iter().for_each(|stream| self.last[stream.index()] = None);
    }

    /// This program lost a measurement that had come in.
    pub fn lost(&mut self, stream: Stream, cause: Cause, counter: u64) -> Loss {
        self.counts[stream.index()].dropped_host += 1;
        Loss { stream, cause, first: counter, last: counter, count: 1 }
    }

    /// A measurement stands in the log.
    pub fn written(&mut self, stream: Stream) {
        self.counts[stream.index()].written += 1;
    }

    /// Everything written so far has left this process.
    pub fn flushed(&mut self) {
        self.counts.iter_mut().for_each(|counts| counts.flushed = counts.written);
    }

    /// The log broke off: what was not flushed is counted as lost by this program.
    pub fn torn(&mut self) {
        for counts in &mut self.counts {
            counts.dropped_host += counts.written - counts.flushed;
            counts.written = counts.flushed;
        }
    }

    /// Counts of a stream.
    #[must_use]
    pub fn counts(&self, stream: Stream) -> Counts {
        self.counts[stream.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_counter_is_accounted_for() {
        let mut ledger = Ledger::default();
        assert_eq!(ledger.received(Stream::Color, Some(7)), Step::Next);
        assert_eq!(ledger.received(Stream::Color, Some(8)), Step::Next);
        let gap = Loss { stream: Stream::Color, cause: Cause::Device, first: 9, last: 11, count: 3 };
        assert_eq!(ledger.received(Stream::Color, Some(12)), Step::Gap(gap));
        assert_eq!(ledger.received(Stream::Depth, Some(100)), Step::Next, "streams count on their own");
        assert_eq!(ledger.received(Stream::Color, Some(3)), Step::Back(12, 3));
        assert_eq!(ledger.received(Stream::Color, Some(4)), Step::Next);
        ledger.reconnected(&[Stream::Color]);
        assert_eq!(ledger.received(Stream::Color, Some(40)), Step::Next);
        assert_eq!(ledger.received(Stream::Color, None), Step::Next);
        ledger.lost(Stream::Color, Cause::Queue, 4);
        ledger.written(Stream::Color);
        ledger.flushed();
        let counts = Counts { received: 7, written: 1, flushed: 1, dropped_device: 3, dropped_host: 1, restarts: 1 };
        assert_eq!(ledger.counts(Stream::Color), counts);
    }
}
