//! How good is a trajectory? Absolute and relative pose errors as `evo_ape` and `evo_rpe` 1.38.1 define them, so that
//! numbers can be compared with those of papers.
//!
//! ```
//! use replayer::eval::{EvalOptions, Trajectory, evaluate};
//! let truth = "0.0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0 1\n0.2 1 1 0 0 0 0 1\n0.3 1 1 1 0 0 0 1\n";
//! let truth = Trajectory::parse_tum(truth.as_bytes(), "truth")?;
//! let result = evaluate(&truth, &truth, None, &EvalOptions::default())?;
//! assert!(result.ate_m.rmse < 1e-12);
//! # Ok::<(), replayer::eval::EvalError>(())
//! ```

mod associate;
mod error;
mod evaluate;
mod relative;
mod statistics;
mod table;
mod trajectory;

pub use associate::associate;
pub use error::EvalError;
pub use evaluate::{Alignment, AxisError, Coverage, ErrorSample, EvalOptions, Evaluation, evaluate};
pub use relative::{DeltaUnit, RpeOptions, RpeResult};
pub use statistics::Statistics;
pub use table::Comparison;
pub use trajectory::{StampedPose, Trajectory};
