//! Who runs a network.

#[cfg(feature = "ort")]
mod onnx_runtime;
#[cfg(feature = "rten")]
mod pure_rust;

use crate::description::Model;
use crate::{SegmentError, Tensor};
use std::path::PathBuf;
use std::sync::Arc;

/// A loaded network. One call at a time; parallel callers load one each.
pub trait Engine: Send {
    /// The outputs in the order of the description's kind.
    ///
    /// # Errors
    /// The runtime's complaint, in words.
    fn run(&mut self, input: Tensor) -> Result<Vec<Tensor>, String>;
}

/// A runtime, ready to load networks.
#[derive(Clone)]
pub struct Runtime {
    info: RuntimeInfo,
    loader: Arc<dyn Loader>,
}

trait Loader: Send + Sync {
    fn load(&self, model: &Model) -> Result<Box<dyn Engine>, String>;
}

/// What a runtime says about itself, for the log's record.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct RuntimeInfo {
    /// `rten` or `onnxruntime`.
    pub name: String,
    /// Its version.
    pub version: String,
    /// The library's file, if it is one.
    pub library: Option<PathBuf>,
}

/// What this program was built without.
#[cfg(not(all(feature = "rten", feature = "ort")))]
fn missing(runtime: &str, feature: &str) -> SegmentError {
    SegmentError::Runtime(format!(
        "this program was built without {runtime}: build it with `--features networks` ({feature} is part of it), or give \
         ready masks"
    ))
}

impl Runtime {
    /// The pure-Rust runtime.
    ///
    /// # Errors
    /// The program was built without it.
    pub fn rten() -> Result<Self, SegmentError> {
        #[cfg(feature = "rten")]
        return Ok(Self { info: pure_rust::info(), loader: Arc::new(pure_rust::PureRust) });
        #[cfg(not(feature = "rten"))]
        Err(missing("rten", "rten"))
    }

    /// ONNX Runtime from one of these files, the first that exists. Once a process: clone it.
    ///
    /// # Errors
    /// The program was built without it, none exists, or the first that does cannot be used.
    pub fn onnx_runtime(candidates: &[PathBuf]) -> Result<Self, SegmentError> {
        #[cfg(feature = "ort")]
        {
            let (info, library) = onnx_runtime::open(candidates)?;
            Ok(Self { info, loader: Arc::new(library) })
        }
        #[cfg(not(feature = "ort"))]
        {
            let _ = candidates;
            Err(missing("ONNX Runtime", "ort"))
        }
    }

    /// Its name and version.
    #[must_use]
    pub fn info(&self) -> &RuntimeInfo {
        &self.info
    }

    /// Loads a network; it will use one thread.
    ///
    /// # Errors
    /// A model that it cannot run, or without the described tensors.
    pub fn load(&self, model: &Model) -> Result<Box<dyn Engine>, SegmentError> {
        self.loader.load(model).map_err(|reason| SegmentError::Model { model: model.file.clone(), reason })
    }
}
