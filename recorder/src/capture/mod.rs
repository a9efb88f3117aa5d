//! Live recording: sensors to a log that loses nothing silently.
//!
//! ```text
//! source threads ── Inlet: count, stamp ──▶ lane colour ─▶ encoder ─┐
//!                                      ├──▶ lane depth ──▶ encoder ─┼─▶ outbox ─▶ one writer ─▶ LogWriter ─▶ syncer
//!                                      └──▶ lane small ──▶ encoder ─┘
//! ```
//!
//! Who labels pictures meanwhile ([`Labelling`]) takes the newest one when there is time; what becomes of each stands in the log.
//!
//! All queues are bounded. When the disk cannot keep up, the writer holds up the encoders, they their lanes, and a full lane
//! holds up its source for [`Limits::patience`]; then whole measurements are given up, oldest first, each with a record in
//! the log. What never reached this program is seen by the streams' counters and recorded as well. [`record()`] runs it all
//! and gives a [`Verdict`].

mod clock;
mod disk;
mod effort;
mod encode;
mod engine;
mod inlet;
mod labelling;
mod lane;
mod latency;
mod ledger;
mod onlooker;
mod outbox;
mod pace;
mod setup;
mod source;
mod stamps;
mod status;
mod stream;

pub use clock::{ClockHealth, HostClock, HostTimeline, SystemClock, synchronisation};
pub use disk::{folder_of, room_bytes};
pub use effort::Encoding;
pub use engine::{RecordError, RecordOptions, record};
pub use inlet::{Allowed, EndedBy, Happening, Inlet, Limits, MocapCounts};
pub use labelling::{LabelCounts, Labelling, MakeSegmenter};
pub use latency::Latency;
pub use ledger::{Cause, Counts};
pub use onlooker::Onlooker;
pub use pace::Pace;
pub use setup::CameraSetup;
pub use source::{CameraSource, End, MotionCapture, Open, Source};
pub use stamps::{CameraClock, DeviceTime};
pub use status::{Status, StreamCounts, StreamStatus, Verdict};
pub use stream::Stream;
