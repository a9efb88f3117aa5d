//! Two segmentation layers of the same pictures, compared.

use crate::log::{Log, LogError, MaskPixels, RawFrame, mask_of};
use schemas::Stamp;
use segment::Mask;
use segment::quality::{Judge, MeanQuality, Quality};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Why layers cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum MasksError {
    /// A log that cannot be read.
    #[error("{0}")]
    Log(#[from] LogError),
    /// A mask that cannot be used.
    #[error("{}: mask at {stamp} s: {reason}", log.display())]
    Mask {
        /// The log.
        log: PathBuf,
        /// Of the picture.
        stamp: Stamp,
        /// What is wrong.
        reason: String,
    },
    /// No picture is labelled in both.
    #[error("no picture has labels in both layers")]
    NothingInCommon,
}

/// The comparison.
#[derive(Debug, Serialize)]
pub struct LayerComparison {
    /// The layer that is judged.
    pub layer: String,
    /// The layer that is right.
    pub truth: String,
    /// Pictures that the truth labels and the layer does not.
    pub unlabelled: usize,
    /// The numbers.
    #[serde(flatten)]
    pub quality: Quality,
}

/// Judges a layer of a log by another one, of this log or of another one of the same pictures (found by their stamps).
///
/// # Errors
/// Logs or layers that cannot be read.
pub fn compare_layers(layer: (&Path, &str), truth: (&Path, &str)) -> Result<LayerComparison, MasksError> {
    let (judged, right) = (Log::open(layer.0)?, Log::open(truth.0)?);
    let mut judge = Judge::new(right.categories(truth.1), judged.categories(layer.1));
    let mut unlabelled = 0;
    // Two streams side by side, both in order of stamps.
    let (mut stream, mut waiting) = (masks(&judged, layer.1)?, None);
    for item in masks(&right, truth.1)? {
        let (stamp, wanted) = item?;
        while waiting.as_ref().is_none_or(|(at, _)| *at < stamp) {
            match stream.next() {
                Some(next) => waiting = Some(next?),
                None => break,
            }
        }
        match waiting.take_if(|(at, _)| *at == stamp) {
            Some((_, mask)) => judge.add(&wanted, &mask).map_err(|reason| wrong(&judged, stamp, reason))?,
            None => unlabelled += 1,
        }
    }
    let quality = judge.quality();
    if quality.frames == 0 {
        return Err(MasksError::NothingInCommon);
    }
    Ok(LayerComparison { layer: layer.1.to_owned(), truth: truth.1.to_owned(), unlabelled, quality })
}

fn wrong(log: &Log, stamp: Stamp, reason: String) -> MasksError {
    MasksError::Mask { log: log.path().to_owned(), stamp, reason }
}

/// The masks of a layer, in order of their stamps.
fn masks<'l>(
    log: &'l Log,
    layer: &str,
) -> Result<impl Iterator<Item = Result<(Stamp, Mask), MasksError>> + use<'l>, MasksError> {
    let camera = log.camera()?;
    let frames = log.timeline(Some(layer))?.keeping(false, false).stream(0..usize::MAX)?;
    let mask = move |raw: Result<RawFrame, LogError>| {
        let raw = raw?;
        let mask = mask_of(&raw, &camera).map_err(|reason| wrong(log, raw.stamp, reason))?;
        let mask = mask.map(|MaskPixels { class, instance, segments }| Mask { class, instance, segments });
        Ok(mask.map(|mask| (raw.stamp, mask)))
    };
    Ok(frames.filter_map(move |raw| mask(raw).transpose()))
}

impl fmt::Display for LayerComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Quality { frames, pixel_agreement, all, things, stuff, person, classes, foreign } = &self.quality;
        writeln!(f, "layer {} judged by {}: {frames} frames, {} unlabelled", self.layer, self.truth, self.unlabelled)?;
        writeln!(f, "{:<24} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6}", "", "PQ", "SQ", "RQ", "TP", "FP", "FN")?;
        let row = |f: &mut fmt::Formatter<'_>, name: &str, mean: &MeanQuality| {
            let MeanQuality { pq, sq, rq, classes } = mean;
            writeln!(f, "{name:<24} {pq:>6.3} {sq:>6.3} {rq:>6.3}   over {classes} classes")
        };
        row(f, "all", all)?;
        row(f, "things", things)?;
        row(f, "stuff", stuff)?;
        for c in classes {
            let (tp, fp, missed) = (c.true_positives, c.false_positives, c.false_negatives);
            writeln!(f, "  {:<22} {:>6.3} {:>6.3} {:>6.3} {tp:>6} {fp:>6} {missed:>6}", c.name, c.pq, c.sq, c.rq)?;
        }
        writeln!(f, "same class in {:.2} % of all pixels", 100.0 * pixel_agreement)?;
        if person.pixels > 0 {
            let part = |pixels: u64| 100.0 * pixels as f64 / person.pixels as f64;
            let (recall, precision) = (100.0 * person.recall, 100.0 * person.precision);
            writeln!(f, "people: recall {recall:.2} %, precision {precision:.2} % of pixels")?;
            let (thing, void, stuff) = (part(person.as_thing), part(person.as_void), part(person.as_stuff));
            writeln!(f, "  the rest: {thing:.2} % other things, {void:.2} % unknown, {stuff:.2} % stuff")?;
            writeln!(f, "  missed (less than half found) in {} of {} frames", person.missed_frames, person.frames)?;
        }
        if !foreign.is_empty() {
            writeln!(f, "classes that the truth has no name for: {}", foreign.join(", "))?;
        }
        Ok(())
    }
}
