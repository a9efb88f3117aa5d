use std::path::PathBuf;

/// Why a trajectory could not be read or judged.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// The file could not be opened or read.
    #[error("cannot read {}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A line is not `stamp tx ty tz qx qy qz qw`.
    #[error("{name}, line {line}: {reason}")]
    Line {
        /// File or source.
        name: String,
        /// Counted from 1.
        line: usize,
        /// What is wrong and what was expected.
        reason: String,
    },
    /// No pose at all.
    #[error("{name} holds no pose")]
    Empty {
        /// File or source.
        name: String,
    },
    /// No pose of the estimate has a true pose close in time.
    #[error(
        "no stamp of the estimate ({estimate} poses, {estimate_range}) is within {max_difference_s} s of a true one \
         ({truth} poses, {truth_range}): different clocks, or a larger --max-difference-ms is needed"
    )]
    NoPairs {
        /// Poses in the estimate.
        estimate: usize,
        /// Its first and last stamp, seconds.
        estimate_range: String,
        /// Poses in the truth.
        truth: usize,
        /// Its first and last stamp, seconds.
        truth_range: String,
        /// Largest allowed difference, seconds.
        max_difference_s: f64,
    },
    /// Too few or badly placed points to fit a transform.
    #[error(
        "cannot align: the {pairs} paired positions lie on a point or a line, so that the rotation is undetermined; \
         use --no-align to compare unaligned"
    )]
    Degenerate {
        /// Pairs found.
        pairs: usize,
    },
    /// An option makes no sense.
    #[error("{0}")]
    Option(String),
}
