//! The bytes of frames, read chunk by chunk.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::op;
use schemas::alignment::Aligner;
use schemas::msg::{CompressedImage, Image, encoding};
use schemas::{Stamp, topics};

use super::chunk::{MAX_RECORD_BYTES, RECORD_HEADER_BYTES, inner_record, message, read_u64, unpack};
use super::container::Place;
use super::open::{Entry, decoded};
use super::{LogError, TimelineFrame};

/// Unpacked chunks that are kept: neighbouring frames share chunks, and masks may stand behind their pictures.
const CACHE_BYTES: usize = 32 << 20;

/// A picture file as it stands in the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncodedImage {
    /// `png` or `jpeg`, see [`schemas::msg::format`]; `rgb8` for raw pixels.
    pub format: String,
    /// The file.
    pub bytes: Vec<u8>,
}

/// What holds for the pixels of all frames.
#[derive(Debug, Clone)]
pub(crate) struct Pixels {
    /// Depth value of one metre.
    pub units_per_metre: f64,
    /// Registers depth to colour, if it is native.
    pub aligner: Option<Arc<Aligner>>,
    /// Where the pictures stand: [`topics::COLOR`] or [`topics::COLOR_RAW`].
    pub color_topic: &'static str,
}

/// A picture's message as a picture file, or as raw pixels with their encoding as the format.
pub(crate) fn encoded_image(message: &[u8], raw: bool) -> Result<EncodedImage, String> {
    if !raw {
        let picture: CompressedImage<'_> = decoded(message)?;
        return Ok(EncodedImage { format: picture.format, bytes: picture.data.into_owned() });
    }
    let image: Image<'_> = decoded(message)?;
    if image.encoding != encoding::RGB8 || image.step != image.width * 3 {
        return Err(format!("{} with {} bytes a row is not rgb8 without padding", image.encoding, image.step));
    }
    Ok(EncodedImage { format: image.encoding, bytes: image.data.into_owned() })
}

/// What the log holds for one frame; [`decode`](super::decode()) turns it into pixels.
#[derive(Debug, Clone)]
pub struct RawFrame {
    /// Position on the timeline.
    pub index: usize,
    /// Of the colour picture.
    pub stamp: Stamp,
    /// The colour picture.
    pub color: EncodedImage,
    /// Depth value of one metre.
    pub units_per_metre: f64,
    /// The right picture of the pair.
    pub right: Option<EncodedImage>,
    /// The paired depth image's message.
    pub(crate) depth: Option<Vec<u8>>,
    /// Registers it to colour, if it is native.
    pub(crate) aligner: Option<Arc<Aligner>>,
    /// Class image, instance image and segment table.
    pub(crate) mask: Option<[Vec<u8>; 3]>,
}

/// Iterator over frames. Memory: the frame itself and some unpacked chunks, whatever the file's size.
#[derive(Debug)]
pub struct FrameStream {
    path: PathBuf,
    file: File,
    frames: Arc<[TimelineFrame]>,
    range: Range<usize>,
    pixels: Pixels,
    /// Offset of the chunk record and its contents, the most recently used last.
    cache: Vec<(u64, Vec<u8>)>,
}

impl FrameStream {
    pub(crate) fn new(
        path: &Path,
        frames: Arc<[TimelineFrame]>,
        range: Range<usize>,
        pixels: Pixels,
    ) -> Result<Self, LogError> {
        let file = File::open(path).map_err(|source| LogError::io(path, source))?;
        Ok(Self { path: path.to_owned(), file, frames, range, pixels, cache: Vec::new() })
    }

    fn frame(&mut self, index: usize) -> Result<RawFrame, LogError> {
        let frame = self.frames[index];
        let color = self.picture(self.pixels.color_topic, frame.color)?;
        let right = frame.right.map(|entry| self.picture(topics::RIGHT, entry)).transpose()?;
        let depth = frame.depth.map(|entry| self.message(entry)).transpose()?;
        let mask = match frame.mask {
            Some(m) => Some([self.message(m.class)?, self.message(m.instance)?, self.message(m.segments)?]),
            None => None,
        };
        let (stamp, Pixels { units_per_metre, aligner, .. }) = (frame.stamp, self.pixels.clone());
        Ok(RawFrame { index, stamp, color, right, units_per_metre, depth, aligner, mask })
    }

    fn picture(&mut self, topic: &str, entry: Entry) -> Result<EncodedImage, LogError> {
        let message = self.message(entry)?;
        encoded_image(&message, topic == topics::COLOR_RAW).map_err(|reason| LogError::Message {
            path: self.path.clone(),
            topic: topic.to_owned(),
            sequence: entry.sequence,
            stamp: entry.stamp,
            reason,
        })
    }

    /// A message's bytes, from the chunk or straight from the file.
    fn message(&mut self, entry: Entry) -> Result<Vec<u8>, LogError> {
        let Place { record, inner } = entry.place;
        let path = self.path.clone();
        let damaged = |reason: String| LogError::damaged(&path, "message", record, reason);
        let moved = || damaged("is not where it was when the log was opened: the file was changed".to_owned());
        let data = match inner {
            None => {
                let body = self.record(record, op::MESSAGE)?;
                message(&body).map_err(damaged)?.1.to_vec()
            }
            Some(offset) => {
                let (opcode, body, _) =
                    inner_record(self.chunk(record)?, offset).map_err(damaged)?.ok_or_else(moved)?;
                let (header, data) = message(body).map_err(damaged)?;
                if opcode != op::MESSAGE || header.sequence != entry.sequence {
                    return Err(moved());
                }
                data.to_vec()
            }
        };
        Ok(data)
    }

    /// A chunk's contents, its CRC checked again.
    fn chunk(&mut self, offset: u64) -> Result<&[u8], LogError> {
        if let Some(known) = self.cache.iter().position(|(at, _)| *at == offset) {
            let entry = self.cache.remove(known);
            self.cache.push(entry);
        } else {
            let body = self.record(offset, op::CHUNK)?;
            let contents = unpack(&body).map_err(|reason| LogError::damaged(&self.path, "chunk", offset, reason))?;
            let mut bytes = contents.len();
            let kept = self.cache.iter().rev().take_while(|(_, contents)| {
                bytes += contents.len();
                bytes <= CACHE_BYTES
            });
            let dropped = self.cache.len() - kept.count();
            self.cache.drain(..dropped);
            self.cache.push((offset, contents));
        }
        Ok(self.cache.last().map_or(&[], |(_, contents)| contents))
    }

    fn record(&mut self, offset: u64, wanted: u8) -> Result<Vec<u8>, LogError> {
        let io = |source| LogError::io(&self.path, source);
        let mut head = [0; RECORD_HEADER_BYTES];
        self.file.seek(SeekFrom::Start(offset)).map_err(io)?;
        self.file.read_exact(&mut head).map_err(io)?;
        let (opcode, len) = (head[0], read_u64(&head[1..]));
        if opcode != wanted || len > MAX_RECORD_BYTES {
            let reason = format!("opcode 0x{opcode:02x} with {len} bytes: the file was changed after it was opened");
            return Err(LogError::damaged(&self.path, "record", offset, reason));
        }
        let mut body = Vec::new();
        (&mut self.file).take(len).read_to_end(&mut body).map_err(io)?;
        if body.len() as u64 != len {
            return Err(LogError::damaged(&self.path, "record", offset, "cut off after the log was opened"));
        }
        Ok(body)
    }
}

impl Iterator for FrameStream {
    type Item = Result<RawFrame, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let index = self.range.next()?;
        let frame = self.frame(index);
        if frame.is_err() {
            self.range.start = self.range.end; // one report; what follows could not be trusted to be complete
        }
        Some(frame)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let (least, most) = self.range.size_hint();
        (least.min(1), most)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;
    use crate::log::Log;
    use recorder::{LogOptions, RgbdLog, RgbdSpec};
    use schemas::calibration::{CameraModel, Distortion};

    /// A log many times as long as what is kept of it: incompressible pictures, a chunk every two frames.
    #[test]
    fn what_is_kept_does_not_grow_with_the_log() {
        const FRAMES: i64 = 120;
        const PICTURE_BYTES: usize = 1 << 20;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.mcap");
        let camera =
            CameraModel { width: 2, height: 2, fx: 2.0, fy: 2.0, cx: 1.0, cy: 1.0, distortion: Distortion::None };
        let spec = RgbdSpec::new("test", "noise", camera);
        let mut log = RgbdLog::create(&path, &LogOptions::default(), &spec).unwrap();
        let mut state = 1_u64;
        let mut picture = vec![0; PICTURE_BYTES];
        for frame in 0..FRAMES {
            for bytes in picture.chunks_mut(8) {
                state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
                bytes.copy_from_slice(&(state ^ state >> 29).to_le_bytes());
            }
            log.color(Stamp(frame * 33_000_000), "jpeg", &picture).unwrap();
            if frame % 2 == 1 {
                log.log().flush().unwrap();
            }
        }
        log.finish().unwrap();
        assert!(path.metadata().unwrap().len() as usize > 3 * CACHE_BYTES);

        let timeline = Log::open(&path).unwrap().timeline(None).unwrap();
        let mut stream = timeline.stream(0..FRAMES as usize).unwrap();
        let mut frames = 0;
        while let Some(frame) = stream.next() {
            assert_eq!(frame.unwrap().color.bytes.len(), PICTURE_BYTES);
            let kept: usize = stream.cache.iter().map(|(_, contents)| contents.capacity()).sum();
            assert!(kept <= CACHE_BYTES + 4 * PICTURE_BYTES, "{kept} bytes after frame {frames}");
            frames += 1;
        }
        assert_eq!(frames, FRAMES);
    }
}
