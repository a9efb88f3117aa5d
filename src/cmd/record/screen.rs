//! How a recording goes, for people and programs.

use crate::progress::Progress;
use crate::stdout;
#[cfg(feature = "rerun")]
use recorder::capture::Onlooker;
use recorder::capture::{Happening, Status, Verdict};
use schemas::msg::level;
use std::io::{IsTerminal as _, Write as _, stderr};
#[cfg(feature = "rerun")]
use std::{path::Path, sync::Arc};

/// Without a terminal, a line in so many seconds: for the log of a service.
const SECONDS_A_LINE: u32 = 10;

/// Where it is told.
pub struct Screen {
    json: bool,
    shown: bool,
    terminal: bool,
    seconds: u32,
    #[cfg(feature = "rerun")]
    preview: Option<super::view::Preview>,
}

impl Screen {
    pub fn new(json: bool, progress: Progress) -> Self {
        Self {
            json,
            shown: progress.is_shown(),
            terminal: stderr().is_terminal(),
            seconds: 0,
            #[cfg(feature = "rerun")]
            preview: None,
        }
    }

    /// Shows the recording in a viewer too, for which it gets an onlooker.
    #[cfg(feature = "rerun")]
    pub fn preview(&mut self, address: &rrd::ViewerAddress, log: &Path) -> anyhow::Result<Arc<dyn Onlooker>> {
        let now = recorder::Arrival::now().realtime_ns / 1_000_000_000;
        let name = format!("{} {now}", log.file_stem().unwrap_or_default().to_string_lossy());
        let preview = super::view::Preview::new(address, &name)?;
        let onlooker = preview.onlooker();
        self.preview = Some(preview);
        Ok(onlooker)
    }

    pub fn status(&mut self, status: &Status) {
        if self.json {
            // Nobody reads any more: the recording goes on.
            let _ = stdout::json_line("record-status/1", status);
        }
        status.happenings.iter().for_each(|happening| self.happening(happening));
        #[cfg(feature = "rerun")]
        if let Some(preview) = &mut self.preview {
            preview.status(status);
        }
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

    pub fn verdict(&mut self, verdict: &Verdict) -> anyhow::Result<()> {
        if self.terminal && self.shown {
            let _ = writeln!(stderr().lock());
        }
        #[cfg(feature = "rerun")]
        if let Some(preview) = self.preview.take() {
            let _ = writeln!(stderr().lock(), "{}", preview.end());
        }
        if self.json { stdout::json_line("record/1", verdict) } else { stdout::text(verdict) }
    }
}
