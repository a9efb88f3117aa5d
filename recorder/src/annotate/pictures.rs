//! The colour pictures of a log, in file order.

use super::AnnotateError;
use crate::edit::{EditError, Item, RawMessage, Source, SourceFile};
use crate::picture::{PictureError, decode_color};
use schemas::msg::{CompressedImage, Image, encoding};
use schemas::{Stamp, topics};
use segment::{Picture, SegmentError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A picture as it stands in the log.
pub struct Undecoded {
    pub index: usize,
    pub stamp: Stamp,
    message: RawMessage<'static>,
    log: PathBuf,
}

impl Undecoded {
    /// BLAKE3 of the message's bytes.
    pub fn digest(&self) -> [u8; 32] {
        *blake3::hash(&self.message.data).as_bytes()
    }

    /// An error about its labels.
    pub fn error(&self, source: SegmentError) -> AnnotateError {
        AnnotateError::Frame { log: self.log.clone(), index: self.index, stamp: self.stamp, source }
    }

    /// Its pixels.
    pub fn decode(&self) -> Result<Picture, AnnotateError> {
        let wrong = |reason: String| EditError::message(&self.message, reason);
        let picture =
            |source| AnnotateError::Picture { log: self.log.clone(), index: self.index, stamp: self.stamp, source };
        let (width, height, rgb) = if self.message.topic() == topics::COLOR {
            let image: CompressedImage<'_> = self.message.decode().map_err(wrong)?;
            let pixels = decode_color(&image.data).map_err(picture)?;
            let rgb = match pixels.channels {
                1 => pixels.data.iter().flat_map(|level| [*level; 3]).collect(),
                _ => pixels.data,
            };
            (pixels.width, pixels.height, rgb)
        } else {
            let image: Image<'_> = self.message.decode().map_err(wrong)?;
            let bytes = u64::from(image.width) * u64::from(image.height) * 3;
            if image.encoding != encoding::RGB8 || image.data.len() as u64 != bytes {
                let found = format!(
                    "`{}` with {} bytes for {}x{}",
                    image.encoding,
                    image.data.len(),
                    image.width,
                    image.height
                );
                return Err(picture(PictureError::Layout { found, wanted: "rgb8" }));
            }
            (image.width, image.height, image.data.into_owned())
        };
        Ok(Picture { stamp: self.stamp, index: self.index, width: width as usize, height: height as usize, rgb })
    }
}

/// Whether a message is a colour picture.
pub fn is_picture(topic: &str) -> bool {
    matches!(topic, topics::COLOR | topics::COLOR_RAW)
}

/// Reads a log's pictures one after the other.
pub struct Pictures {
    source: Source,
    log: PathBuf,
    next: usize,
}

impl Pictures {
    pub fn open(log: &Path) -> Result<Self, AnnotateError> {
        Ok(Self { source: Source::open(log)?, log: log.to_owned(), next: 0 })
    }

    pub fn next(&mut self) -> Result<Option<Undecoded>, AnnotateError> {
        while let Some(item) = self.source.next()? {
            let Item::Message(message) = item else { continue };
            if is_picture(message.topic()) {
                let stamp = message.stamp().map_err(|reason| EditError::message(&message, reason))?;
                let index = self.next;
                self.next += 1;
                return Ok(Some(Undecoded { index, stamp, message: message.into_owned(), log: self.log.clone() }));
            }
        }
        Ok(None)
    }
}

/// The number of pictures of a log that has no such layer yet; the whole log is read and checked.
pub fn survey(log: &Path, layer: &str) -> Result<usize, AnnotateError> {
    let mut source = Source::open(log)?;
    let mut pictures = 0;
    let refused = |reason: String| Err(AnnotateError::Refused { log: log.to_owned(), reason });
    while let Some(item) = source.next()? {
        match item {
            Item::Channel(channel) if topics::layer_of(&channel.topic) == Some(layer) => {
                return refused(format!(
                    "has a segmentation layer `{layer}` already: give the new one another name with --layer"
                ));
            }
            Item::Message(message) => pictures += usize::from(is_picture(message.topic())),
            _ => {}
        }
    }
    if pictures == 0 {
        return refused(format!("has no colour picture on {} or {}", topics::COLOR, topics::COLOR_RAW));
    }
    Ok(pictures)
}

/// A log's size and hash.
pub fn hashed(log: &Path) -> Result<SourceFile, AnnotateError> {
    let mut source = Source::open(log)?;
    while source.next()?.is_some() {}
    Ok(SourceFile { file: log.to_owned(), bytes: source.file_bytes(), blake3: source.blake3() })
}

/// Metadata records by name.
pub type Records = BTreeMap<String, BTreeMap<String, String>>;

/// A log's metadata records; none for a log that is not whole.
pub fn records(log: &Path) -> Result<Option<Records>, AnnotateError> {
    let mut records = BTreeMap::new();
    let mut read = || -> Result<(), EditError> {
        let mut source = Source::open(log)?;
        while let Some(item) = source.next()? {
            if let Item::Metadata { name, values } = item {
                records.insert(name, values);
            }
        }
        Ok(())
    };
    match read() {
        Ok(()) => Ok(Some(records)),
        Err(error @ EditError::Io { .. }) => Err(error.into()),
        Err(_) => Ok(None),
    }
}
