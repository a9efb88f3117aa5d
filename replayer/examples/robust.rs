//! Replays logs under perturbations, two at a time: `cargo run --release -p replayer --example robust -- [-p NAMES] [-c
//! PRESET[:FILE.toml]]... LOG...`.

#[path = "robust_parts/oracle.rs"]
mod oracle;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;

use replayer::robust::{Perturbation, Sequence, judge};
use slam::Config;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

struct Args {
    perturbations: Vec<Perturbation>,
    configs: Vec<(String, Config)>,
    logs: Vec<String>,
    verbose: bool,
}

fn config(name: &str) -> Result<Config> {
    let (preset, file) = name.split_once(':').map_or((name, None), |(preset, file)| (preset, Some(file)));
    let config = Config::preset(preset)?;
    let Some(text) = file else { return Ok(config) };
    let text = if text.contains('=') { text.replace(';', "\n") } else { std::fs::read_to_string(text)? };
    Ok(config.with_toml(&text)?)
}

fn args() -> Result<Args> {
    let mut args = std::env::args().skip(1);
    let mut found = Args { perturbations: vec![], configs: vec![], logs: vec![], verbose: false };
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "-p" => {
                let names = args.next().ok_or("-p needs names")?;
                for name in names.split(',') {
                    found.perturbations.push(name.parse()?);
                }
            }
            "-c" => {
                let name = args.next().ok_or("-c needs a preset")?;
                found.configs.push((name.clone(), config(&name)?));
            }
            "-v" => found.verbose = true,
            _ => found.logs.push(arg),
        }
    }
    if found.perturbations.is_empty() {
        found.perturbations = Perturbation::ALL.to_vec();
    }
    if found.configs.is_empty() {
        found.configs.push(("full".to_owned(), Config::default()));
    }
    Ok(found)
}

fn run() -> Result<()> {
    let args = args()?;
    for log in &args.logs {
        let mut sequence = Sequence::open(Path::new(log), &Config::default(), None)?;
        oracle::apply(&mut sequence)?;
        let name = Path::new(log).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let tasks: Vec<(usize, Perturbation)> =
            (0..args.configs.len()).flat_map(|c| args.perturbations.iter().map(move |p| (c, *p))).collect();
        let (queue, results) = (Mutex::new(tasks.into_iter()), Mutex::new(BTreeMap::new()));
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    loop {
                        let Some((c, p)) = queue.lock().expect("no panic").next() else { break };
                        let Some(changed) = p.apply(&sequence) else { continue };
                        let judged = judge(&changed, &p.config(&args.configs[c].1), 1);
                        results.lock().expect("no panic").insert((c, p), judged);
                    }
                });
            }
        });
        let results = results.into_inner()?;
        for (c, (config, _)) in args.configs.iter().enumerate() {
            let (mut errors, mut online, mut unrefined, mut worst_lost, mut cells) =
                (vec![], vec![], vec![], 0, vec![]);
            for p in &args.perturbations {
                match results.get(&(c, *p)) {
                    Some(Ok(Ok(j))) => {
                        errors.push(j.error_m.rmse * 1e3);
                        online.push(j.online_m.rmse * 1e3);
                        unrefined.push(j.unrefined_m.rmse * 1e3);
                        worst_lost = worst_lost.max(j.frames - j.tracked);
                        let lost = if j.tracked < j.frames {
                            format!(" LOST {}", j.frames - j.tracked)
                        } else {
                            String::new()
                        };
                        cells.push(format!(
                            "{p} {:.1}/{:.1}/{:.1}{lost}",
                            j.error_m.rmse * 1e3,
                            j.online_m.rmse * 1e3,
                            j.unrefined_m.rmse * 1e3
                        ));
                    }
                    Some(Ok(Err(e))) => {
                        worst_lost = 9999;
                        cells.push(format!("{p} {e}"));
                    }
                    Some(Err(e)) => cells.push(format!("{p} {e}")),
                    None => {}
                }
            }
            let stat = |v: &mut Vec<f64>| {
                v.sort_by(f64::total_cmp);
                (v.get(v.len() / 2).copied().unwrap_or(f64::NAN), v.last().copied().unwrap_or(f64::NAN))
            };
            let (m, w) = stat(&mut errors);
            let (mo, wo) = stat(&mut online);
            let (mu, wu) = stat(&mut unrefined);
            println!(
                "{name:<26} {config:<14} median {m:>6.1} worst {w:>6.1} | online {mo:>6.1} {wo:>6.1} | unrefined {mu:>6.1} {wu:>6.1} | lost {worst_lost}"
            );
            if args.verbose {
                println!("    {}", cells.join(", "));
            }
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    let Err(error) = run() else { return ExitCode::SUCCESS };
    eprintln!("{error}");
    ExitCode::FAILURE
}
