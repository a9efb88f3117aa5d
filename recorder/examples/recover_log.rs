//! Recovers a damaged log: `cargo run --release -p recorder --example recover_log -- DAMAGED OUT`.

use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [damaged, out] = arguments.as_slice() else {
        return Err("usage: recover_log DAMAGED OUT".into());
    };
    let report = recorder::recover::recover(Path::new(damaged), Path::new(out), false)?;
    print!("{report}");
    if report.lossy { Err("the recovery is lossy".into()) } else { Ok(()) }
}
