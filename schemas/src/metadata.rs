//! Metadata records: small named tables of text in the file, outside the message stream.
//!
//! MCAP gives them no checksum, so each of ours carries one of its own content under [`CHECKSUM_KEY`]; `recover` keeps
//! only records whose checksum agrees.

use std::collections::BTreeMap;
use xxhash_rust::xxh3::xxh3_128;

/// Where the data came from. Keys: `kind` (`tum`, `synthetic`, ...), `name` (folder or scene), `program` (version of
/// the writer), `log_format` ([`LOG_FORMAT`]).
pub const SOURCE: &str = "pslam/source";
/// Frames and units in words, for a reader without this program. Keys: `time`, `world`, `camera`, `poses`, `depth`, `masks`.
pub const CONVENTIONS: &str = "pslam/conventions";
/// Depth. Keys: [`DEPTH_UNITS_PER_METRE`], `registered_to` (frame name).
pub const DEPTH: &str = "pslam/depth";
/// Key of [`DEPTH`] and of the depth channel's metadata: pixel value of one metre, exact decimal text (`5000`, `1000`).
pub const DEPTH_UNITS_PER_METRE: &str = "units_per_metre";
/// Colour-depth pairing. Keys: [`TOLERANCE_NS`], `rule`. All pictures are in the log, also those without a partner: a
/// reader pairs them with [`crate::pairing::associate`] and this tolerance.
pub const PAIRING: &str = "pslam/pairing";
/// Key of [`PAIRING`]: whole nanoseconds as text.
pub const TOLERANCE_NS: &str = "tolerance_ns";
/// A segmentation layer is described under this prefix and its name. Keys: `origin`, `void`, `class_encoding`;
/// of labels made while recording `live/lag_pictures` (see [`crate::topics::LABELS`]), `live/threads`, `live/rule`, and at the end
/// `pictures`, `labelled` and `live/OUTCOME`.
pub const SEGMENTATION_PREFIX: &str = "pslam/segmentation/";
/// A channel's definition, under this prefix and its topic: a second copy, outside the chunks, from which `recover` names
/// the messages of intact chunks when the chunk with the definitions is lost. Keys: the constants in [`channel`].
pub const CHANNEL_PREFIX: &str = "pslam/channel";
/// What an importer found, written at the end. Keys: `paired`, `unpaired_color`, `unpaired_depth`, `largest_gap_ns`
/// (largest distance within a pair), `camera` (origin of the calibration), and one key a kind of repair with its count.
pub const IMPORT: &str = "pslam/import";
/// Written by `recover`: what the damaged file had lost.
pub const RECOVERY: &str = "pslam/recovery";

/// What was done to a log after it was first written, under this prefix and a number from 1: one record an edit, the oldest
/// first. Keys: `operation` (`slice`, `redact`, ...), `program`, `arguments` (JSON), `source/N/blake3` and `source/N/bytes`
/// (the files it was made from, N from 0), `messages` (all counts) and `topic/NAME` (those of one topic): `kept` as they
/// were, `changed`, `dropped`, `added`. Other records tell what was true when they were written; this one what happened
/// since.
pub const PROVENANCE_PREFIX: &str = "pslam/provenance/";

/// Written by `redact`: what was taken out of the pictures. Keys: `layer`, `classes`, `margin_px`, `neighbours`, `motion_px`,
/// `bridge`, `method`, `block_px`, `doubtful` (as asked for), `frames`, `frames_redacted`, `share_mean`, `share_largest`
/// (of a picture, 0..1), `pixels_by_frame`, `doubts` (JSON), `depth`, `masks`.
pub const REDACTION: &str = "pslam/redaction";

/// How a live recording was made, written at its start. Its presence means that stamps follow the rule for recordings in
/// [`crate::topics`]. Keys: `host_anchor_ns` (the host's timeline minus `CLOCK_MONOTONIC`, nanoseconds), `started` (host
/// realtime, nanoseconds since 1970), `flush_interval_ns`, `encoding`, `clock` (whether the host says that its clock is
/// synchronised), and `option/NAME` for what was asked for.
pub const RECORDING: &str = "pslam/recording";
/// The camera, at the start and again whenever something changed. Keys: `name`, `serial`, `firmware`, `usb`, `product_id`,
/// `library`, `depth_metres_per_unit`, `profile/STREAM`, `distortion/STREAM` (the device's model and coefficients),
/// `option/SENSOR/NAME`, `attribute/NUMBER` (name of a metadata value), and `anchor_ns/CONNECTION` (log timeline minus
/// unwrapped device time).
pub const DEVICE: &str = "pslam/device";
/// How a recording ended, written last; without it the recording was interrupted. Keys: `verdict` (`complete` or
/// `incomplete`), `reason`, `ended_by`, `duration_ns`, and for each stream `STREAM/written`, `STREAM/dropped_device`,
/// `STREAM/dropped_host`; `segmentation`, in words, if pictures were labelled meanwhile.
pub const VERDICT: &str = "pslam/verdict";

/// Clocks, offset to the mocap and hand-eye transform as estimated afterwards, see [`crate::sync::SyncRecord`]; the last one
/// counts. Keys: `report` (everything, JSON), `method`, and for people `camera_body`, `offset_ns`, `drift_ppm`,
/// `marker_from_camera` (metres, then quaternion x y z w).
pub const SYNC: &str = "pslam/sync";

/// Keys of a record under [`CHANNEL_PREFIX`].
pub mod channel {
    /// Channel id in the file.
    pub const ID: &str = "id";
    /// The topic.
    pub const TOPIC: &str = "topic";
    /// Message encoding, `cdr`.
    pub const ENCODING: &str = "encoding";
    /// Schema id in the file.
    pub const SCHEMA_ID: &str = "schema_id";
    /// Schema name, `package/msg/Type`.
    pub const SCHEMA_NAME: &str = "schema_name";
    /// Schema encoding, `ros2msg`.
    pub const SCHEMA_ENCODING: &str = "schema_encoding";
    /// Schema text.
    pub const SCHEMA_TEXT: &str = "schema_text";
    /// The channel's own metadata: this and the key.
    pub const METADATA_PREFIX: &str = "metadata/";
}

/// Version of the conventions in this crate.
pub const LOG_FORMAT: &str = "1";
/// Key whose value is the record's [`checksum`].
pub const CHECKSUM_KEY: &str = "checksum_xxh3_128";

/// Hash over the name and all other keys and values, in key order, each preceded by its length (u64, little endian).
#[must_use]
pub fn checksum(name: &str, values: &BTreeMap<String, String>) -> String {
    let mut bytes = Vec::new();
    let entries = values.iter().filter(|(key, _)| *key != CHECKSUM_KEY);
    let texts = std::iter::once(name).chain(entries.flat_map(|(key, value)| [key.as_str(), value.as_str()]));
    for text in texts {
        bytes.extend_from_slice(&(text.len() as u64).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
    }
    format!("{:032x}", xxh3_128(&bytes))
}

/// Adds (or renews) the checksum.
#[must_use]
pub fn seal(name: &str, mut values: BTreeMap<String, String>) -> BTreeMap<String, String> {
    let sum = checksum(name, &values);
    values.insert(CHECKSUM_KEY.to_owned(), sum);
    values
}

/// Whether the record carries a checksum and it agrees; `None` without one (another program's record).
#[must_use]
pub fn verify(name: &str, values: &BTreeMap<String, String>) -> Option<bool> {
    values.get(CHECKSUM_KEY).map(|sum| *sum == checksum(name, values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_sees_every_change() {
        let values = BTreeMap::from([("a".to_owned(), "bc".to_owned()), ("d".to_owned(), String::new())]);
        let sealed = seal("name", values.clone());
        assert_eq!(verify("name", &sealed), Some(true));
        assert_eq!(verify("name", &values), None);
        assert_eq!(verify("other", &sealed), Some(false));
        let mut moved = sealed.clone();
        moved.remove("a");
        moved.insert("ab".to_owned(), "c".to_owned());
        assert_eq!(verify("name", &moved), Some(false));
        assert_eq!(seal("name", sealed.clone()), sealed);
    }
}
