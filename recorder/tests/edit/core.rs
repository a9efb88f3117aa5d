//! The core that all edits share.

use crate::support::{Content, write_log};
use recorder::edit::{Edit, EditError, EditOptions, EditSummary, Filter, Level, Output, RawMessage, compress, rewrite};
use recorder::recover::recover;
use schemas::msg::{Header, LogEntry, PoseStamped};
use schemas::{Stamp, metadata, topics};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

struct Same;
impl Edit for Same {}

fn edited(source: &Path, out: &Path, edit: &mut dyn Edit) -> Result<EditSummary, EditError> {
    rewrite(source, out, &EditOptions::new("test", BTreeMap::new()), edit, &mut |_, _| {})
}

#[test]
fn what_is_not_touched_goes_over_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c, d] = ["a", "b", "c", "d"].map(|name| folder.path().join(name));
    write_log(&a);
    let summary = edited(&a, &b, &mut Same).unwrap();
    assert_eq!(Content::read(&a), Content::read(&b).without_provenance());
    assert_eq!(summary.messages.kept as usize, Content::read(&a).messages.len());
    assert_eq!(summary.sources[0].blake3, blake3::hash(&fs::read(&a).unwrap()).to_hex().to_string());
    // The same bytes again, and a second edit tells of both.
    edited(&a, &c, &mut Same).unwrap();
    assert_eq!(fs::read(&b).unwrap(), fs::read(&c).unwrap());
    edited(&b, &d, &mut Same).unwrap();
    let content = Content::read(&d);
    let first = content.record("pslam/provenance/1").unwrap();
    let second = content.record("pslam/provenance/2").unwrap();
    assert_eq!(first["source/0/blake3"], summary.sources[0].blake3);
    assert_eq!(second["source/0/blake3"], blake3::hash(&fs::read(&b).unwrap()).to_hex().to_string());
    assert_eq!(metadata::verify("pslam/provenance/2", second), Some(true));
    assert!(second["messages"].starts_with("kept "), "{second:?}");
    // The strictest reader: every checksum, every count, every channel's second copy.
    let report = recover(&d, &folder.path().join("e"), false).unwrap();
    assert!(!report.lossy, "{report:?}");
}

/// Drops every second picture, changes ground truth, adds an event to each picture.
struct Busy;
impl Edit for Busy {
    fn message(&mut self, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
        match message.topic() {
            topics::COLOR if message.sequence % 2 == 1 => return Ok(()),
            topics::GROUND_TRUTH => {
                let pose: PoseStamped = message.decode().map_err(|why| EditError::message(message, why))?;
                let moved = PoseStamped { header: Header { frame_id: "moved".to_owned(), ..pose.header }, ..pose };
                return out.replace(message, &schemas::Message::encode(&moved));
            }
            topics::COLOR => {
                let entry = LogEntry { name: "seen".to_owned(), ..LogEntry::default() };
                out.insert(topics::EVENTS, message.log_time, message.publish_time, &entry)?;
            }
            _ => {}
        }
        out.keep(message)
    }
}

#[test]
fn messages_are_kept_changed_dropped_and_added() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a", "b", "c"].map(|name| folder.path().join(name));
    write_log(&a);
    let summary = edited(&a, &b, &mut Busy).unwrap();
    let content = Content::read(&b);
    assert_eq!(content.on(topics::COLOR).count(), 6);
    assert_eq!(content.on(topics::EVENTS).count(), 6);
    assert_eq!((summary.topics[topics::COLOR].kept, summary.topics[topics::COLOR].dropped), (6, 6));
    assert_eq!(summary.topics[topics::EVENTS].added, 6);
    assert_eq!(summary.topics[topics::GROUND_TRUTH].changed as usize, content.on(topics::GROUND_TRUTH).count());
    let record = content.record("pslam/provenance/1").unwrap();
    assert_eq!(record[&format!("topic/{}", topics::COLOR)], "kept 6, changed 0, dropped 6, added 0");
    // Times are those of the source, whatever happened to the message.
    let times = |content: &Content| content.on(topics::GROUND_TRUTH).map(|m| (m.2, m.3)).collect::<Vec<_>>();
    assert_eq!(times(&content), times(&Content::read(&a)));
    // A topic that is there cannot be added to.
    let error = edited(&b, &c, &mut Busy).unwrap_err();
    assert!(matches!(&error, EditError::Refused(why) if why.contains(topics::EVENTS)), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left behind");
}

#[test]
fn damage_is_refused_with_its_place_wherever_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a", "b", "c"].map(|name| folder.path().join(name));
    write_log(&a);
    let whole = fs::read(&a).unwrap();
    for length in [0, 4, 8, 20, whole.len() / 2, whole.len() - 9, whole.len() - 1] {
        fs::write(&b, &whole[..length]).unwrap();
        let error = edited(&b, &c, &mut Same).unwrap_err();
        assert!(error.to_string().contains(b.to_str().unwrap()), "{error}");
    }
    for at in (0..whole.len()).step_by(97) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x10;
        fs::write(&b, &bytes).unwrap();
        let error = edited(&b, &c, &mut Same).expect_err("a flipped bit is seen");
        let said = error.to_string();
        assert!(at < 40 || said.contains("recover"), "byte {at}: {said}");
    }
    assert!(!c.exists() && fs::read_dir(folder.path()).unwrap().count() == 2);
}

#[test]
fn nothing_is_overwritten_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_log(&a);
    assert!(matches!(edited(&a, &a, &mut Same), Err(EditError::SameFile(_))));
    fs::write(&b, "mine").unwrap();
    assert!(matches!(edited(&a, &b, &mut Same), Err(EditError::Write(recorder::WriteError::Exists(_)))));
    assert_eq!(fs::read(&b).unwrap(), b"mine");
    let mut options = EditOptions { dry_run: true, ..EditOptions::new("test", BTreeMap::new()) };
    let dry = rewrite(&a, &b, &options, &mut Same, &mut |_, _| {}).unwrap();
    assert_eq!((dry.out.as_ref(), fs::read(&b).unwrap().as_slice()), (None, &b"mine"[..]));
    (options.dry_run, options.log.force) = (false, true);
    let wet = rewrite(&a, &b, &options, &mut Same, &mut |_, _| {}).unwrap();
    assert_eq!(wet.topics, dry.topics);
    assert!(wet.out.is_some() && wet.out_bytes == fs::metadata(&b).unwrap().len());
}

/// A recording stands in order of arrival, and other programs have channels that mean nothing to us.
#[test]
fn order_of_arrival_and_foreign_channels_stay() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    {
        let mut writer = mcap::WriteOptions::new().profile("ros2").create(fs::File::create(&a).unwrap()).unwrap();
        let schema = writer.add_schema("odd/Type", "odd", &[0xFF, 0, 0xFE]).unwrap();
        let own = BTreeMap::from([("key".to_owned(), "value".to_owned())]);
        let odd = writer.add_channel(schema, "/odd", "odd", &own).unwrap();
        let bare = writer.add_channel(0, "/bare", "json", &BTreeMap::new()).unwrap();
        for (channel_id, sequence, log_time, publish_time) in [(odd, 7, 30, 31), (bare, 9, 10, 11), (odd, 8, 20, 99)] {
            let header = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, &[1, 2, 3, sequence as u8]).unwrap();
        }
        let values = BTreeMap::from([("no".to_owned(), "checksum".to_owned())]);
        writer.write_metadata(&mcap::records::Metadata { name: "theirs".to_owned(), metadata: values }).unwrap();
        writer.finish().unwrap();
    }
    edited(&a, &b, &mut Same).unwrap();
    let (before, after) = (Content::read(&a), Content::read(&b));
    assert_eq!(before.messages.iter().map(|m| m.2).collect::<Vec<_>>(), [30, 10, 20]);
    assert_eq!(before.messages, after.messages);
    assert_eq!(before.channels, after.channels);
    assert_eq!(before.record("theirs"), after.record("theirs"));
}

#[test]
fn topics_are_filtered_with_what_describes_them() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_log(&a);
    let keeps = |topic: &str| topic.starts_with("/camera/color");
    let summary = edited(&a, &b, &mut Filter { keeps: &keeps }).unwrap();
    let content = Content::read(&b);
    assert_eq!(content.topics(), [topics::COLOR_INFO, topics::COLOR]);
    assert!(content.record("pslam/segmentation/panoptic").is_none());
    assert!(content.record("pslam/source").is_some());
    assert_eq!(summary.topics[topics::DEPTH].dropped, 12);
}

#[test]
fn packing_changes_bytes_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let a = folder.path().join("a");
    write_log(&a);
    let mut sizes = Vec::new();
    for (name, level) in [("none", Level::None), ("1", Level::Zstd(1)), ("19", Level::Zstd(19))] {
        let out = folder.path().join(name);
        let done = compress(&a, &out, level, EditOptions::new("compress", BTreeMap::new()), &mut |_, _| {}).unwrap();
        assert_eq!(done.proof.unwrap().messages, done.summary.messages.kept);
        assert_eq!(Content::read(&a), Content::read(&out).without_provenance());
        sizes.push(fs::metadata(&out).unwrap().len());
    }
    assert!(sizes[0] > 2 * sizes[1] && sizes[1] > sizes[2], "{sizes:?}");
}

#[test]
fn stamps_are_those_of_headers() {
    let folder = tempfile::tempdir().unwrap();
    let a = folder.path().join("a");
    write_log(&a);
    let mut source = recorder::edit::Source::open(&a).unwrap();
    let mut seen = 0;
    while let Some(item) = source.next().unwrap() {
        if let recorder::edit::Item::Message(message) = item {
            assert_eq!(message.stamp(), Ok(Stamp(message.log_time.0)));
            seen += 1;
        }
    }
    assert!(seen > 100);
}
