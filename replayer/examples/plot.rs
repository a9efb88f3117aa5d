//! Draws estimates beside the truth: `cargo run -p replayer --example plot -- TRUTH|LOG OUT.svg ESTIMATE ...`.

use std::error::Error;
use std::path::Path;

use replayer::eval::{Comparison, EvalOptions, Evaluation, Trajectory, evaluate};
use replayer::plot::{PlotEstimate, trajectories_svg};
use replayer::{read_truth, write_file};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [truth, out, estimates @ ..] = args.as_slice() else { return Err("wanted: TRUTH OUT.svg ESTIMATE ...".into()) };
    let truth = read_truth(Path::new(truth))?;
    let mut rows: Vec<(&str, Evaluation)> = Vec::new();
    for path in estimates {
        let path = Path::new(path);
        let name = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("estimate");
        rows.push((name, evaluate(&truth, &Trajectory::read_tum(path)?, None, &EvalOptions::default())?));
    }
    for (_, evaluation) in &rows {
        println!("{evaluation}");
    }
    let table: Vec<(&str, &Evaluation)> = rows.iter().map(|(name, evaluation)| (*name, evaluation)).collect();
    print!("{}", Comparison(&table));
    let plots: Vec<PlotEstimate<'_>> =
        table.iter().map(|(name, evaluation)| PlotEstimate::new(name, evaluation)).collect();
    write_file(Path::new(out), trajectories_svg("Trajectories", &truth, &plots).as_bytes(), true)?;
    Ok(())
}
