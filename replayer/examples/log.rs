//! Reads a log as the program does: `cargo run -p replayer --example log -- info|json|check|read LOG`.

use std::error::Error;
use std::path::Path;

use replayer::log::{Log, check, decode};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [what, path] = args.as_slice() else { return Err("wanted: info|json|check|read LOG".into()) };
    let path = Path::new(path);
    match what.as_str() {
        "info" => print!("{}", Log::open(path)?.info()),
        "json" => println!("{}", serde_json::to_string_pretty(&Log::open(path)?.info())?),
        "check" => print!("{}", check(path)?),
        "read" => {
            let log = Log::open(path)?;
            let timeline = log.timeline(log.default_layer())?;
            let camera = log.camera()?;
            let (mut with_depth, mut with_mask) = (0, 0);
            for frame in timeline.stream(0..usize::MAX)? {
                let frame = decode(&frame?, &camera)?;
                with_depth += usize::from(frame.depth.is_some());
                with_mask += usize::from(frame.mask.is_some());
            }
            println!("{} frames, {with_depth} with depth, {with_mask} with a mask", timeline.frames().len());
        }
        other => return Err(format!("'{other}' is not info, json, check or read").into()),
    }
    Ok(())
}
