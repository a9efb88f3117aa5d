//! Reading logs.
//!
//! [`Log::open`] goes through the file once, checks every CRC and remembers where each message stands. From it come
//! [`Log::info`] (what is in the file), [`Log::timeline`] (frames in order of time) and [`Timeline::stream`] (their
//! bytes, chunk by chunk, so that memory does not grow with the file). [`check`] goes on after damage and lists all of
//! it. [`decode`] is a pure function from a frame's bytes to pixels.

mod check;
mod chunk;
mod container;
mod decode;
mod error;
mod info;
mod mocap;
mod open;
mod recording;
mod registration;
mod signals;
mod stream;
mod timeline;

pub use check::{CheckReport, Finding, Severity, check};
pub(crate) use container::{Event, scan};
pub use decode::{DecodeError, DecodedFrame, DepthPixels, MaskPixels, RgbImage, decode};
pub(crate) use decode::{color as color_pixels, mask as mask_pixels, mask_of};
pub use error::LogError;
pub use info::{AttachmentInfo, GroundTruthInfo, LayerInfo, LogInfo, TopicInfo};
pub use open::Log;
pub(crate) use open::{Entry, decoded, stamp_of};
pub use signals::read_signals;
pub(crate) use stream::encoded_image;
pub use stream::{EncodedImage, FrameStream, RawFrame};
pub use timeline::{Timeline, TimelineFrame};
