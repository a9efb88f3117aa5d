//! `pslam merge`.

use super::Target;
use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use recorder::edit::{LayerNames, merge};
use schemas::topics;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Merge {
    /// The logs, two or more: of one moment with different topics, or of one camera one after the other.
    #[arg(required = true, num_args = 2..)]
    logs: Vec<PathBuf>,
    /// Give a segmentation layer of the N-th log another name, as 2:panoptic=mask2former.
    #[arg(long, value_name = "N:OLD=NEW", value_parser = rename)]
    rename_layer: Vec<(usize, String, String)>,
    #[command(flatten)]
    target: Target,
}

fn rename(text: &str) -> Result<(usize, String, String), String> {
    let wrong = || format!("`{text}` is not of the form 2:panoptic=mask2former");
    let (number, names) = text.split_once(':').ok_or_else(wrong)?;
    let (old, new) = names.split_once('=').ok_or_else(wrong)?;
    let number: usize = number.parse().ok().filter(|number| *number > 0).ok_or_else(wrong)?;
    if !topics::is_layer_name(new) {
        return Err(format!("`{new}` cannot name a layer: letters, digits and _, a letter first"));
    }
    Ok((number - 1, old.to_owned(), new.to_owned()))
}

impl Merge {
    pub(in crate::cmd) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let mut layers = LayerNames::new();
        for (number, old, new) in &self.rename_layer {
            if *number >= self.logs.len() || layers.insert((*number, old.clone()), new.clone()).is_some() {
                let count = self.logs.len();
                return Err(Usage(format!(
                    "--rename-layer {}:{old}: one new name a layer of {count} logs",
                    number + 1
                ))
                .into());
            }
        }
        let names = self.rename_layer.iter().map(|(number, old, new)| format!("{}:{old}={new}", number + 1));
        let mut arguments = BTreeMap::new();
        if !self.rename_layer.is_empty() {
            arguments.insert("rename_layer".to_owned(), names.collect::<Vec<_>>().into());
        }
        let options = self.target.options("merge", arguments);
        let bar = progress.bar("merging");
        let logs: Vec<&Path> = self.logs.iter().map(PathBuf::as_path).collect();
        let summary = merge(&logs, &self.target.out, &layers, &options, &mut |done, all| {
            progress::update(&bar, done as usize, all as usize);
        })?;
        bar.finish_and_clear();
        stdout::either(self.target.json, "merge/1", &summary)?;
        Ok(Outcome::Good)
    }
}
