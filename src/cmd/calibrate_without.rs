//! `pslam calibrate` in a build that cannot: it says what to do.

use crate::progress::Progress;
use crate::{Outcome, Usage};
use std::ffi::OsString;

/// Whatever was asked for.
#[derive(Debug, clap::Args)]
pub struct Calibrate {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

impl Calibrate {
    #[expect(clippy::unused_self, reason = "the form of all commands")]
    pub(super) fn run(self, _progress: Progress) -> anyhow::Result<Outcome> {
        let what = "this pslam was built without OpenCV, which finds the board: cargo build --release --features opencv \
            (docs/recording.md says what that needs)";
        Err(Usage(what.to_owned()).into())
    }
}
