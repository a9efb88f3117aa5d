//! How a command ends: exit codes and error messages.

use recorder::WriteError;
use recorder::capture::RecordError;
use recorder::edit::EditError;
use recorder::recover::RecoverError;
use replayer::OutputError;
use replayer::VocabularyFileError;
use replayer::card::CardError;
use replayer::eval::EvalError;
use replayer::export::ExportError;
use replayer::run::RunError;
use slam::{ConfigError, SlamError};
use slam_vision::VisionError;
use std::error::Error;
use std::fmt;
use std::process::ExitCode;

/// How a command ended that did what it was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing to object to.
    Good,
    /// The answer is no: a check failed, runs differ, data is lost.
    Bad,
}

impl Outcome {
    /// Good if `good`.
    #[must_use]
    pub fn from_good(good: bool) -> Self {
        if good { Self::Good } else { Self::Bad }
    }
}

/// A request that makes no sense, though the option parser took it.
#[derive(Debug)]
pub struct Usage(pub String);

impl fmt::Display for Usage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Error for Usage {}

/// Prints an error to standard error and gives the exit code, see `pslam --help`.
pub fn code(result: anyhow::Result<Outcome>) -> ExitCode {
    match result {
        Ok(Outcome::Good) => ExitCode::SUCCESS,
        Ok(Outcome::Bad) => ExitCode::from(1),
        Err(error) => {
            eprintln!("{}", message(&error));
            let usage = error.chain().any(is_usage);
            ExitCode::from(if usage { 2 } else { 3 })
        }
    }
}

/// The chain of causes, a line each; a cause whose text its parent repeats is left out.
fn message(error: &anyhow::Error) -> String {
    let mut text = format!("error: {error}");
    for cause in error.chain().skip(1) {
        let cause_text = cause.to_string();
        if !text.contains(&cause_text) {
            text.push_str(&format!("\n  because: {cause_text}"));
        }
    }
    if error.chain().any(is_in_the_way) && !text.contains("--force") {
        text.push_str("\n  --force overwrites it");
    }
    text
}

fn is_usage(cause: &(dyn Error + 'static)) -> bool {
    cause.is::<Usage>()
        || cause.is::<ConfigError>()
        || is_in_the_way(cause)
        || matches!(cause.downcast_ref(), Some(EvalError::Option(_)))
        || matches!(cause.downcast_ref(), Some(RecoverError::SameFile(_)))
        || matches!(cause.downcast_ref(), Some(ExportError::Refused(_)))
        || matches!(cause.downcast_ref(), Some(CardError::Refused(_)))
        || matches!(cause.downcast_ref(), Some(RecordError::Refused(_)))
        || matches!(cause.downcast_ref(), Some(EditError::SameFile(_) | EditError::Refused(_)))
        || cause.downcast_ref().is_some_and(is_run_usage)
}

/// Replays that were asked for with the wrong words.
fn is_run_usage(error: &RunError) -> bool {
    match error {
        RunError::Range { .. } | RunError::NoInspection => true,
        RunError::SaveFrame { .. } | RunError::OtherState { .. } => true,
        RunError::Vocabulary(error) => matches!(error, VocabularyFileError::Digest { .. }),
        // Transparent errors are not links of the chain of their own.
        RunError::Config(_) | RunError::Slam(SlamError::Vision(VisionError::Config { .. })) => true,
        RunError::Output(error) => !matches!(error, OutputError::Io { .. }),
        _ => false,
    }
}

/// Something stands where the output should go.
fn is_in_the_way(cause: &(dyn Error + 'static)) -> bool {
    let exists = |error: &WriteError| matches!(error, WriteError::Exists(_) | WriteError::Unfinished(_));
    let stands = |error: &OutputError| !matches!(error, OutputError::Io { .. });
    cause.downcast_ref().is_some_and(exists)
        || cause.downcast_ref().is_some_and(stands)
        // Transparent errors are not links of the chain of their own.
        || matches!(cause.downcast_ref(), Some(ExportError::Output(error)) if stands(error))
        || matches!(cause.downcast_ref(), Some(CardError::Output(error)) if stands(error))
        || matches!(cause.downcast_ref(), Some(RecordError::Log(error)) if exists(error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn causes_are_told_once() {
        let inner = std::io::Error::other("disk on fire");
        let error = Err::<(), _>(inner).context("a.mcap: disk on fire").context("cannot read the log").unwrap_err();
        assert_eq!(message(&error), "error: cannot read the log\n  because: a.mcap: disk on fire");
    }

    #[test]
    fn what_is_in_the_way_names_the_option() {
        let error = anyhow::Error::from(WriteError::Exists("x.mcap".into())).context("import");
        assert!(message(&error).ends_with("--force overwrites it"), "{}", message(&error));
        assert!(error.chain().any(is_usage));
    }
}
