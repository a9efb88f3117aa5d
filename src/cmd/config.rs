//! `pslam config`, and how every command finds its configuration.

use crate::{Outcome, stdout};
use anyhow::Context as _;
use serde::Serialize;
use slam::config::{DEFAULT_TOML, PRESETS};
use std::fs;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Config {
    #[command(flatten)]
    choice: Choice,
    /// List the presets.
    #[arg(long, conflicts_with_all = ["preset", "config", "json"])]
    presets: bool,
    /// Print JSON: all keys without their documentation, and the names of the presets.
    #[arg(long)]
    json: bool,
}

/// A configuration for programs.
#[derive(Serialize)]
struct Keys {
    /// Preset, and file if there is one.
    name: String,
    /// Names of all presets.
    presets: &'static [&'static str],
    config: slam::Config,
}

/// Which configuration: the defaults, then a preset, then the keys of a file.
#[derive(Debug, clap::Args)]
pub struct Choice {
    /// Start from a preset: full (the default), none, people, people+things, people+unknown, paper.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// TOML file with the keys to change; `pslam config` prints all of them.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl Choice {
    /// How the user called it.
    pub(super) fn name(&self) -> String {
        let preset = self.preset.as_deref().unwrap_or("full");
        self.config.as_ref().map_or_else(|| preset.to_owned(), |path| format!("{preset} with {}", path.display()))
    }

    /// The configuration; unknown keys and impossible values are refused.
    pub(super) fn read(&self) -> anyhow::Result<slam::Config> {
        let config = self.preset.as_deref().map_or_else(|| Ok(slam::Config::default()), slam::Config::preset)?;
        let Some(path) = &self.config else { return Ok(config) };
        let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        config.with_toml(&text).with_context(|| path.display().to_string())
    }
}

impl Config {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        if self.json {
            let keys = Keys { name: self.choice.name(), presets: &PRESETS, config: self.choice.read()? };
            stdout::json("config/1", &keys)?;
        } else if self.presets {
            stdout::text(&PRESETS.join("\n"))?;
        } else if self.choice.preset.is_none() && self.choice.config.is_none() {
            stdout::text(&DEFAULT_TOML)?;
        } else {
            stdout::text(&self.choice.read()?.to_toml())?;
        }
        Ok(Outcome::Good)
    }
}
