//! Everything that reads a log: reader and timeline ([`log`]), the deterministic replay with its proofs ([`run`]),
//! evaluation against ground truth ([`eval`]), of labels against others ([`masks`]), plots ([`plot`]), pages about runs
//! ([`report`](mod@report)), other programs' folders ([`export`]), and folders to publish ([`card`]).

pub mod card;
pub mod eval;
pub mod export;
#[cfg(feature = "rerun")]
pub mod inspect;
pub mod log;
pub mod masks;
mod output;
pub mod plot;
pub mod report;
pub mod robust;
pub mod run;
pub mod stopwatch;
mod truth;
mod vocabulary;

pub use output::{OutputError, OutputFolder, write_file};
pub use truth::{TruthError, read_truth};
pub use vocabulary::VocabularyFileError;
