//! How a recording goes, for people and programs.

use crate::progress::Progress;
use crate::stdout;
use recorder::capture::{Happening, Status, Verdict};
use schemas::msg::level;
use serde::Serialize;
use std::io::{IsTerminal as _, Write as _, stderr};

/// Without a terminal, a line in so many seconds: for the log of a service.
const SECONDS_A_LINE: u32 = 10;

/// Where it is told.
pub struct Screen {
    json: bool,
    shown: bool,
    terminal: bool,
    seconds: u32,
}

impl Screen {
    pub fn new(json: bool, progress: Progress) -> Self {
        Self { json, shown: progress.is_shown(), terminal: stderr().is_terminal(), seconds: 0 }
    }

    pub fn status(&mut self, status: &Status) {
        if self.json {
            // Nobody reads any more: the recording goes on.
            let _ = line(status);
        }
        status.happenings.iter().for_each(|happening| self.happening(happening));
        if !self.shown {
            return;
        }
        let mut err = stderr().lock();
        // Nothing can be done about a closed standard error.
        if self.terminal {
            let _ = write!(err, "\r{status}\x1b[K");
            let _ = err.flush();
        } else if self.seconds.is_multiple_of(SECONDS_A_LINE) {
            let _ = writeln!(err, "{status}");
        }
        self.seconds += 1;
    }

    fn happening(&self, happening: &Happening) {
        let Happening { level, name, text, .. } = happening;
        let word = match *level {
            level::ERROR => "error",
            level::WARN => "warning",
            _ => return,
        };
        let _ = writeln!(stderr().lock(), "{}{word}: {name}: {text}", if self.terminal { "\r\x1b[K" } else { "" });
    }

    pub fn verdict(&self, verdict: &Verdict) -> anyhow::Result<()> {
        if self.terminal && self.shown {
            let _ = writeln!(stderr().lock());
        }
        if self.json { line(verdict) } else { stdout::text(verdict) }
    }
}

/// One line of JSON.
fn line(value: &impl Serialize) -> anyhow::Result<()> {
    stdout::text(&serde_json::to_string(value)?)
}
