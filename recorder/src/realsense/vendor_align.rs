//! librealsense's own registration of depth to colour: what ours is compared with.

use super::context::CameraError;
use super::frame;
use super::library::Library;
use super::raw::{self, Api, FrameSink, Handle, required};
use super::software::{SoftwareCamera, SoftwareSpec};
use super::types::{Frame, Sample, StreamKind, TimestampDomain};
use crate::Arrival;
use std::sync::{Arc, Mutex, PoisonError};

/// Longest time that the library's blocks may take, milliseconds.
const PATIENCE_MS: u32 = 10_000;
/// Pairs that are fed: librealsense pairs frames from the second on.
const PAIRS: u64 = 3;

/// Registers a depth picture to the colour camera of `spec` with `rs2_create_align`. Returns rows of the colour camera's
/// size. Frame numbers and stamps of the two pictures do not matter.
///
/// # Errors
/// The library refuses, or its blocks give no result within ten seconds.
pub fn vendor_align(
    library: &Library,
    spec: &SoftwareSpec,
    depth: &Frame,
    color: &Frame,
) -> Result<Vec<u16>, CameraError> {
    let api = library.api;
    let software = SoftwareCamera::new(library, spec)?;
    let sync = Stage::new(api, required(api.create_sync_processing_block()?, "create_sync_processing_block")?)?;
    let align = Stage::new(api, required(api.create_align(StreamKind::Color.raw())?, "create_align")?)?;
    let got: Arc<Mutex<Vec<Handle<raw::Frame>>>> = Arc::default();
    let sink: FrameSink = {
        let got = Arc::clone(&got);
        Arc::new(move |frame, _| got.lock().unwrap_or_else(PoisonError::into_inner).push(frame))
    };
    let flows = software.start_raw(&[StreamKind::Depth, StreamKind::Color], &sink)?;
    for number in 1..=PAIRS {
        for picture in [depth, color] {
            let mut picture = picture.clone();
            picture.header.number = number;
            picture.header.timestamp_ms = 1000.0 * number as f64;
            picture.header.domain = TimestampDomain::HardwareClock;
            software.feed(&Sample::Frame(picture))?;
        }
        for frame in got.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            api.process_frame(&sync.block, frame)?;
        }
    }
    let pair = loop {
        let frames = sync.next(api)?;
        if api.embedded_frames_count(&frames)? == 2 {
            break frames;
        }
    };
    api.process_frame(&align.block, pair)?;
    let aligned = align.next(api)?;
    drop(flows);
    for index in 0..api.embedded_frames_count(&aligned)? {
        let part = required(api.extract_frame(&aligned, index)?, "extract_frame")?;
        if let Sample::Frame(part) = frame::sample(part, 0, Arrival::default())
            && part.header.stream.kind == StreamKind::Depth
        {
            return Ok(part.bytes.chunks_exact(2).map(|two| u16::from_le_bytes([two[0], two[1]])).collect());
        }
    }
    Err(CameraError::NoCamera)
}

/// A processing block with a queue behind it.
struct Stage {
    block: Handle<raw::Block>,
    queue: Handle<raw::Queue>,
}

impl Stage {
    fn new(api: &'static Api, block: Handle<raw::Block>) -> Result<Self, CameraError> {
        let queue = required(api.create_frame_queue(16)?, "create_frame_queue")?;
        api.start_processing_queue(&block, &queue)?;
        Ok(Self { block, queue })
    }

    fn next(&self, api: &'static Api) -> Result<Handle<raw::Frame>, CameraError> {
        Ok(required(api.wait_for_frame(&self.queue, PATIENCE_MS)?, "wait_for_frame")?)
    }
}
