//! Whole-system tests; a module a concern.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod annotate;
mod cli;
mod dark;
mod data;
mod determinism;
mod edit;
mod json;
mod kidnapped;
mod layers;
mod record;
mod record_faults;
mod record_share;
mod repo_lint;
mod report;
mod rooms;
mod share;
mod sim;
mod state;
mod suite;
mod support;
mod vocabulary;
