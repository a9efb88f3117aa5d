//! A source that is kept alive.

use super::{MocapError, MocapFrame, MocapSource};
use crate::Arrival;
use std::time::Duration;

/// Pauses between attempts to connect: each twice the one before, up to the longest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Backoff {
    /// First pause.
    pub first: Duration,
    /// Longest pause.
    pub longest: Duration,
    /// A connection that says nothing for so long is given up: a half-open one would stay silent for ever.
    pub silence: Duration,
}

impl Default for Backoff {
    fn default() -> Self {
        // A server restart takes seconds; more often than ten times a second helps nobody, and after a pause of more
        // than two seconds a person believes that it hangs. The silence is the SDK's own connection timeout.
        Self { first: Duration::from_millis(100), longest: Duration::from_secs(2), silence: Duration::from_secs(5) }
    }
}

/// What happened on a link.
#[derive(Debug)]
pub enum LinkEvent {
    /// Connected, for the first time or again.
    Connected,
    /// A frame.
    Frame(Box<MocapFrame>),
    /// Nothing within the timeout.
    Idle,
    /// The connection was lost; it will be tried again.
    Lost(MocapError),
    /// An attempt to connect failed; it will be tried again after the pause.
    Refused {
        /// Why.
        error: MocapError,
        /// Until the next attempt.
        pause: Duration,
    },
}

/// A source that connects by itself, and again after each loss.
pub struct Link {
    source: Box<dyn MocapSource>,
    backoff: Backoff,
    connected: bool,
    pause: Duration,
    /// Monotonic time before which no attempt is made.
    not_before_ns: i64,
    /// Monotonic time of the last sign of life.
    heard_ns: i64,
}

impl Link {
    /// A link that is not connected yet.
    #[must_use]
    pub fn new(source: Box<dyn MocapSource>, backoff: Backoff) -> Self {
        Self { source, backoff, connected: false, pause: backoff.first, not_before_ns: 0, heard_ns: 0 }
    }

    /// The source's kind and address.
    #[must_use]
    pub fn describe(&self) -> String {
        self.source.describe()
    }

    /// Waits for something to happen. An attempt to connect may take the source's own timeout, all else at most `timeout`.
    pub fn next(&mut self, timeout: Duration) -> LinkEvent {
        if !self.connected {
            return self.attempt(timeout);
        }
        let event = match self.source.next_frame(timeout) {
            Ok(Some(frame)) => LinkEvent::Frame(Box::new(frame)),
            Err(error) => LinkEvent::Lost(error),
            Ok(None) if now_ns() - self.heard_ns > nanos(self.backoff.silence) => {
                LinkEvent::Lost(MocapError::Silent { address: self.describe(), waited: self.backoff.silence })
            }
            Ok(None) => return LinkEvent::Idle,
        };
        self.heard_ns = now_ns();
        self.connected = matches!(event, LinkEvent::Frame(_));
        if self.connected {
            self.pause = self.backoff.first;
        } else {
            self.rest();
        }
        event
    }

    fn attempt(&mut self, timeout: Duration) -> LinkEvent {
        let wait_ns = self.not_before_ns - now_ns();
        if wait_ns > 0 {
            std::thread::sleep(Duration::from_nanos(wait_ns.unsigned_abs()).min(timeout));
            return LinkEvent::Idle;
        }
        match self.source.connect() {
            Ok(()) => {
                (self.connected, self.heard_ns) = (true, now_ns());
                LinkEvent::Connected
            }
            Err(error) => LinkEvent::Refused { error, pause: self.rest() },
        }
    }

    /// Begins a pause; only a frame makes the next one short again, so that a server that accepts and hangs up is not
    /// asked without end.
    fn rest(&mut self) -> Duration {
        let pause = self.pause;
        self.not_before_ns = now_ns().saturating_add(nanos(pause));
        self.pause = (pause * 2).min(self.backoff.longest);
        pause
    }
}

fn now_ns() -> i64 {
    Arrival::now().monotonic_ns
}

fn nanos(duration: Duration) -> i64 {
    duration.as_nanos().try_into().unwrap_or(i64::MAX)
}
