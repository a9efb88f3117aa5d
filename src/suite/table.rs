//! Tables of a suite as Markdown, columns aligned for a terminal.

use super::run::{Done, SequenceReport};
use super::spec::{Published, Quantity, Suite, Table};

/// The table with its heading and its sources. Rows of sequences that are missing stay if something was published for
/// them.
pub fn markdown(suite: &Suite, table: &Table, sequences: &[SequenceReport]) -> String {
    let published: Vec<&Published> =
        table.published.iter().filter_map(|name| suite.published.iter().find(|p| p.system == *name)).collect();
    let configs: Vec<&str> = match &table.configs {
        Some(configs) => configs.iter().map(String::as_str).collect(),
        None => suite.config.iter().map(|config| config.name.as_str()).collect(),
    };
    let mut rows = vec![header(table, &configs, &published)];
    for sequence in sequences {
        let shown = table.sequences.as_ref().is_none_or(|wanted| wanted.contains(&sequence.name));
        let figures: Vec<_> = published.iter().map(|system| figure(system, table.value, &sequence.name)).collect();
        if shown && (sequence.missing.is_none() || figures.iter().any(Option::is_some)) {
            let ours = configs.iter().map(|config| {
                let cell = sequence.runs.iter().find(|cell| cell.config == *config);
                cell.map_or_else(|| "-".to_owned(), |cell| text(&cell.done, table.value))
            });
            let theirs = figures.iter().map(|value| value.map_or("-".to_owned(), |v| number(v, table.value)));
            rows.push(std::iter::once(sequence.name.clone()).chain(ours).chain(theirs).collect());
        }
    }
    let mut text = format!("## {}\n\n{}", table.title, aligned(&rows));
    for system in published {
        text.push_str(&format!("\n\\* {}: published, {}\n", system.system, system.source));
    }
    text
}

fn header(table: &Table, configs: &[&str], published: &[&Published]) -> Vec<String> {
    let unit = match table.value {
        Quantity::AteM => "ATE RMSE [m]",
        Quantity::AteOnlineM => "online ATE RMSE [m]",
        Quantity::Tracked => "tracked [%]",
        Quantity::TrackingMs => "tracking [ms]",
    };
    let ours = configs.iter().map(|config| (*config).to_owned());
    let theirs = published.iter().map(|system| format!("{}*", system.system));
    std::iter::once(unit.to_owned()).chain(ours).chain(theirs).collect()
}

fn figure(system: &Published, value: Quantity, sequence: &str) -> Option<f64> {
    match value {
        Quantity::AteM => system.ate_m.get(sequence).copied(),
        Quantity::AteOnlineM | Quantity::Tracked => None,
        Quantity::TrackingMs => system.tracking_ms.get(sequence).copied(),
    }
}

/// An error without its coverage could be bought by giving up: incomplete tracks say how much they cover.
fn text(done: &Done, value: Quantity) -> String {
    let Some(shown) = done.value(value) else { return "failed".to_owned() };
    match done {
        Done::Judged { tracked, frames, .. }
            if matches!(value, Quantity::AteM | Quantity::AteOnlineM) && tracked < frames =>
        {
            format!("{} ({:.0} %)", number(shown, value), 100.0 * *tracked as f64 / *frames as f64)
        }
        _ => number(shown, value),
    }
}

fn number(shown: f64, value: Quantity) -> String {
    match value {
        Quantity::AteM | Quantity::AteOnlineM => format!("{shown:.4}"),
        Quantity::Tracked | Quantity::TrackingMs => format!("{shown:.1}"),
    }
}

/// Rows of equal length, the first one a heading; all but the first column flush right.
pub(super) fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).fold(3, usize::max);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate();
        let cells = cells.map(|(i, (text, w))| if i == 0 { format!("{text:<w$}") } else { format!("{text:>w$}") });
        format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
    };
    let rule = widths.iter().enumerate().map(|(i, w)| if i == 0 { "-".repeat(*w) } else { "-".repeat(w - 1) + ":" });
    let rule = format!("| {} |\n", rule.collect::<Vec<_>>().join(" | "));
    let mut lines = rows.iter().map(line);
    lines.next().into_iter().chain([rule]).chain(lines).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::run::Cell;

    #[test]
    fn ours_and_published_stand_side_by_side() {
        let suite = Suite::parse(
            "title = 't'\nconfig = [{ name = 'full' }, { name = 'none' }]\n\
             sequence = [{ name = 'a', log = 'a' }, { name = 'b', log = 'b' }, { name = 'c', log = 'c' }]\n\
             [[published]]\nsystem = 'Other'\nsource = 'table 3'\nate_m = { a = 0.25, b = 0.5 }\n\
             [[table]]\ntitle = 'Errors'\nvalue = 'ate_m'\npublished = ['Other']\n",
        )
        .unwrap();
        let judged = |ate_m, tracked| Done::Judged {
            ate_m,
            ate_online_m: Some(ate_m * 2.0),
            tracked,
            frames: 100,
            tracking_ms: 1.0,
            fingerprint: "f".into(),
        };
        let cell = |config: &str, done| Cell { config: config.to_owned(), done };
        let failed = Done::NotJudged { reason: "no truth".into() };
        let sequences = [
            SequenceReport {
                name: "a".into(),
                missing: None,
                runs: vec![cell("full", judged(0.0123, 100)), cell("none", judged(0.5, 80))],
                perturbed: vec![],
            },
            SequenceReport {
                name: "b".into(),
                missing: Some("b is not there".into()),
                runs: vec![],
                perturbed: vec![],
            },
            SequenceReport {
                name: "c".into(),
                missing: None,
                runs: vec![cell("full", failed.clone()), cell("none", failed)],
                perturbed: vec![],
            },
        ];
        let expected = "\
## Errors

| ATE RMSE [m] |   full |          none | Other* |
| ------------ | -----: | ------------: | -----: |
| a            | 0.0123 | 0.5000 (80 %) | 0.2500 |
| b            |      - |             - | 0.5000 |
| c            | failed |        failed |      - |

\\* Other: published, table 3
";
        assert_eq!(markdown(&suite, &suite.table[0], &sequences), expected);
        let online = Table { value: Quantity::AteOnlineM, published: vec![], ..suite.table[0].clone() };
        let text = markdown(&suite, &online, &sequences);
        assert!(
            text.contains("online ATE RMSE [m]") && text.contains("0.0246") && text.contains("1.0000 (80 %)"),
            "{text}"
        );
    }
}
