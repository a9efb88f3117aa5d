//! How often does a frame ask for memory? `cargo run --release -p replayer --example allocations -- LOG`
//!
//! Allocations of the steps of the second half of a log, a frame on average: those of features, those of each piece of work
//! inside a frame, and the bytes asked for. Background jobs run inline and count under `jobs`.

#[path = "../../slam/tests/counting/mod.rs"]
mod counting;
#[path = "verdicts/steps.rs"]
mod steps;

use std::path::Path;
use std::process::ExitCode;

use slam::{Config, Observer, Work};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Pieces: features, then [`Work::ALL`].
#[derive(Default)]
struct Tally {
    last: [u64; 2],
    /// Calls and bytes of each piece, all frames so far.
    pieces: [[u64; 2]; 1 + Work::ALL.len()],
}

impl Tally {
    fn lap(&mut self) -> [u64; 2] {
        let now = counting::asked();
        let before = std::mem::replace(&mut self.last, now);
        [now[0] - before[0], now[1] - before[1]]
    }

    fn add(&mut self, piece: usize) {
        let lap = self.lap();
        (0..2).for_each(|i| self.pieces[piece][i] += lap[i]);
    }
}

impl Observer for Tally {
    fn done(&mut self, work: Work) {
        self.add(1 + Work::ALL.iter().position(|w| *w == work).unwrap_or_default());
    }
}

impl steps::Watch for Tally {
    fn frame_begins(&mut self) {
        self.lap();
    }

    fn features_done(&mut self) {
        self.add(0);
    }
}

fn run() -> Result<()> {
    let log = std::env::args().nth(1).ok_or("usage: allocations LOG")?;
    let frames = steps::frame_count(Path::new(&log))?;
    let mut tally = Tally::default();
    let (mut at_half, mut seen) = (Tally::default().pieces, 0);
    steps::watch_each_report(Path::new(&log), &Config::default(), &mut tally, &mut |_, _, _, _, tally| {
        seen += 1;
        if seen == frames / 2 {
            at_half = tally.pieces;
        }
        Ok(())
    })?;
    let counted = (frames - frames / 2) as f64;
    println!("{:<16}{:>14}{:>12}", "a frame", "allocations", "KiB");
    let names = std::iter::once("features").chain(Work::ALL.iter().map(|work| work.name()));
    let mut sum = [0.0; 2];
    for ((name, now), before) in names.zip(&tally.pieces).zip(&at_half) {
        let [calls, bytes] = [0, 1].map(|i| (now[i] - before[i]) as f64 / counted);
        println!("{name:<16}{calls:>14.1}{:>12.1}", bytes / 1024.0);
        (sum[0], sum[1]) = (sum[0] + calls, sum[1] + bytes / 1024.0);
    }
    println!("{:<16}{:>14.1}{:>12.1}", "all", sum[0], sum[1]);
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
