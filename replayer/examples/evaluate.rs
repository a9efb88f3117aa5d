//! Judges one TUM trajectory by another and prints the result as JSON:
//! `cargo run -p replayer --example evaluate -- TRUTH ESTIMATE [se3|sim3|none] [MAX_DIFFERENCE_S] [all] [1f 0.5m 2s ...]`.

use std::error::Error;
use std::path::Path;

use replayer::eval::{Alignment, DeltaUnit, EvalOptions, RpeOptions, Trajectory, evaluate};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [truth, estimate, rest @ ..] = args.as_slice() else { return Err("wanted: TRUTH ESTIMATE [options]".into()) };
    let mut options = EvalOptions { rpe: Vec::new(), ..EvalOptions::default() };
    let mut all_pairs = false;
    for word in rest {
        match word.as_str() {
            "se3" => options.alignment = Alignment::Se3,
            "sim3" => options.alignment = Alignment::Sim3,
            "none" => options.alignment = Alignment::None,
            "all" => all_pairs = true,
            _ => match delta(word)? {
                (value, None) => options.max_difference_s = value,
                (value, Some(unit)) => options.rpe.push(RpeOptions { all_pairs, ..RpeOptions::new(value, unit) }),
            },
        }
    }
    let truth = Trajectory::read_tum(Path::new(truth))?;
    let estimate = Trajectory::read_tum(Path::new(estimate))?;
    println!("{}", serde_json::to_string_pretty(&evaluate(&truth, &estimate, None, &options)?)?);
    Ok(())
}

/// `0.5m` as 0.5 and metres; without a letter there is no unit.
fn delta(word: &str) -> Result<(f64, Option<DeltaUnit>), Box<dyn Error>> {
    let (number, unit) = match word.as_bytes().last() {
        Some(b'm') => (&word[..word.len() - 1], Some(DeltaUnit::Metres)),
        Some(b'f') => (&word[..word.len() - 1], Some(DeltaUnit::Frames)),
        Some(b's') => (&word[..word.len() - 1], Some(DeltaUnit::Seconds)),
        _ => (word, None),
    };
    Ok((number.parse().map_err(|_| format!("'{word}' is neither a number nor an option"))?, unit))
}
