//! Progress bars on standard error.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Whether progress is shown.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    shown: bool,
}

impl Progress {
    /// Shown only if `wanted`, and if standard error is a terminal.
    #[must_use]
    pub fn new(wanted: bool) -> Self {
        Self { shown: wanted }
    }

    /// Whether progress is wanted at all.
    #[must_use]
    pub fn is_shown(self) -> bool {
        self.shown
    }

    /// A bar for one piece of work; its length is told by [`update`].
    pub fn bar(self, what: &'static str) -> ProgressBar {
        let target = if self.shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(0), target).with_message(what);
        let style = ProgressStyle::with_template("{msg:<20} {bar:30} {pos:>6}/{len} {per_sec:>12} {eta:>5} left");
        bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
    }
}

/// `done` of `all`.
pub fn update(bar: &ProgressBar, done: usize, all: usize) {
    bar.set_length(all as u64);
    bar.set_position(done as u64);
}
