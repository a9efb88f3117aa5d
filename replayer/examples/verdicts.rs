//! Judges the keypoint verdicts of a replay by exact masks of the movers:
//! `cargo run --release -p replayer --example verdicts -- LOG MOVERS_GT_DIR [PRESET] [--json]`.
//!
//! `MOVERS_GT_DIR/T.png` (8 bit grey) tells which mover each pixel of the picture at `T` seconds shows, 0 the static
//! scene. `movers.json` beside the folder tells in which frames a mover moves; without it all of them always do.

#[path = "verdicts/steps.rs"]
mod steps;
#[path = "verdicts/summary.rs"]
mod summary;
#[path = "verdicts/truth.rs"]
mod truth;

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use schemas::Stamp;
use slam::{Config, FrameReport};
use summary::{Count, ParkedFrame, Parking, Summary};
use truth::Truth;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Sums over the frames so far.
#[derive(Default)]
struct Tally {
    frames: u32,
    tracked: u32,
    static_scene: Count,
    /// By mover, while it moves.
    moving: BTreeMap<u8, Count>,
    /// By mover, the frame after the last one that shows it moving.
    moved_until: BTreeMap<u8, u32>,
    /// By mover and its `moved_until`.
    parked: BTreeMap<(u8, u32), Vec<ParkedFrame>>,
}

impl Tally {
    fn frame(&mut self, report: &FrameReport, truth: &Truth, size: (u32, u32)) -> Result<()> {
        let (frame, stamp) = (report.id.0, Stamp(report.stamp.0));
        let (mask, moving) = (truth.mask(stamp, size)?, truth.moving(stamp)?);
        let mut counts = [None; 256];
        mask.iter().for_each(|mover| counts[usize::from(*mover)] = Some(Count::default()));
        for keypoint in &report.keypoints {
            // The nearest pixel, as for the labels.
            let [x, y] = keypoint.pixel.map(|coordinate| (coordinate + 0.5) as usize);
            let mover = mask.get(y * size.0 as usize + x).ok_or("a keypoint lies outside the picture")?;
            counts[usize::from(*mover)].get_or_insert_default().add(keypoint);
        }
        self.frames += 1;
        self.tracked += u32::from(report.camera_from_world.is_some());
        self.static_scene = [&self.static_scene, &counts[0].unwrap_or_default()].into_iter().sum();
        for (mover, count) in (1..=u8::MAX).filter_map(|mover| Some((mover, counts[usize::from(mover)]?))) {
            let moves = moving.map_or(Some(&true), |moving| moving.get(&mover));
            if *moves.ok_or_else(|| format!("the mask shows mover {mover}, which movers.json does not list"))? {
                let sum = self.moving.entry(mover).or_default();
                *sum = [&*sum, &count].into_iter().sum();
                self.moved_until.insert(mover, frame + 1);
            } else {
                let since = self.moved_until.get(&mover).copied().unwrap_or(0);
                self.parked.entry((mover, since)).or_default().push(ParkedFrame { frame, stamp, count });
            }
        }
        Ok(())
    }

    fn finish(self) -> Summary {
        let parkings = self.parked.into_iter().map(|((mover, _), frames)| Parking::new(mover, frames)).collect();
        Summary::new((self.frames, self.tracked), self.static_scene, self.moving, parkings)
    }
}

fn main() -> ExitCode {
    let Err(error) = judge() else { return ExitCode::SUCCESS };
    eprintln!("{error}");
    ExitCode::FAILURE
}

fn judge() -> Result<()> {
    let mut args: Vec<String> = std::env::args().skip(1).collect();
    let json = args.iter().any(|arg| arg == "--json");
    args.retain(|arg| arg != "--json");
    let (log, masks, preset) = match args.as_slice() {
        [log, masks] => (log, masks, "full"),
        [log, masks, preset] => (log, masks, preset.as_str()),
        _ => return Err("wanted: LOG MOVERS_GT_DIR [PRESET] [--json]".into()),
    };
    let (config, truth) = (Config::preset(preset)?, Truth::open(Path::new(masks))?);
    let mut tally = Tally::default();
    steps::for_each_report(Path::new(log), &config, &mut |report, _, _, size| tally.frame(report, &truth, size))?;
    let summary = tally.finish();
    if json {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        print!("{log}, preset {preset}: {summary}");
    }
    Ok(())
}
