//! One source through one edit.

use super::EditError;
use super::output::{Check, EditOptions, Output};
use super::source::{Channel, Item, RawMessage, Source};
use super::summary::EditSummary;
use mcap::Attachment;
use std::collections::BTreeMap;
use std::path::Path;

/// What is done to a log: each method gets what the source holds, in file order, and says what goes into the result. As they
/// are, everything goes over as it stands.
pub trait Edit {
    /// Under which topic a channel goes over; none drops it with all its messages.
    ///
    /// # Errors
    /// A channel that the edit refuses.
    fn topic(&mut self, channel: &Channel) -> Result<Option<String>, EditError> {
        Ok(Some(channel.topic.clone()))
    }

    /// A message: [`Output::keep`], [`Output::replace`], or neither to drop it; [`Output::insert`] any number of others.
    ///
    /// # Errors
    /// A message that the edit refuses, or the file system.
    fn message(&mut self, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
        out.keep(message)
    }

    /// A metadata record.
    ///
    /// # Errors
    /// A record that the edit refuses, or the file system.
    fn metadata(&mut self, name: &str, values: BTreeMap<String, String>, out: &mut Output) -> Result<(), EditError> {
        out.keep_metadata(name, values)
    }

    /// An attached file.
    ///
    /// # Errors
    /// A file that the edit refuses, or the file system.
    fn attachment(&mut self, attachment: &Attachment<'_>, out: &mut Output) -> Result<(), EditError> {
        out.keep_attachment(attachment)
    }

    /// After the last of them.
    ///
    /// # Errors
    /// The whole that the edit refuses, or the file system.
    fn finish(&mut self, _out: &mut Output) -> Result<(), EditError> {
        Ok(())
    }
}

/// Writes the log `source` to `out` as `edit` says. `progress` gets bytes read and bytes in all.
///
/// # Errors
/// A damaged source, an existing result, what the edit refuses, or the file system refuses; nothing is left behind.
pub fn rewrite(
    source: &Path,
    out: &Path,
    options: &EditOptions,
    edit: &mut dyn Edit,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<EditSummary, EditError> {
    rewrite_checked(source, out, options, edit, progress, &mut |_| Ok(()))
}

/// As [`rewrite`]; `check` looks at the new log before it gets its name.
pub(super) fn rewrite_checked(
    source: &Path,
    out: &Path,
    options: &EditOptions,
    edit: &mut dyn Edit,
    progress: &mut dyn FnMut(u64, u64),
    check: Check<'_>,
) -> Result<EditSummary, EditError> {
    let mut source = Source::open(source)?;
    let mut output = Output::create(out, &[source.path()], options)?;
    match pass(&mut source, &mut output, edit, progress) {
        Ok(()) => output.finish(&[source], check),
        Err(error) => {
            output.discard();
            Err(error)
        }
    }
}

fn pass(
    source: &mut Source,
    out: &mut Output,
    edit: &mut dyn Edit,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(), EditError> {
    let (mut told, all) = (0, source.file_bytes());
    loop {
        if source.offset() != told {
            told = source.offset();
            progress(told, all);
        }
        match source.next()? {
            None => return edit.finish(out),
            Some(Item::Channel(channel)) => {
                let topic = edit.topic(&channel)?;
                out.open(0, &channel, topic)?;
            }
            Some(Item::Message(message)) => {
                if out.begin(0, &message) {
                    edit.message(&message, out)?;
                    out.end(&message);
                }
            }
            Some(Item::Metadata { name, values }) => edit.metadata(&name, values, out)?,
            Some(Item::Attachment(attachment)) => edit.attachment(&attachment, out)?,
        }
    }
}
