//! Who labels pictures, as chosen on the command line.

use crate::Usage;
use recorder::annotate::{ReadyMasks, ReadySource};
use schemas::msg::Category;
use segment::{Network, NetworkSpec, Runtime, SegmentError, Segmenter};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments.
#[derive(Debug, Clone, clap::Args)]
pub struct Labeller {
    /// Description (TOML) of a network beside its .onnx; several are composed: things of instance networks over stuff of
    /// semantic ones.
    #[arg(long = "model", value_name = "TOML")]
    models: Vec<PathBuf>,
    /// Where models are that do not stand beside their descriptions.
    #[arg(long, value_name = "DIR", requires = "models")]
    models_dir: Option<PathBuf>,
    /// What runs networks: onnxruntime, rten, or auto, which is onnxruntime if its library is found.
    #[arg(long, value_name = "NAME", default_value = "auto", value_parser = ["auto", "onnxruntime", "rten"])]
    runtime: String,
    /// ONNX Runtime's library, version 1.24 or newer; default: ORT_DYLIB_PATH, else beside this program.
    #[arg(long, value_name = "FILE")]
    onnxruntime: Option<PathBuf>,
    /// Ready labels instead of a network: a folder of COCO panoptic PNG files with its JSON (DIR.json, DIR/panoptic.json or
    /// DIR/../panoptic.json), or one with class/, instance/ and categories.json.
    #[arg(long, value_name = "DIR", conflicts_with = "models")]
    masks: Option<PathBuf>,
}

/// A labeller, ready to make segmenters.
pub enum Source {
    /// Files.
    Ready(ReadyMasks, PathBuf),
    /// Networks.
    Networks(Arc<NetworkSpec>, Runtime),
}

impl Labeller {
    /// Whether anything was chosen.
    pub fn is_given(&self) -> bool {
        !self.models.is_empty() || self.masks.is_some()
    }

    /// Reads and loads what was chosen.
    ///
    /// # Errors
    /// Nothing was; descriptions, models or libraries that cannot be used.
    pub fn open(&self) -> anyhow::Result<Source> {
        if let Some(folder) = &self.masks {
            return Ok(Source::Ready(ReadyMasks::open(&ReadySource::of(folder))?, folder.clone()));
        }
        if self.models.is_empty() {
            let what = "give --model TOML (once or several times) or --masks DIR; docs/segmentation.md says where models come from";
            return Err(Usage(what.to_owned()).into());
        }
        let spec = Arc::new(NetworkSpec::read(&self.models, self.models_dir.as_deref())?);
        let runtime = self.runtime()?;
        // Once here, so that a model that cannot be run is an error before anything is written.
        Network::load(&spec, &runtime)?;
        Ok(Source::Networks(spec, runtime))
    }

    fn runtime(&self) -> Result<Runtime, SegmentError> {
        let candidates = self.libraries();
        match self.runtime.as_str() {
            "rten" => Runtime::rten(),
            "onnxruntime" => Runtime::onnx_runtime(&candidates),
            // A library that was named is meant.
            _ if self.onnxruntime.is_some() || candidates.iter().any(|path| path.is_file()) => {
                Runtime::onnx_runtime(&candidates)
            }
            _ => Runtime::rten(),
        }
    }

    /// Where ONNX Runtime may be: what was named, else the variable, else files beside this program.
    fn libraries(&self) -> Vec<PathBuf> {
        if let Some(named) = &self.onnxruntime {
            return vec![named.clone()];
        }
        let mut found: Vec<PathBuf> =
            std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()).map(PathBuf::from).into_iter().collect();
        let program = std::env::current_exe().ok();
        if let Some(folder) = program.as_deref().and_then(Path::parent) {
            found.extend(beside(folder));
        }
        found
    }
}

/// `libonnxruntime.so` in a folder, else the newest of its versions by name.
fn beside(folder: &Path) -> Vec<PathBuf> {
    let plain = folder.join("libonnxruntime.so");
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_version =
        |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("libonnxruntime.so."));
    let mut versions: Vec<PathBuf> = entries.filter(is_version).collect();
    versions.sort();
    std::iter::once(plain).chain(versions.into_iter().rev()).collect()
}

impl Source {
    /// A segmenter for one thread.
    pub fn segmenter(&self) -> Result<Box<dyn Segmenter>, SegmentError> {
        Ok(match self {
            Self::Ready(masks, _) => Box::new(masks.clone()),
            Self::Networks(spec, runtime) => Box::new(Network::load(spec, runtime)?),
        })
    }

    /// All categories.
    pub fn categories(&self) -> Vec<Category> {
        match self {
            Self::Ready(masks, _) => masks.categories().to_vec(),
            Self::Networks(spec, _) => spec.categories.clone(),
        }
    }

    /// In words.
    pub fn origin(&self) -> String {
        match self {
            Self::Ready(_, folder) => {
                format!("ready masks, folder {}", folder.file_name().unwrap_or_default().to_string_lossy())
            }
            Self::Networks(spec, runtime) => {
                let names: Vec<&str> = spec.models.iter().map(|model| model.description.name.as_str()).collect();
                let info = runtime.info();
                format!("{} on {} {}", names.join(" + "), info.name, info.version)
            }
        }
    }

    /// What decides on the labels, for the log: keys as `model/0/blake3`.
    pub fn record(&self) -> BTreeMap<String, String> {
        let mut record = BTreeMap::from([("origin".to_owned(), self.origin())]);
        if let Self::Networks(spec, runtime) = self {
            record.insert("runtime/name".to_owned(), runtime.info().name.clone());
            record.insert("runtime/version".to_owned(), runtime.info().version.clone());
            for (number, model) in spec.models.iter().enumerate() {
                let description = &model.description;
                // A description that was read can be written again.
                let all = serde_json::json!(description).to_string();
                for (key, value) in [
                    ("name", &description.name),
                    ("licence", &description.licence),
                    ("blake3", &model.blake3),
                    ("description", &all),
                ] {
                    record.insert(format!("model/{number}/{key}"), value.clone());
                }
            }
        }
        record
    }
}

/// Now, in UTC; SOURCE_DATE_EPOCH (seconds since 1970) takes its place for logs that shall have the same bytes again.
pub fn time() -> Result<String, Usage> {
    match std::env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => text
            .trim()
            .parse()
            .map(utc)
            .map_err(|_| Usage(format!("SOURCE_DATE_EPOCH `{text}` is no number of seconds"))),
        Err(_) => Ok(utc(recorder::Arrival::now().realtime_ns / 1_000_000_000)),
    }
}

/// Seconds since 1970 as ISO 8601 (days to date after Hinnant, "chrono-compatible low-level date algorithms").
fn utc(seconds: i64) -> String {
    let (days, of_day) = (seconds.div_euclid(86_400) + 719_468, seconds.rem_euclid(86_400));
    let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let (date, month) =
        (day_of_year - (153 * shifted + 2) / 5 + 1, if shifted < 10 { shifted + 3 } else { shifted - 9 });
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    let (hour, minute, second) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}-{month:02}-{date:02}T{hour:02}:{minute:02}:{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_782_399), "2000-02-28T23:59:59Z");
        assert_eq!(utc(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(utc(1_764_234_000), "2025-11-27T09:00:00Z");
    }
}
