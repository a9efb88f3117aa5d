//! ROS 2 bags (rosbag2 folders with MCAP storage).
//!
//! A bag that `pslam export rosbag2` wrote holds a log, which comes back byte by byte. Any other bag gives its pictures,
//! depth, poses and inertial rows by topic, stamped by their headers.

mod foreign;
mod pixels;
mod read;

use super::{ImportError, read_text};
use read::{Record, read};
use schemas::{Stamp, metadata};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use crate::log_writer::WriteError;

/// Which topics of a bag to take; `None` = the only one of its kind.
#[derive(Debug, Clone, Default)]
pub struct BagOptions {
    /// Colour pictures (`sensor_msgs/Image` or `CompressedImage`).
    pub color: Option<String>,
    /// Depth registered to colour (`sensor_msgs/Image`, `16UC1` in millimetres or `32FC1` in metres).
    pub depth: Option<String>,
    /// Calibration of the colour camera (`sensor_msgs/CameraInfo`).
    pub info: Option<String>,
    /// Ground truth, `world_from_camera` (`geometry_msgs/PoseStamped`); never guessed.
    pub pose: Option<String>,
    /// Inertial rows (`sensor_msgs/Imu`).
    pub imu: Option<String>,
    /// Replace an existing log.
    pub force: bool,
}

/// What an import did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicReport {
    /// The folder.
    pub source: PathBuf,
    /// The log.
    pub log: PathBuf,
    /// Its size.
    pub log_bytes: u64,
    /// Whether the folder held a log, which stands there now as it was.
    pub same_bytes: bool,
    /// Messages taken, by topic of the source.
    pub taken: BTreeMap<String, u64>,
    /// First and last stamp of all messages.
    pub span: Option<(Stamp, Stamp)>,
    /// What was repaired or left out, with counts; empty = nothing.
    pub repairs: BTreeMap<String, u64>,
}

impl fmt::Display for TopicReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let how = if self.same_bytes { ", the bytes of the log that the bag holds" } else { "" };
        writeln!(f, "log            {} ({:.1} MB){how}", self.log.display(), self.log_bytes as f64 / 1e6)?;
        if let Some((first, last)) = self.span {
            writeln!(f, "time           {first} .. {last} s")?;
        }
        for (topic, count) in &self.taken {
            writeln!(f, "taken          {count} from {topic}")?;
        }
        for (what, count) in &self.repairs {
            writeln!(f, "repaired       {count} x {what}")?;
        }
        Ok(())
    }
}

/// Imports a bag folder (or its MCAP file alone) into a log at `out`. `progress` hears (messages done, messages in all).
///
/// # Errors
/// Another storage than MCAP, a damaged file, topics that cannot be told apart, messages that no log can hold; or the log
/// cannot be written. The unfinished log is then removed.
pub fn rosbag2(
    dir: &Path,
    out: &Path,
    options: &BagOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<TopicReport, ImportError> {
    let files = files(dir)?;
    let mut taken: BTreeMap<String, u64> = BTreeMap::new();
    let mut is_log = false;
    for file in &files {
        read(file, &mut |record| {
            match record {
                Record::Message(message) => *taken.entry(message.topic.to_owned()).or_default() += 1,
                Record::Metadata(name) => is_log |= name == metadata::SOURCE,
            }
            Ok(())
        })?;
    }
    match files.as_slice() {
        [file] if is_log => {
            let log_bytes = copy(file, out, options.force)?;
            let (source, log) = (dir.to_owned(), out.to_owned());
            Ok(TopicReport { source, log, log_bytes, same_bytes: true, taken, span: None, repairs: BTreeMap::new() })
        }
        _ => foreign::import(dir, &files, out, options, progress),
    }
}

/// The files of a bag in their order.
fn files(dir: &Path) -> Result<Vec<PathBuf>, ImportError> {
    if dir.is_file() {
        return Ok(vec![dir.to_owned()]);
    }
    let yaml = dir.join("metadata.yaml");
    let text = read_text(&yaml, " (a ROS 2 bag is a folder with metadata.yaml)")?;
    let value = |key: &str| {
        let line = text.lines().find_map(|line| line.trim().strip_prefix(key)?.strip_prefix(':'));
        line.map(|value| unquoted(value).to_owned()).unwrap_or_default()
    };
    let storage = value("storage_identifier");
    if storage != "mcap" {
        let what =
            format!("storage `{storage}` is not read: convert it with `ros2 bag convert` or `rosbags-convert` to mcap");
        return Err(ImportError::content(&yaml, what));
    }
    if value("compression_mode").eq_ignore_ascii_case("file") {
        return Err(ImportError::content(&yaml, "its files are compressed as a whole: unpack them first"));
    }
    let mut listed = text.lines().skip_while(|line| line.trim() != "relative_file_paths:").skip(1);
    let names: Vec<String> = listed
        .by_ref()
        .map_while(|line| line.trim().strip_prefix("- "))
        .map(|name| unquoted(name).to_owned())
        .collect();
    if names.is_empty() {
        return Err(ImportError::content(&yaml, "lists no files"));
    }
    let outside = names.iter().find(|name| Path::new(name).components().count() != 1 || name.contains(".."));
    if let Some(name) = outside {
        return Err(ImportError::content(&yaml, format!("`{name}` is not a file of the folder")));
    }
    Ok(names.iter().map(|name| dir.join(name)).collect())
}

fn unquoted(text: &str) -> &str {
    text.trim().trim_matches(['"', '\''])
}

/// A whole copy under a temporary name, then the rename.
fn copy(from: &Path, out: &Path, force: bool) -> Result<u64, ImportError> {
    let partial = PathBuf::from(format!("{}.partial", out.display()));
    if !force && out.exists() {
        return Err(WriteError::Exists(out.to_owned()).into());
    }
    if !force && partial.exists() {
        return Err(WriteError::Unfinished(partial).into());
    }
    let copied = || -> std::io::Result<u64> {
        let bytes = fs::copy(from, &partial)?;
        fs::File::open(&partial)?.sync_all()?;
        fs::rename(&partial, out)?;
        Ok(bytes)
    };
    copied().map_err(|source| {
        // The source still stands; what made the copy fail is the error to report.
        let _ = fs::remove_file(&partial);
        WriteError::Io { path: partial.clone(), source }.into()
    })
}
