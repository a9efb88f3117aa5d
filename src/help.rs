//! The command line as people meet it: `pslam --help`, completions and manual pages come from here.

use clap::{Command, CommandFactory as _};
use std::fmt::Write as _;

/// Headings and the commands below them, in the order in which a newcomer needs them. A command that this build lacks is
/// left out.
pub const GROUPS: [(&str, &[&str]); 7] = [
    ("Start here", &["demo"]),
    ("Get a log", &["import", "record", "devices", "sync", "board", "calibrate", "sim"]),
    ("Look at a log", &["info", "check", "recover"]),
    ("Change and share a log", &["annotate", "slice", "merge", "filter", "compress", "redact", "export", "card"]),
    ("Run the SLAM", &["replay", "config", "bench", "suite"]),
    ("Judge a run", &["eval", "eval-masks", "report", "verify", "diff"]),
    ("Set up", &["completions", "man"]),
];

/// The whole command line; its help shows the commands in groups.
#[must_use]
pub fn command() -> Command {
    let command = crate::Cli::command();
    let overview = overview(&command);
    let header = *command.get_styles().get_header();
    command.help_template(format!(
        "{{about}}\n\n{{usage-heading}} {{usage}}\n\n{overview}{header}Options:{header:#}\n{{options}}{{after-help}}"
    ))
}

/// The commands that no group names.
#[must_use]
pub fn ungrouped(command: &Command) -> Vec<&str> {
    let named = |name: &str| GROUPS.iter().any(|(_, names)| names.contains(&name));
    command.get_subcommands().map(Command::get_name).filter(|name| !named(name)).collect()
}

/// A line a command below the heading of its group. Styles vanish where nobody sees them (a pipe, `NO_COLOR`).
fn overview(command: &Command) -> String {
    let (header, literal) = (*command.get_styles().get_header(), *command.get_styles().get_literal());
    let mut text = String::new();
    for (heading, names) in GROUPS {
        let there: Vec<&Command> = names.iter().filter_map(|name| command.find_subcommand(name)).collect();
        if there.is_empty() {
            continue;
        }
        let _ = writeln!(text, "{header}{heading}:{header:#}"); // writing to a String cannot fail
        for command in there {
            let about = command.get_about().map(ToString::to_string).unwrap_or_default();
            let about = about.split(';').next().unwrap_or_default();
            let _ = writeln!(text, "  {literal}{:<12}{literal:#} {about}", command.get_name());
        }
        text.push('\n');
    }
    text
}
