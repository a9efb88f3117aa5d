//! Logs to logs: nothing but what was asked for changes, and nothing damaged goes in.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod core;
mod merge;
mod redact;
mod slice;
mod support;
