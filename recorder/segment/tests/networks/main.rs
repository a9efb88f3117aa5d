//! Descriptions, composition and judges on models small enough to work out by hand; with the features `rten` and `ort` the
//! models are really run.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[cfg(feature = "rten")]
mod onnx;
mod quality;
#[cfg(feature = "rten")]
mod run;
