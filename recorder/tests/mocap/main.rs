//! Motion capture: bytes against hand-made ones, hostile bytes, and our clients against our simulated systems.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod carry_over;
mod faults;
mod golden;
mod hostile;
mod loopback;
mod support;
