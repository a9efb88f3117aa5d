//! `pslam slice`, `merge`, `filter`, `compress`, `redact`: a log to another log.

mod compress;
mod filter;
mod merge;
mod moment;
mod redact;
mod slice;

pub use compress::Compress;
pub use filter::Filter;
pub use merge::Merge;
pub use redact::Redact;
pub use slice::Slice;

use crate::Usage;
use recorder::LogOptions;
use recorder::edit::EditOptions;
use regex_lite::Regex;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Where the new log goes, for every edit.
#[derive(Debug, clap::Args)]
pub struct Target {
    /// The new log.
    #[arg(short, long, value_name = "LOG")]
    out: PathBuf,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Do everything but write.
    #[arg(long)]
    dry_run: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Target {
    /// `arguments` stand in the new log: everything that changes the result, and no paths.
    fn options(&self, operation: &'static str, arguments: BTreeMap<String, Value>) -> EditOptions {
        let log = LogOptions { force: self.force, ..LogOptions::default() };
        EditOptions { dry_run: self.dry_run, log, ..EditOptions::new(operation, arguments) }
    }
}

/// Which topics: regular expressions over whole names, as the `mcap` command line has them.
#[derive(Debug, clap::Args)]
pub struct Topics {
    /// Keep only topics that match (whole name; several times: any of them).
    #[arg(short = 'y', long, value_name = "REGEX")]
    include: Vec<String>,
    /// Leave topics out that match.
    #[arg(short = 'n', long, value_name = "REGEX")]
    exclude: Vec<String>,
}

impl Topics {
    fn rule(&self) -> anyhow::Result<impl Fn(&str) -> bool + use<>> {
        let (include, exclude) = (patterns(&self.include)?, patterns(&self.exclude)?);
        Ok(move |topic: &str| (include.is_empty() || any(&include, topic)) && !any(&exclude, topic))
    }

    fn add_to(&self, arguments: &mut BTreeMap<String, Value>) {
        for (name, list) in [("include", &self.include), ("exclude", &self.exclude)] {
            if !list.is_empty() {
                arguments.insert(name.to_owned(), list.clone().into());
            }
        }
    }
}

/// Each matches whole names.
fn patterns(list: &[String]) -> anyhow::Result<Vec<Regex>> {
    let one = |text: &String| {
        Regex::new(&format!("^(?:{text})$")).map_err(|error| Usage(format!("`{text}` is no pattern: {error}")).into())
    };
    list.iter().map(one).collect()
}

fn any(patterns: &[Regex], name: &str) -> bool {
    patterns.iter().any(|pattern| pattern.is_match(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_names_match() {
        let topics = Topics { include: vec!["/camera/.*".to_owned()], exclude: vec![".*info".to_owned()] };
        let keeps = topics.rule().unwrap();
        assert!(keeps("/camera/depth/image") && !keeps("/camera/depth/camera_info") && !keeps("/a/camera/x"));
        let all = Topics { include: Vec::new(), exclude: Vec::new() }.rule().unwrap();
        assert!(all("/anything"));
        assert!(Topics { include: vec!["(".to_owned()], exclude: Vec::new() }.rule().is_err());
    }
}
