//! ROS 2 bags: a log is one already, so the folder is a copy of it with the `metadata.yaml` that `ros2 bag` asks for.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use schemas::topics;

use super::{ExportError, ExportOptions, ExportReport, Format};
use crate::log::{Event, Log, scan};
use crate::{OutputError, OutputFolder};

/// What rosbag2 writes since ROS 2 Jazzy.
const METADATA_VERSION: u32 = 9;

pub(super) fn write(log: &Log, folder: &OutputFolder, options: &ExportOptions) -> Result<ExportReport, ExportError> {
    if options.frames.is_some() || options.layers.is_some() || options.depth_units_per_metre.is_some() {
        let what = "a bag is the whole log, untouched: cut it first with `pslam slice` or `pslam filter`";
        return Err(ExportError::Refused(what.to_owned()));
    }
    let stem = log.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = format!("{stem}_0.mcap");
    let copy = folder.path(&name);
    std::fs::copy(log.path(), &copy).map_err(|source| OutputError::Io { path: copy.clone(), source })?;
    // The copy is read, not the log: what is counted is what is there.
    let (mut counts, mut first, mut last) = (BTreeMap::new(), i64::MAX, i64::MIN);
    let passed = scan(&copy, &mut |event| {
        match event {
            Event::Channel(channel) => {
                counts.entry(channel.topic.clone()).or_insert((channel.clone(), 0_u64));
            }
            Event::Message(message) => {
                (first, last) = (first.min(message.log_time.0), last.max(message.log_time.0));
                if let Some((_, count)) = counts.get_mut(&message.channel.topic) {
                    *count += 1;
                }
            }
            Event::Damage(error) => return Err(error),
            _ => {}
        }
        Ok(())
    })?;
    if passed.blake3 != log.blake3() {
        let what = format!("the copy of {} differs from it: was it changed meanwhile?", log.path().display());
        return Err(ExportError::Refused(what));
    }
    let span = if first > last { (0, 0) } else { (first, last - first) };
    let topics: Vec<Topic<'_>> =
        counts.iter().map(|(name, (channel, count))| (name.as_str(), channel.schema_name.as_str(), *count)).collect();
    folder.write("metadata.yaml", metadata(&name, span, &topics).as_bytes())?;
    Ok(report(log, &counts.iter().map(|(topic, (_, count))| (topic.as_str(), *count as usize)).collect()))
}

/// Name, type, messages.
type Topic<'a> = (&'a str, &'a str, u64);

/// The YAML file; `span` is start and duration, nanoseconds.
fn metadata(file: &str, (start, duration): (i64, i64), topics: &[Topic<'_>]) -> String {
    let messages: u64 = topics.iter().map(|(.., count)| count).sum();
    let file = quoted(file);
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: {METADATA_VERSION}\n  storage_identifier: mcap\n  duration:\n    \
         nanoseconds: {duration}\n  starting_time:\n    nanoseconds_since_epoch: {start}\n  message_count: {messages}\n  \
         topics_with_message_count:\n"
    );
    for (name, schema, count) in topics {
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "    - topic_metadata:\n        name: {}\n        type: {}\n        serialization_format: cdr\n        \
             offered_qos_profiles: []\n        type_description_hash: \"\"\n      message_count: {count}\n",
            quoted(name),
            quoted(schema),
        );
    }
    let _ = write!(
        text,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {file}\n  files:\n    \
         - path: {file}\n      starting_time:\n        nanoseconds_since_epoch: {start}\n      duration:\n        \
         nanoseconds: {duration}\n      message_count: {messages}\n  custom_data: ~\n  ros_distro: unknown\n"
    );
    text
}

/// A YAML string; JSON's are such.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

fn report(log: &Log, counts: &BTreeMap<&str, usize>) -> ExportReport {
    let count = |topic: &str| counts.get(topic).copied().unwrap_or(0);
    let masks = |layer: &&str| ((*layer).to_owned(), count(&topics::LayerTopics::new(layer).class));
    let colors = log.colors();
    let stamps = || colors.iter().map(|entry| entry.stamp);
    ExportReport {
        pictures: colors.len(),
        right_pictures: count(topics::RIGHT),
        depth_images: count(topics::DEPTH) + count(topics::DEPTH_NATIVE),
        depth_units_per_metre: log
            .depth_units_per_metre()
            .ok()
            .filter(|_| log.has_messages(topics::DEPTH) || log.has_messages(topics::DEPTH_NATIVE)),
        pairing_tolerance_ns: log.pairing_tolerance_ns().unwrap_or_default(),
        ground_truth_poses: count(topics::GROUND_TRUTH),
        imu_rows: count(topics::IMU),
        masks: log.layers().iter().map(masks).collect(),
        span_ns: stamps().min().zip(stamps().max()),
        notes: vec![
            "the log itself, byte by byte; `ros2 bag play` skips message types that are not installed".to_owned(),
        ],
        ..ExportReport::new(log, Format::Rosbag2)
    }
}
