//! From a picture to panoptic labels.
//!
//! A [`Segmenter`] takes a picture and gives a [`Mask`]. [`Network`] is one: models that stand in files, each described by a
//! TOML beside it ([`description::Model`]), run by a [`Runtime`], composed by one rule ([`compose`]). What is computed here is
//! the same on any machine and for any number of threads; what a runtime computes is so on one kind of CPU (see
//! `docs/segmentation.md`), which is why labels are recorded and a replay never runs a network.
//!
//! The features `rten` (pure Rust) and `ort` (ONNX Runtime, found at run time) bring the runtimes; without them everything
//! but running a network is here.

pub mod compose;
pub mod description;
mod grid;
mod instances;
mod mask;
mod network;
mod preprocess;
pub mod quality;
mod queries;
mod runtime;
mod semantic;
mod tensor;

pub use instances::Instance;
pub use mask::{Mask, Picture};
pub use network::{Network, NetworkSpec};
pub use preprocess::Placement;
pub use runtime::{Engine, Runtime, RuntimeInfo};
pub use tensor::Tensor;

use schemas::msg::Category;
use std::io;
use std::path::PathBuf;

/// Whoever labels pictures.
pub trait Segmenter: Send {
    /// Labels one picture; none if there are no labels for it.
    ///
    /// # Errors
    /// A picture that it cannot take, or the runtime's complaint.
    fn segment(&mut self, picture: &Picture) -> Result<Option<Mask>, SegmentError>;

    /// All categories that its masks may hold, ids ascending, each once.
    fn categories(&self) -> &[Category];
}

/// Why there are no labels.
#[derive(Debug, thiserror::Error)]
pub enum SegmentError {
    /// A file that cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The file system's answer.
        source: io::Error,
    },
    /// A description that says nothing usable.
    #[error("{}: {reason}", path.display())]
    Description {
        /// The TOML file.
        path: PathBuf,
        /// What is wrong, and what is wanted.
        reason: String,
    },
    /// A runtime that is not there.
    #[error("{0}")]
    Runtime(String),
    /// A model that the runtime refuses or that gives something else than its description says.
    #[error("{}: {reason}", model.display())]
    Model {
        /// The model.
        model: PathBuf,
        /// What is wrong, with the shapes.
        reason: String,
    },
    /// A picture that cannot be labelled.
    #[error("{0}")]
    Picture(String),
}
