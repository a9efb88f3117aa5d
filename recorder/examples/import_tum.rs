//! Imports a TUM-style folder: `cargo run --release -p recorder --example import_tum -- FOLDER LOG [PANOPTIC_FOLDER]`.

use recorder::import::{PanopticSource, TumOptions, tum};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, log, panoptic @ ..] = arguments.as_slice() else {
        return Err("usage: import_tum FOLDER LOG [PANOPTIC_FOLDER]".into());
    };
    let panoptic = panoptic.iter().map(|dir| PanopticSource::new(Path::new(dir))).collect();
    let options = TumOptions { panoptic, ..TumOptions::default() };
    let report = tum(Path::new(folder), Path::new(log), &options, &mut |_, _| {})?;
    print!("{report}");
    Ok(())
}
