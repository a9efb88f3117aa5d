//! A dataset folder ready to publish: logs, checksums, a README with a card, a citation, Croissant metadata, statistics and
//! contact sheets. Bytes depend on logs and options alone.

mod citation;
mod croissant;
mod issues;
mod readme;
mod sheet;
mod statistics;

use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::export::ExportError;
use crate::log::{LogError, check};
use crate::{OutputError, OutputFolder};
pub use statistics::{ClassShare, LogStatistics, SyncQuality};

/// The file by which a card's folder is known; an older folder without it is never replaced.
const MARKER: &str = "croissant.json";

/// How logs come into the folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transport {
    /// The originals stay.
    #[default]
    Copy,
    /// A second name for the same bytes on the disk.
    HardLink,
    /// The originals are removed once the folder is complete.
    Move,
}

/// What the card says and no log can tell.
#[derive(Debug, Clone, Default)]
pub struct CardOptions {
    /// Title of the dataset; by default the folder's name.
    pub title: Option<String>,
    /// One paragraph.
    pub description: Option<String>,
    /// SPDX identifier of the licence, as `CC-BY-4.0`; without it a placeholder.
    pub license: Option<String>,
    /// Text of the licence, copied to `LICENSE`.
    pub license_file: Option<PathBuf>,
    /// Names of people or institutions; without any a placeholder.
    pub authors: Vec<String>,
    /// Where it will be published.
    pub url: Option<String>,
    /// Version of the dataset; by default 1.0.0.
    pub version: Option<String>,
    /// Day of publication, `YYYY-MM-DD`; nothing asks the clock.
    pub date: Option<String>,
    /// How logs come into the folder.
    pub transport: Transport,
    /// Replace an older card.
    pub force: bool,
}

/// Why there is no card.
#[derive(Debug, thiserror::Error)]
pub enum CardError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A log that nobody should be given.
    #[error("{} is damaged or broken: see `pslam check`, `pslam recover`", .0.display())]
    Damaged(PathBuf),
    /// A log's contents cannot be shown.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The folder cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// What is asked for makes no sense.
    #[error("{0}")]
    Refused(String),
}

/// A file of the folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SharedFile {
    /// Its path in the folder.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// What stands in the folder.
#[derive(Debug, Clone, Serialize)]
pub struct CardReport {
    /// Version of this form.
    pub version: u32,
    /// The folder.
    pub folder: PathBuf,
    /// All files but `SHA256SUMS`, sorted.
    pub files: Vec<SharedFile>,
    /// What each log holds.
    pub logs: Vec<LogStatistics>,
    /// What a person must fill in before publishing.
    pub to_fill_in: Vec<String>,
}

impl fmt::Display for CardReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "folder         {}", self.folder.display())?;
        for log in &self.logs {
            writeln!(f, "log            {}: {} frames, {:.1} s", log.file, log.frames, log.duration_s)?;
        }
        writeln!(f, "files          {} and SHA256SUMS", self.files.len())?;
        for what in &self.to_fill_in {
            writeln!(f, "to fill in     {what}")?;
        }
        Ok(())
    }
}

/// The texts of a card.
struct Card<'a> {
    title: String,
    options: &'a CardOptions,
    logs: &'a [LogStatistics],
    /// All files that stand there already.
    files: &'a [SharedFile],
    to_fill_in: Vec<String>,
}

/// Writes the folder `out` for `logs`. `progress` hears (pictures done, pictures in all) of one log after the other.
///
/// # Errors
/// A damaged log, two logs of one name, options that make no sense, something in the way at `out`, or the system refuses
/// (then nothing is left behind, and no original is removed).
pub fn card(
    logs: &[PathBuf],
    out: &Path,
    options: &CardOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<CardReport, CardError> {
    let names = names(logs)?;
    check_options(options)?;
    let folder = OutputFolder::create(out, MARKER, options.force)?;
    let (mut statistics, mut files) = (Vec::new(), Vec::new());
    for (log, name) in logs.iter().zip(&names) {
        let findings = check(log)?;
        if !findings.is_sound() {
            return Err(CardError::Damaged(log.clone()));
        }
        statistics.push(statistics::of(log, &findings, &folder, progress)?);
        let path = format!("logs/{name}");
        bring(log, &folder.path(&path), options.transport)?;
        files.push(path);
    }
    let placed = |folder: &OutputFolder, paths: &[String]| -> Result<Vec<SharedFile>, OutputError> {
        paths.iter().map(|path| hashed(folder, path)).collect()
    };
    files.extend(statistics.iter().map(|log| log.contact_sheet.clone()));
    let json = serde_json::to_string_pretty(&statistics).unwrap_or_default() + "\n";
    let license = license_text(options)?;
    for (name, text) in
        [("statistics.json", &json), ("frames.csv", &statistics::frames_csv(&statistics)), ("LICENSE", &license)]
    {
        folder.write(name, text.as_bytes())?;
        files.push(name.to_owned());
    }
    let mut files = placed(&folder, &files)?;
    let title = options.title.clone().unwrap_or_else(|| title_of(out));
    let mut card = Card { title, options, logs: &statistics, files: &files, to_fill_in: Vec::new() };
    let citation = card.citation();
    let croissant = card.croissant();
    let readme = card.readme();
    let to_fill_in = card.to_fill_in;
    let texts = [("CITATION.cff", citation), (MARKER, croissant), ("README.md", readme)];
    for (name, text) in &texts {
        folder.write(name, text.as_bytes())?;
        files.push(hashed(&folder, name)?);
    }
    files.sort_by(|a, b| a.path.cmp(&b.path));
    let sums: String = files.iter().map(|file| format!("{}  {}\n", file.sha256, file.path)).collect();
    folder.write("SHA256SUMS", sums.as_bytes())?;
    folder.finish()?;
    if options.transport == Transport::Move {
        for log in logs {
            fs::remove_file(log).map_err(|source| OutputError::Io { path: log.clone(), source })?;
        }
    }
    Ok(CardReport { version: 1, folder: out.to_owned(), files, logs: statistics, to_fill_in })
}

/// File names of the logs, each once.
fn names(logs: &[PathBuf]) -> Result<Vec<String>, CardError> {
    let names: Vec<String> =
        logs.iter().map(|log| log.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect();
    let twice = (1..names.len()).find(|i| names[..*i].contains(&names[*i]));
    match twice {
        Some(i) => Err(CardError::Refused(format!("two logs are called {}: rename one", names[i]))),
        None if names.is_empty() => Err(CardError::Refused("no log is given".to_owned())),
        None => Ok(names),
    }
}

fn check_options(options: &CardOptions) -> Result<(), CardError> {
    let texts = [&options.title, &options.license, &options.url, &options.version, &options.description];
    let texts = texts.into_iter().flatten().chain(&options.authors);
    if let Some(text) = texts.into_iter().find(|text| text.trim().is_empty() || text.chars().any(char::is_control)) {
        return Err(CardError::Refused(format!("`{text}` is no line of text")));
    }
    let is_day = |text: &String| {
        let parts: Vec<&str> = text.split('-').collect();
        let digits = parts.iter().all(|part| part.bytes().all(|b| b.is_ascii_digit()));
        let lengths: Vec<usize> = parts.iter().map(|part| part.len()).collect();
        let within = |i: usize, most: u32| parts[i].parse().is_ok_and(|value: u32| (1..=most).contains(&value));
        digits && lengths == [4, 2, 2] && within(1, 12) && within(2, 31)
    };
    if let Some(date) = options.date.as_ref().filter(|date| !is_day(date)) {
        return Err(CardError::Refused(format!("`{date}` is not a day like 2026-01-31")));
    }
    Ok(())
}

fn title_of(out: &Path) -> String {
    let name = out.components().next_back().map(|part| part.as_os_str().to_string_lossy().into_owned());
    name.filter(|name| name != "." && name != "..").unwrap_or_else(|| "Dataset".to_owned())
}

fn license_text(options: &CardOptions) -> Result<String, CardError> {
    if let Some(path) = &options.license_file {
        return fs::read_to_string(path).map_err(|source| OutputError::Io { path: path.clone(), source }.into());
    }
    Ok(match &options.license {
        Some(id) => format!("SPDX-License-Identifier: {id}\n\nReplace this line by the text of the licence.\n"),
        None => "FILL IN: the licence under which this dataset is published.\n".to_owned(),
    })
}

/// Brings a log into the folder. What moves is linked first: the original goes when everything else stands.
fn bring(log: &Path, to: &Path, transport: Transport) -> Result<(), OutputError> {
    let failed = |source| OutputError::Io { path: to.to_owned(), source };
    if let Some(parent) = to.parent() {
        fs::create_dir_all(parent).map_err(failed)?;
    }
    let linked = match transport {
        Transport::Copy => Err(io::ErrorKind::Unsupported.into()),
        Transport::HardLink | Transport::Move => fs::hard_link(log, to),
    };
    match (linked, transport) {
        (Ok(()), _) => Ok(()),
        (Err(source), Transport::HardLink) => Err(failed(source)),
        (Err(_), _) => fs::copy(log, to).map(drop).map_err(failed),
    }
}

fn hashed(folder: &OutputFolder, name: &str) -> Result<SharedFile, OutputError> {
    let path = folder.path(name);
    let mut hash = Sha256::new();
    let mut bytes = 0;
    let mut read = || -> io::Result<()> {
        let mut file = File::open(&path)?;
        let mut buffer = vec![0; 1 << 20];
        loop {
            match file.read(&mut buffer)? {
                0 => return Ok(()),
                count => {
                    hash.update(&buffer[..count]);
                    bytes += count as u64;
                }
            }
        }
    };
    read().map_err(|source| OutputError::Io { path: path.clone(), source })?;
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(SharedFile { path: name.to_owned(), bytes, sha256 })
}
