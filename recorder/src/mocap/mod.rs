//! Motion capture systems as sources of frames.
//!
//! [`MocapSource`] is what every system offers: connect, then the next frame. [`Link`] keeps a source alive: it connects
//! again with growing pauses and tells what happened, so that a recorder can write it down. [`messages`] turns a frame
//! into what stands in a log.

mod buffer;
mod convert;
mod error;
mod frame;
mod link;
mod messages;
pub mod sim;
mod survey;
mod tcp;
pub mod udp;
pub mod vicon;
pub mod vrpn;
pub mod wire;

pub use error::MocapError;
pub use frame::{LatencySample, MocapBody, MocapFrame, MocapMarker};
pub use link::{Backoff, Link, LinkEvent};
pub use messages::{MocapMessages, messages};
pub use survey::{Survey, SurveyBody, survey};

use std::time::Duration;

/// A motion capture system.
pub trait MocapSource: Send {
    /// Kind and address for people, as `vicon 10.0.0.2:801`.
    fn describe(&self) -> String;

    /// Connects; again, if it was connected. Takes no longer than the source's own timeout.
    ///
    /// # Errors
    /// Nobody answers, or somebody with another protocol.
    fn connect(&mut self) -> Result<(), MocapError>;

    /// Waits for the next frame, at most `timeout`; `None` if there was none, which is no error.
    ///
    /// # Errors
    /// The connection is lost, or what came is not the protocol. Then [`MocapSource::connect`] starts anew.
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<MocapFrame>, MocapError>;
}
