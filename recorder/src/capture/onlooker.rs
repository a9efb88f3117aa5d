//! Who looks on while a recording runs.

use super::setup::CameraSetup;
use super::stream::Stream;
use crate::mocap::MocapFrame;
use crate::realsense::Frame;
use schemas::Stamp;
use std::fmt::Debug;
use std::sync::Arc;

/// Sees what comes in, on the threads that it comes in on, before it is encoded: a preview, for example. It must return
/// at once, and takes its own losses on itself: the recording neither waits for it nor knows how it fares.
pub trait Onlooker: Debug + Send + Sync {
    /// A camera is there, for the first time or again.
    fn camera(&self, _setup: &CameraSetup) {}

    /// A picture with its stamp on the log's timeline. The pixels are shared with the recording; whoever keeps them
    /// keeps their memory.
    fn picture(&self, _stream: Stream, _stamp: Stamp, _frame: &Arc<Frame>) {}

    /// A frame of the motion capture system, with its stamp on the log's timeline.
    fn mocap(&self, _stamp: Stamp, _frame: &MocapFrame) {}
}
