//! What a log tells about clocks and frames, without its pictures.

use std::path::Path;

use schemas::metadata;
use schemas::sync::{Signals, SyncRecord};

use super::LogError;
use super::container::{Event, scan};

/// Reads the signals of a whole log in one pass, and its last sync record if it has one.
///
/// # Errors
/// No log, damage anywhere in the container, or a message that is not what its topic says.
pub fn read_signals(path: &Path) -> Result<(Signals, Option<SyncRecord>), LogError> {
    let (mut signals, mut record) = (Signals::default(), None);
    scan(path, &mut |event| {
        match event {
            Event::Message(message) => {
                let taken = signals.take(&message.channel.topic, message.data);
                taken.map_err(|error| message.error(path, error.to_string()))?;
            }
            Event::Metadata { name, values } if name == metadata::SYNC => {
                record = Some(SyncRecord::from_metadata(&values).map_err(|reason| LogError::missing(path, reason))?);
            }
            Event::Damage(error) => return Err(error),
            _ => {}
        }
        Ok(())
    })?;
    Ok((signals, record))
}
