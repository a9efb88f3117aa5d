//! `pslam record`.

mod camera;
mod mocap;
mod quantity;
mod screen;
mod segment;
mod synthetic;
#[cfg(feature = "rerun")]
mod view;

use crate::progress::Progress;
use crate::{Outcome, Usage};
use camera::CameraArgs;
use mocap::MocapArgs;
use quantity::{bytes, seconds};
use recorder::capture::{self, Allowed, Limits, Onlooker, RecordOptions, Source, SystemClock, record};
use screen::Screen;
use segment::SegmentArgs;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Record {
    /// The log to write.
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    mocap: MocapArgs,
    /// End after so long, counted from the first measurement, as 90, 90s, 5m, 1h; default: at Ctrl-C.
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    duration: Option<Duration>,
    /// End when the disk has no more room than this, as 500M, 2G.
    #[arg(long, value_name = "SIZE", default_value = "1G", value_parser = bytes)]
    reserve: u64,
    /// What a crash of this program may cost at most.
    #[arg(long, value_name = "TIME", default_value = "1", value_parser = seconds)]
    flush_interval: Duration,
    /// How colour is packed: auto leaves compression out while it cannot keep up with the camera; raw compresses nothing,
    /// for three times the bytes and a fifth of the processor's time.
    #[arg(long, value_enum, default_value = "auto", value_name = "HOW")]
    encoding: Encoding,
    /// The same as --encoding raw.
    #[arg(long, conflicts_with = "encoding")]
    raw: bool,
    /// Show a preview in a running Rerun viewer; it slows nothing down.
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "rerun+http://127.0.0.1:9876/proxy")]
    view: Option<rrd::ViewerAddress>,
    #[command(flatten)]
    segment: SegmentArgs,
    /// Do not estimate clocks and offsets at the end.
    #[arg(long)]
    no_sync: bool,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print how it goes as JSON, a line a second, and the verdict as the last line.
    #[arg(long)]
    json: bool,
}

/// How colour is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Encoding {
    /// PNG, without compression while that cannot keep up.
    Auto,
    /// PNG, always compressed.
    Png,
    /// Raw pixels.
    Raw,
}

impl Record {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        if self.flush_interval < Duration::from_millis(20) {
            return Err(Usage("--flush-interval below 20 ms writes more overhead than data".to_owned()).into());
        }
        if self.duration == Some(Duration::ZERO) {
            return Err(Usage("--duration 0 records nothing".to_owned()).into());
        }
        let stop = stop_signals()?;
        let labelling = self.segment.labelling()?;
        let camera = self.camera.source(progress)?;
        let sources: Vec<Box<dyn Source>> = camera.into_iter().chain(self.mocap.source()?).collect();
        if sources.is_empty() {
            return Err(Usage("there is nothing to record: neither a camera nor motion capture".to_owned()).into());
        }
        let mut screen = Screen::new(self.json, progress);
        let options = RecordOptions { onlookers: self.onlookers(&mut screen)?, labelling, ..self.options() };
        let stopped = || stop.load(Ordering::Relaxed);
        let verdict = record(sources, &options, Arc::new(SystemClock), &stopped, &mut |status| screen.status(status))?;
        screen.verdict(&verdict)?;
        Ok(Outcome::from_good(verdict.complete))
    }

    #[cfg(feature = "rerun")]
    fn onlookers(&self, screen: &mut Screen) -> anyhow::Result<Vec<Arc<dyn Onlooker>>> {
        self.view.iter().map(|address| screen.preview(address, &self.out)).collect()
    }

    #[cfg(not(feature = "rerun"))]
    fn onlookers(&self, _: &mut Screen) -> anyhow::Result<Vec<Arc<dyn Onlooker>>> {
        Ok(Vec::new())
    }

    fn options(&self) -> RecordOptions {
        RecordOptions {
            path: self.out.clone(),
            force: self.force,
            flush_interval: self.flush_interval,
            duration: self.duration,
            reserve_bytes: self.reserve,
            encoding: match (self.raw, self.encoding) {
                (true, _) | (_, Encoding::Raw) => capture::Encoding::Raw,
                (_, Encoding::Auto) => capture::Encoding::Auto,
                (_, Encoding::Png) => capture::Encoding::Compressed,
            },
            synchronise: !self.no_sync,
            allowed: Allowed { missing_metadata: self.camera.allow_missing_metadata },
            limits: Limits::default(),
            onlookers: Vec::new(),
            labelling: None,
            program: concat!("pslam ", env!("CARGO_PKG_VERSION")).to_owned(),
            asked: self.camera.asked().into_iter().chain(self.mocap.asked()).collect(),
        }
    }
}

/// Set by Ctrl-C, `kill` and a closed terminal: the log is closed properly. A second one ends the program at once.
fn stop_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    // A file that may not grow any more is an error of `write`, not the end of the program.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    Ok(stop)
}

/// Name and value for the log.
fn asked(entries: &[(&str, String)]) -> BTreeMap<String, String> {
    entries.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect()
}
