//! What goes wrong with a motion capture system.

use std::io;
use std::time::Duration;

/// Why there is no frame.
#[derive(Debug, thiserror::Error)]
pub enum MocapError {
    /// The network refuses.
    #[error("{address}: {source}")]
    Io {
        /// Whom we talk to.
        address: String,
        /// The system's answer.
        source: io::Error,
    },
    /// Nobody listens.
    #[error(
        "{address}: nobody listens there; is the system running and streaming? Vicon DataStream has port 801, VRPN 3883"
    )]
    Refused {
        /// Whom we tried.
        address: String,
    },
    /// The name or number is no address.
    #[error("`{0}` is no address: give HOST or HOST:PORT, ports up to 65535")]
    Address(String),
    /// The connection stands but nobody speaks.
    #[error("{address}: connected, but silent for {} ms: is that a motion capture server?", waited.as_millis())]
    Silent {
        /// Whom we talk to.
        address: String,
        /// How long we waited.
        waited: Duration,
    },
    /// The other side ended the connection.
    #[error("{address}: the server closed the connection")]
    Closed {
        /// Whom we talk to.
        address: String,
    },
    /// Another protocol than expected, recognised.
    #[error("{address}: {what}")]
    WrongServer {
        /// Whom we talk to.
        address: String,
        /// What it is, and what to do.
        what: String,
    },
    /// The bytes are not the protocol.
    #[error("{address}: byte {offset} since connecting: {what}")]
    Protocol {
        /// Whom we talk to.
        address: String,
        /// Where in the stream (or datagram) the wrong part begins.
        offset: u64,
        /// What is wrong.
        what: String,
    },
    /// [`next_frame`](super::MocapSource::next_frame) before [`connect`](super::MocapSource::connect).
    #[error("{address}: not connected")]
    NotConnected {
        /// Whom we would talk to.
        address: String,
    },
}
