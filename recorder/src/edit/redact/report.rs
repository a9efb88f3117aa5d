//! What was redacted, for people, programs and the log itself.

use super::RedactOptions;
use super::area::Cover;
use super::people::Doubt;
use super::pixels::Method;
use crate::edit::{EditSummary, Frame};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// Frames told in words; all of them stand in the JSON.
const TOLD: usize = 20;

/// What is redacted, frame by frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Redacted {
    /// Redacted pixels of each frame.
    pub pixels: Vec<usize>,
    /// Pixels of a picture.
    pub picture_pixels: usize,
    /// Frames in doubt.
    pub doubts: Vec<Doubt>,
}

impl Redacted {
    pub(super) fn new(frames: usize, doubts: Vec<Doubt>) -> Self {
        Self { pixels: vec![0; frames], picture_pixels: 0, doubts }
    }

    pub(super) fn count(&mut self, frame: usize, cover: &Cover) {
        self.picture_pixels = cover.width * cover.height;
        self.pixels[frame] = cover.pixels();
    }

    /// Share of the picture that is redacted, mean and largest of all frames, 0..=1.
    #[must_use]
    pub fn share(&self) -> (f64, f64) {
        let all = (self.picture_pixels.max(1)) as f64;
        let sum: usize = self.pixels.iter().sum();
        let largest = self.pixels.iter().max().copied().unwrap_or(0);
        (sum as f64 / (all * self.pixels.len().max(1) as f64), largest as f64 / all)
    }

    /// The log's own record of it.
    pub(super) fn metadata(&self, options: &RedactOptions<'_>) -> BTreeMap<String, String> {
        let list = |numbers: &mut dyn Iterator<Item = usize>| {
            numbers.map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
        };
        let mut values = options.arguments();
        let (mean, largest) = self.share();
        values.extend([
            ("frames".to_owned(), self.pixels.len().to_string()),
            ("frames_redacted".to_owned(), self.pixels.iter().filter(|pixels| **pixels > 0).count().to_string()),
            ("share_mean".to_owned(), format!("{mean:.6}")),
            ("share_largest".to_owned(), format!("{largest:.6}")),
            ("pixels_by_frame".to_owned(), list(&mut self.pixels.iter().copied())),
            ("doubts".to_owned(), serde_json::json!(self.doubts).to_string()),
            ("depth".to_owned(), "taken away (0) where colour is redacted".to_owned()),
            ("masks".to_owned(), "redacted areas are one segment of the first class, or void".to_owned()),
        ]);
        values.into_iter().collect()
    }
}

impl RedactOptions<'_> {
    /// What was asked for, as text.
    #[must_use]
    pub fn arguments(&self) -> BTreeMap<String, String> {
        let (method, block) = match self.method {
            Method::Fill => ("fill", None),
            Method::Pixelate { block_px } => ("pixelate", Some(block_px)),
            Method::Blur { block_px } => ("blur", Some(block_px)),
        };
        let classes: Vec<&str> = self.classes.iter().map(String::as_str).collect();
        let mut values = BTreeMap::from([
            ("layer".to_owned(), self.layer.clone()),
            ("classes".to_owned(), classes.join(", ")),
            ("margin_px".to_owned(), self.margin_px.to_string()),
            ("unknown".to_owned(), if self.cover_unknown { "cover" } else { "keep" }.to_owned()),
            ("neighbours".to_owned(), self.neighbours.to_string()),
            ("motion_px".to_owned(), self.motion_px.to_string()),
            ("bridge".to_owned(), self.bridge.to_string()),
            ("method".to_owned(), method.to_owned()),
            ("doubtful".to_owned(), if self.cover_doubtful { "cover" } else { "refuse" }.to_owned()),
        ]);
        values.extend(block.map(|block| ("block_px".to_owned(), block.to_string())));
        values
    }
}

/// What [`super::redact`] did.
#[derive(Debug, Clone, Serialize)]
pub struct RedactReport {
    /// Version of this form; grows when a field changes its meaning.
    pub version: u32,
    /// Nothing was written: frames are in doubt, and no frames around stand in.
    pub refused: bool,
    /// What was asked for.
    pub options: BTreeMap<String, String>,
    /// What is redacted; of a refused log only the doubts.
    pub redacted: Redacted,
    /// The edit; none of a refused log.
    pub edit: Option<EditSummary>,
}

impl RedactReport {
    pub(super) fn refusal(options: &RedactOptions<'_>, frames: &[Frame], doubts: Vec<Doubt>) -> Self {
        let redacted = Redacted::new(frames.len(), doubts);
        Self { version: 1, refused: true, options: options.arguments(), redacted, edit: None }
    }

    pub(super) fn done(options: &RedactOptions<'_>, redacted: Redacted, edit: EditSummary) -> Self {
        Self { version: 1, refused: false, options: options.arguments(), redacted, edit: Some(edit) }
    }
}

impl fmt::Display for RedactReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(edit) = &self.edit {
            edit.fmt(f)?;
            let frames = self.redacted.pixels.iter().filter(|pixels| **pixels > 0).count();
            let (mean, largest) = self.redacted.share();
            let (all, mean, largest) = (self.redacted.pixels.len(), 100.0 * mean, 100.0 * largest);
            writeln!(
                f,
                "redacted {frames} of {all} frames, {mean:.1} % of a picture on average, {largest:.1} % at most"
            )?;
        }
        let (bridged, open): (Vec<&Doubt>, Vec<&Doubt>) = self.redacted.doubts.iter().partition(|doubt| doubt.bridged);
        writeln!(
            f,
            "in doubt {} frames, of which frames around stand in for {}",
            bridged.len() + open.len(),
            bridged.len()
        )?;
        for doubt in open.iter().take(TOLD) {
            let reasons: Vec<String> =
                doubt.reasons.iter().map(|reason| format!("{reason:?}").to_lowercase()).collect();
            writeln!(f, "  frame {} at {} s: {}", doubt.frame, doubt.stamp, reasons.join(", "))?;
        }
        if open.len() > TOLD {
            writeln!(f, "  and {} more (--json lists all)", open.len() - TOLD)?;
        }
        if self.refused {
            writeln!(f, "REFUSED  nobody can tell who is in these frames; --doubtful cover redacts them whole")?;
        }
        Ok(())
    }
}
