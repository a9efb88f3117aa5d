//! Replays a log as the program does:
//! `cargo run --release -p replayer --no-default-features --example replay -- replay LOG RUN [THREADS [PRESET]]`, or
//! `verify RUN`, `diff RUN RUN`, `bench LOG [THREADS [PRESET]]`.

use std::error::Error;
use std::path::Path;

use replayer::run::{ReplayOptions, bench, diff, replay, verify};
use slam::Config;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let options = |rest: &[&str]| -> Result<ReplayOptions, Box<dyn Error>> {
        let threads = rest.first().map_or(Ok(1), |threads| threads.parse())?;
        let preset = rest.get(1).copied().unwrap_or("full");
        let config = Config::preset(preset)?;
        Ok(ReplayOptions { config, config_name: preset.to_owned(), threads, ..ReplayOptions::default() })
    };
    let quiet = &mut |_, _| {};
    match args.as_slice() {
        ["replay", log, run, rest @ ..] => {
            println!("{}", replay(Path::new(log), Path::new(run), &options(rest)?, quiet)?);
        }
        ["bench", log, rest @ ..] => println!("{}", bench(Path::new(log), &options(rest)?, quiet)?),
        ["verify", run] => println!("{}", verify(Path::new(run), None, 2, quiet)?),
        ["diff", a, b] => println!("{}", diff(Path::new(a), Path::new(b))?),
        _ => return Err("wanted: replay LOG RUN | bench LOG | verify RUN | diff RUN RUN".into()),
    }
    Ok(())
}
