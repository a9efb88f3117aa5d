//! What may go wrong, by name.

use std::fmt;
use std::str::FromStr;

/// A fault of a simulated system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// Frames are never sent; their numbers are skipped.
    Drop,
    /// All subjects are hidden for a while, again and again.
    Occlude,
    /// The last subject appears a second after the start.
    LateSubject,
    /// The network takes longer for a frame than a frame lasts.
    SlowLink,
    /// A second after each connect the server falls silent, the connection stands.
    HalfOpen,
    /// A second after each connect come bytes that are no packet.
    Garbage,
    /// A second after each connect the server hangs up.
    Reconnect,
    /// The network cuts the stream into small pieces.
    Split,
    /// The network holds frames back and delivers several at once.
    Glue,
    /// A second after each connect comes an object that is too short for its type.
    Truncate,
    /// A second after each connect comes a packet that claims four gigabytes.
    Oversize,
    /// The world has y up.
    YUp,
    /// Objects that do not change are sent once and listed as unchanged then.
    StaticOnce,
}

impl Fault {
    /// Each with its name.
    pub const ALL: [(&'static str, Self); 13] = [
        ("drop", Self::Drop),
        ("occlude", Self::Occlude),
        ("late-subject", Self::LateSubject),
        ("slow-link", Self::SlowLink),
        ("half-open", Self::HalfOpen),
        ("garbage", Self::Garbage),
        ("reconnect", Self::Reconnect),
        ("split", Self::Split),
        ("glue", Self::Glue),
        ("truncate", Self::Truncate),
        ("oversize", Self::Oversize),
        ("y-up", Self::YUp),
        ("static-once", Self::StaticOnce),
    ];

    /// Whether the fault strikes once a connection, after a second.
    pub(crate) fn ends_connection(self) -> bool {
        matches!(self, Self::HalfOpen | Self::Garbage | Self::Reconnect | Self::Truncate | Self::Oversize)
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::ALL.iter().find(|(_, fault)| fault == self).map_or("?", |(name, _)| name);
        f.write_str(name)
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(name, _)| *name == text).map(|(_, fault)| *fault);
        let known = || Self::ALL.map(|(name, _)| name).join(", ");
        found.ok_or_else(|| format!("there is no fault `{text}`; choose {}", known()))
    }
}
