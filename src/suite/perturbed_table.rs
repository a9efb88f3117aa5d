//! Tables of a suite with perturbations as Markdown: how far results spread, and where the filter costs something.

use super::perturbed::PerturbedCell;
use super::run::SequenceReport;
use super::spec::Suite;
use super::table::aligned;
use replayer::eval::Statistics;
use std::cmp::Reverse;

/// The configuration that must not be worse than the others ...
const FULL: &str = "full";
/// ... where nothing is filtered ...
const NONE: &str = "none";
/// ... and of which none may keep frames that it loses.
const OTHERS: [&str; 2] = ["people", NONE];
/// Without a filter the result is good below this, metres: what moves does not matter there, so a filter may cost nothing.
const GOOD_M: f64 = 0.02;
/// Larger errors than without a filter by less than this share are noise.
const NOISE: f64 = 0.1;

/// A table a configuration, then one of what `full` makes worse.
pub(super) fn markdown(suite: &Suite, sequences: &[SequenceReport]) -> Vec<String> {
    let configs = suite.config.iter().map(|config| spread(&config.name, sequences));
    let there = |name: &str| suite.config.iter().any(|config| config.name == name);
    let compared = (there(FULL) && OTHERS.into_iter().any(there)).then(|| worse(sequences));
    configs.chain(compared).collect()
}

fn of<'a>(sequence: &'a SequenceReport, config: &str) -> Vec<&'a PerturbedCell> {
    sequence.perturbed.iter().filter(|cell| cell.config == config).collect()
}

fn millimetres(metres: Option<f64>) -> String {
    metres.map_or_else(|| "-".to_owned(), |metres| format!("{:.1}", metres * 1e3))
}

/// One configuration: a row a sequence.
fn spread(config: &str, sequences: &[SequenceReport]) -> String {
    let header = [
        "error [mm]",
        "median",
        "worst",
        "under",
        "online median",
        "online worst",
        "most lost",
        "under",
        "perturbations",
    ];
    let there = sequences.iter().map(|sequence| (&sequence.name, of(sequence, config)));
    let rows = there.filter(|(_, cells)| !cells.is_empty()).map(|(name, cells)| row(name, &cells));
    let rows: Vec<_> = std::iter::once(header.map(str::to_owned).to_vec()).chain(rows).collect();
    let mut text = format!("## Perturbed: {config}\n\n{}", aligned(&rows));
    let failed = sequences.iter().flat_map(|s| of(s, config).into_iter().map(move |cell| (&s.name, cell)));
    for (i, (name, cell, reason)) in failed.filter_map(|(n, c)| Some((n, c, c.reason()?))).enumerate() {
        let gap = if i == 0 { "\n" } else { "" };
        text.push_str(&format!("{gap}- {name}, {}: not judged, counted as lost: {reason}\n", cell.perturbation));
    }
    text
}

fn row(name: &str, cells: &[&PerturbedCell]) -> Vec<String> {
    let final_m = Statistics::of(&cells.iter().filter_map(|cell| cell.error_m()).collect::<Vec<_>>());
    let online = cells.iter().filter_map(|cell| Some(cell.judged()?.online_m.rmse));
    let online = Statistics::of(&online.collect::<Vec<_>>());
    // Of equals the first.
    let worst = cells.iter().filter(|cell| cell.error_m().is_some()).rev();
    let worst = worst.max_by(|a, b| a.error_m().unwrap_or(0.0).total_cmp(&b.error_m().unwrap_or(0.0)));
    let lost = cells.iter().filter(|cell| cell.lost() > 0).min_by_key(|cell| Reverse(cell.lost()));
    let under = |cell: Option<&&PerturbedCell>| cell.map_or("-".to_owned(), |cell| cell.perturbation.clone());
    vec![
        name.to_owned(),
        millimetres(final_m.map(|s| s.median)),
        millimetres(final_m.map(|s| s.max)),
        under(worst),
        millimetres(online.map(|s| s.median)),
        millimetres(online.map(|s| s.max)),
        lost.map_or(0, |cell| cell.lost()).to_string(),
        under(lost),
        cells.len().to_string(),
    ]
}

/// Each sequence and perturbation where [`FULL`] does worse than another configuration.
fn worse(sequences: &[SequenceReport]) -> String {
    let heads = [FULL].into_iter().chain(OTHERS);
    let heads = heads.flat_map(|name| [format!("{name} [mm]"), "lost".to_owned()]);
    let first = ["sequence", "perturbation"].map(str::to_owned).into_iter();
    let mut rows: Vec<Vec<String>> = vec![first.chain(heads).chain(["why".to_owned()]).collect()];
    for sequence in sequences {
        for full in of(sequence, FULL) {
            let same = |config| {
                let mut cells = of(sequence, config).into_iter();
                cells.find(|cell| cell.perturbation == full.perturbation)
            };
            let others = OTHERS.map(|config| (config, same(config)));
            let why = why(full, &others);
            if why.is_empty() {
                continue;
            }
            let shown = [Some(full)].into_iter().chain(others.map(|(_, cell)| cell));
            let shown = shown.flat_map(|cell| {
                let lost = cell.map_or("-".to_owned(), |cell| cell.lost().to_string());
                [millimetres(cell.and_then(PerturbedCell::error_m)), lost]
            });
            let names = [sequence.name.clone(), full.perturbation.clone()].into_iter();
            rows.push(names.chain(shown).chain([why.join(", ")]).collect());
        }
    }
    let body = if rows.len() == 1 { "Nowhere.\n".to_owned() } else { aligned(&rows) };
    format!("## Where {FULL} does worse\n\n{body}")
}

fn why(full: &PerturbedCell, others: &[(&str, Option<&PerturbedCell>)]) -> Vec<String> {
    let fewer = others.iter().filter_map(|(name, cell)| Some((name, cell.as_ref()?.lost())));
    let fewest = fewer.min_by_key(|(_, lost)| *lost).filter(|(_, lost)| *lost < full.lost());
    let lost = fewest.map(|(name, lost)| format!("loses {} more than {name}", full.lost() - lost));
    let none = others.iter().find(|(name, _)| *name == NONE).and_then(|(_, cell)| cell.as_ref()?.error_m());
    let pair = full.error_m().zip(none).filter(|(full, none)| *none < GOOD_M && *full > *none * (1.0 + NOISE));
    let error = pair.map(|(full, none)| format!("{:.0} % worse than {NONE}", 100.0 * (full / none - 1.0)));
    lost.into_iter().chain(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::perturbed::Perturbed;
    use replayer::robust::Judged;

    fn cell(config: &str, perturbation: &str, error_m: f64, tracked: usize) -> PerturbedCell {
        let of = |error: f64| Statistics::of(&[error]).unwrap();
        let (error_m, online_m, unrefined_m) = (of(error_m), of(2.0 * error_m), of(error_m));
        let outcome = Perturbed::Judged(Judged { frames: 100, tracked, error_m, online_m, unrefined_m });
        PerturbedCell { config: config.to_owned(), perturbation: perturbation.to_owned(), outcome }
    }

    fn failed(config: &str, perturbation: &str) -> PerturbedCell {
        let outcome = Perturbed::NotJudged { frames: 50, reason: "two poses".to_owned() };
        PerturbedCell { outcome, ..cell(config, perturbation, 0.0, 0) }
    }

    fn tables(perturbed: Vec<PerturbedCell>) -> Vec<String> {
        let suite = Suite::parse(
            "title = 't'\nperturbations = ['all']\nconfig = [{ name = 'full' }, { name = 'none' }]\n\
             sequence = [{ name = 'a', log = 'a' }]\n",
        )
        .unwrap();
        let (name, missing, runs) = ("a".to_owned(), None, vec![]);
        markdown(&suite, &[SequenceReport { name, missing, runs, perturbed }])
    }

    #[test]
    fn the_spread_has_median_worst_and_lost() {
        let cells = vec![cell("full", "x", 0.010, 100), cell("full", "y", 0.030, 97), cell("full", "z", 0.012, 97)];
        let expected = "\
## Perturbed: full

| error [mm] | median | worst | under | online median | online worst | most lost | under | perturbations |
| ---------- | -----: | ----: | ----: | ------------: | -----------: | --------: | ----: | ------------: |
| a          |   12.0 |  30.0 |     y |          24.0 |         60.0 |         3 |     y |             3 |
";
        assert_eq!(tables(cells)[0], expected);
        let text = &tables(vec![cell("full", "x", 0.010, 100), failed("full", "y")])[0];
        assert!(text.contains("|        50 |     y |             2 |"), "{text}");
        assert!(text.contains("\n\n- a, y: not judged, counted as lost: two poses\n"), "{text}");
    }

    #[test]
    fn what_full_makes_worse_is_listed_and_nothing_else() {
        let worse = |full, none| tables(vec![full, none])[2].clone();
        let full = |error, tracked| cell("full", "x", error, tracked);
        let none = |error, tracked| cell("none", "x", error, tracked);
        for (full, none) in [
            (full(0.0109, 100), none(0.010, 100)),
            (full(0.05, 100), none(0.021, 100)),
            (full(0.05, 90), none(0.5, 90)),
            (full(0.01, 100), failed("none", "x")),
        ] {
            assert!(worse(full, none).ends_with("\n\nNowhere.\n"));
        }
        for (full, none, why) in [
            (full(0.012, 100), none(0.010, 100), "| 20 % worse than none |"),
            (full(0.01, 98), none(0.5, 99), "| loses 1 more than none |"),
            (failed("full", "x"), none(0.01, 90), "| loses 40 more than none |"),
            (full(0.03, 90), none(0.01, 100), "| loses 10 more than none, 200 % worse than none |"),
        ] {
            let text = worse(full, none);
            assert!(text.contains(why), "{text}");
        }
    }
}
