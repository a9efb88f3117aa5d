//! What a suite file says.

use super::Degrade;
use crate::Usage;
use recorder::import::CameraSource;
use replayer::eval::Alignment;
use replayer::robust::Perturbation;
use schemas::calibration::Preset;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// A suite file. Unknown keys are refused.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Heading of the report.
    pub title: String,
    /// Folder that the paths of sequences start from, itself relative to the suite file; `--data` replaces it.
    #[serde(default)]
    pub data: PathBuf,
    /// The sequences, in order of the tables' rows.
    pub sequence: Vec<Sequence>,
    /// The configurations, in order of the tables' columns.
    pub config: Vec<Configuration>,
    /// Figures of other systems.
    #[serde(default)]
    pub published: Vec<Published>,
    /// Names of what is done to every sequence with every configuration, or `all`; the tables are then those of
    /// [`super::perturbed`], there are no run folders, and sequences are aligned as their sensor wants it.
    pub perturbations: Option<Vec<String>>,
    /// The tables to print; none with `perturbations`.
    #[serde(default)]
    pub table: Vec<Table>,
}

/// One sequence. Exactly one of `log`, `tum` and `synthetic` says where it comes from.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sequence {
    /// Name in tables and of folders: letters, digits, `_`, `-` and `.`.
    pub name: String,
    /// A log.
    pub log: Option<PathBuf>,
    /// A folder in the layout of TUM RGB-D; imported.
    pub tum: Option<PathBuf>,
    /// COCO panoptic labels of `tum`.
    pub panoptic: Option<PathBuf>,
    /// Value of one metre in the depth images of `tum`, as text; default: what the import finds.
    pub depth_scale: Option<String>,
    /// Camera of `tum` by name, as `pslam import tum --preset`; default: what the import finds.
    pub preset: Option<String>,
    /// A scenario of the synthetic world; rendered.
    pub synthetic: Option<String>,
    /// A way to make it harder.
    pub degrade: Option<Degrade>,
    /// Alignment to the ground truth; default SE3. Without effect on perturbed sequences.
    #[serde(default)]
    pub alignment: Alignment,
}

/// One configuration: a preset and keys to change.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    /// Name in tables and of folders.
    pub name: String,
    /// Preset to start from; default `full`.
    pub preset: Option<String>,
    /// Keys of the configuration to change.
    #[serde(default)]
    pub keys: toml::Table,
}

/// A system's published figures, by sequence.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// The system.
    pub system: String,
    /// Where the figures stand, for the line under the table.
    pub source: String,
    /// RMSE of the absolute trajectory error, metres.
    #[serde(default)]
    pub ate_m: BTreeMap<String, f64>,
    /// Mean tracking time, milliseconds.
    #[serde(default)]
    pub tracking_ms: BTreeMap<String, f64>,
}

/// What a table shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// RMSE of the absolute trajectory error, metres.
    AteM,
    /// The same of the poses as they were known at each frame, metres.
    AteOnlineM,
    /// Frames with a pose in the trajectory, percent.
    Tracked,
    /// Mean time per frame of features, filter and tracking, milliseconds.
    TrackingMs,
}

/// One table: a row a sequence, a column a configuration, then one a published system.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Content of the cells.
    pub value: Quantity,
    /// Configurations to show; default: all.
    pub configs: Option<Vec<String>>,
    /// Sequences to show; default: all.
    pub sequences: Option<Vec<String>>,
    /// Published systems to show beside; default: none.
    #[serde(default)]
    pub published: Vec<String>,
}

impl Suite {
    /// Reads and checks a suite.
    ///
    /// # Errors
    /// Not TOML, an unknown key, a name used twice or not defined, no or several sources of a sequence.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let suite: Self = toml::from_str(text).map_err(|error| Usage(error.to_string()))?;
        suite.check()?;
        Ok(suite)
    }

    fn check(&self) -> Result<(), Usage> {
        let sequences = names("sequence", self.sequence.iter().map(|s| &s.name))?;
        let configs = names("config", self.config.iter().map(|c| &c.name))?;
        let systems: BTreeSet<_> = self.published.iter().map(|p| p.system.as_str()).collect();
        self.sequence.iter().try_for_each(Sequence::check)?;
        self.perturbed()?;
        match (self.perturbations.is_some(), self.table.is_empty()) {
            (true, false) => {
                return Err(Usage("a suite with `perturbations` has tables of its own: leave `table` out".to_owned()));
            }
            (false, true) => return Err(Usage("the suite has no table".to_owned())),
            _ => {}
        }
        for table in &self.table {
            let known = |kind: &str, wanted: &[String], known: &BTreeSet<&str>| {
                let missing = wanted.iter().find(|name| !known.contains(name.as_str()));
                missing.map_or(Ok(()), |name| Err(Usage(format!("table `{}`: no {kind} `{name}`", table.title))))
            };
            known("config", table.configs.as_deref().unwrap_or_default(), &configs)?;
            known("sequence", table.sequences.as_deref().unwrap_or_default(), &sequences)?;
            known("published system", &table.published, &systems)?;
        }
        Ok(())
    }
}

impl Suite {
    /// What is done to every sequence, each once, in the order of the file; `None` for a suite of usual runs.
    ///
    /// # Errors
    /// No name, or an unknown one.
    pub fn perturbed(&self) -> Result<Option<Vec<Perturbation>>, Usage> {
        let Some(names) = &self.perturbations else { return Ok(None) };
        let mut found = Vec::new();
        for name in names {
            let more = match name.as_str() {
                "all" => Perturbation::ALL.to_vec(),
                _ => vec![name.parse().map_err(|error| Usage(format!("perturbations: {error}, or all")))?],
            };
            found.extend(more);
        }
        let mut seen = BTreeSet::new();
        found.retain(|perturbation| seen.insert(*perturbation));
        if found.is_empty() { Err(Usage("perturbations: name one, or all".to_owned())) } else { Ok(Some(found)) }
    }
}

impl Sequence {
    fn check(&self) -> Result<(), Usage> {
        let name = &self.name;
        let sources = [self.log.is_some(), self.tum.is_some(), self.synthetic.is_some()];
        if sources.iter().filter(|there| **there).count() != 1 {
            return Err(Usage(format!("sequence {name}: give exactly one of `log`, `tum` and `synthetic`")));
        }
        if self.preset.is_some() && self.tum.is_none() {
            return Err(Usage(format!("sequence {name}: `preset` is the camera of a `tum` folder")));
        }
        self.camera().map(drop)
    }

    /// Where the camera of a `tum` folder comes from.
    ///
    /// # Errors
    /// An unknown preset.
    pub fn camera(&self) -> Result<CameraSource, Usage> {
        let Some(preset) = &self.preset else { return Ok(CameraSource::Auto) };
        let known = Preset::ALL.map(|(name, _)| name).join(", ");
        let message = || Usage(format!("sequence {}: no camera preset `{preset}`; choose {known}", self.name));
        Preset::by_name(preset).map(CameraSource::Preset).ok_or_else(message)
    }
}

impl Configuration {
    /// The configuration of the slam.
    ///
    /// # Errors
    /// An unknown preset or key, or an impossible value.
    pub fn resolve(&self) -> anyhow::Result<slam::Config> {
        let config = self.preset.as_deref().map_or_else(|| Ok(slam::Config::default()), slam::Config::preset)?;
        Ok(config.with_toml(&self.keys.to_string())?)
    }
}

/// Names become folders, so they must be plain and different.
fn names<'a>(kind: &str, all: impl Iterator<Item = &'a String>) -> Result<BTreeSet<&'a str>, Usage> {
    let mut seen = BTreeSet::new();
    for name in all {
        let plain = |c: char| c.is_ascii_alphanumeric() || "_-.+".contains(c);
        if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
            return Err(Usage(format!("{kind} name `{name}` must be letters, digits, `_`, `-`, `+` and `.`")));
        }
        if !seen.insert(name.as_str()) {
            return Err(Usage(format!("{kind} name `{name}` is used twice")));
        }
    }
    if seen.is_empty() { Err(Usage(format!("the suite has no {kind}"))) } else { Ok(seen) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::BUILT_IN;

    #[test]
    fn every_suite_that_comes_along_is_sound() {
        for (name, text) in BUILT_IN {
            let suite = Suite::parse(text).unwrap_or_else(|error| panic!("{name}: {error:#}"));
            for config in &suite.config {
                config.resolve().unwrap_or_else(|error| panic!("{name}, {}: {error:#}", config.name));
            }
            for scenario in suite.sequence.iter().filter_map(|s| s.synthetic.as_deref()) {
                assert!(fixtures::scenario::by_name(scenario).is_some(), "{name}: {scenario}");
            }
        }
    }

    #[test]
    fn a_suite_that_makes_no_sense_is_refused() {
        let good = "title = 't'\n[[config]]\nname = 'full'\n[[sequence]]\nname = 's'\nlog = 'a.mcap'\n\
                    [[table]]\ntitle = 'x'\nvalue = 'ate_m'\n";
        assert!(Suite::parse(good).is_ok());
        for (from, to, word) in [
            ("log = 'a.mcap'", "log = 'a.mcap'\ntum = 'b'", "exactly one"),
            ("log = 'a.mcap'", "", "exactly one"),
            ("name = 's'", "name = '../s'", "must be letters"),
            ("value = 'ate_m'", "value = 'ate_m'\nconfigs = ['other']", "no config `other`"),
            ("value = 'ate_m'", "value = 'speed'", "unknown variant"),
            ("title = 't'", "title = 't'\nhue = 3", "unknown field"),
            ("[[table]]\ntitle = 'x'\nvalue = 'ate_m'\n", "", "no table"),
            ("title = 't'", "title = 't'\nperturbations = ['all']", "leave `table` out"),
            ("log = 'a.mcap'", "log = 'a.mcap'\npreset = 'bonn'", "`tum` folder"),
            ("log = 'a.mcap'", "tum = 'a'\npreset = 'kinect'", "choose freiburg1"),
        ] {
            let error = format!("{:#}", Suite::parse(&good.replace(from, to)).unwrap_err());
            assert!(error.contains(word), "{to}: {error}");
        }
    }

    #[test]
    fn perturbations_are_names_or_all() {
        let suite = |names: &str| {
            Suite::parse(&format!(
                "title = 't'\nperturbations = {names}\nconfig = [{{ name = 'full' }}]\n\
                 sequence = [{{ name = 's', log = 'a.mcap' }}]\n"
            ))
        };
        let perturbed = |names| suite(names).unwrap().perturbed().unwrap().unwrap();
        assert_eq!(perturbed("['all']"), Perturbation::ALL);
        assert_eq!(perturbed("['mirrored', 'start-7']"), [Perturbation::Mirrored, Perturbation::Start(7)]);
        let all = perturbed("['mirrored', 'all', 'all']");
        assert_eq!((all.len(), all[0]), (Perturbation::ALL.len(), Perturbation::Mirrored), "each once");
        for (names, word) in [("[]", "name one"), ("['upside-down']", "every-second"), ("['upside-down']", "or all")] {
            let error = format!("{:#}", suite(names).unwrap_err());
            assert!(error.contains(word), "{names}: {error}");
        }
        let usual = "title = 't'\nconfig = [{ name = 'full' }]\nsequence = [{ name = 's', log = 'a' }]\n\
                     table = [{ title = 'x', value = 'ate_m' }]\n";
        assert_eq!(Suite::parse(usual).unwrap().perturbed().unwrap(), None);
    }
}
