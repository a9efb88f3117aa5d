//! Simulated motion capture systems: a [`Script`] says what every frame shows, a server speaks one of the protocols.
//!
//! What a frame shows is a pure function of its number; only when it is sent depends on the clock.

mod fault;
mod line;
mod path;
mod script;
mod server;

pub use fault::Fault;
pub(crate) use line::LineFaults;
pub use path::Path;
pub use script::{Script, ScriptError, SimBody, SimFrame, SimSubject};
pub use server::{Protocol, SimError, SimServer};
pub(crate) use server::{Stage, TICK, accept, spawn_client};
