//! Recovery of cut and bit-flipped logs: every intact chunk comes back, no wrong byte does, every loss is told.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use recorder::recover::{RecoverError, RecoverReport, recover};
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Preset};
use schemas::msg::{Category, Segment, format};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const WIDTH: u32 = 32;
const HEIGHT: u32 = 24;
const FRAMES: u32 = 40;

/// A small generator for test data (xorshift64*), seeded by the test.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }
}

/// A log with all kinds of records and a chunk every few frames.
fn write_log(path: &Path) {
    let camera = CameraModel { width: WIDTH, height: HEIGHT, ..Preset::Freiburg3.camera() };
    let person = Category { id: 1, name: "person".to_owned(), is_thing: true };
    let layer = LayerSpec { name: "panoptic".to_owned(), origin: "test".to_owned(), categories: vec![person] };
    let spec = RgbdSpec { layers: vec![layer], ..RgbdSpec::new("test", "small", camera) };
    let mut log =
        RgbdLog::create(path, &LogOptions { flush_interval_ns: 150_000_000, ..LogOptions::default() }, &spec).unwrap();
    log.log().attach("notes.txt", "text/plain", Stamp(1), b"an attached file").unwrap();
    let mut random = Random(7);
    let pixels = (WIDTH * HEIGHT) as usize;
    for frame in 0..FRAMES {
        let stamp = Stamp(1_000_000_000 + i64::from(frame) * 33_333_333);
        log.log().flush_if_due(stamp).unwrap();
        log.ground_truth(stamp, [f64::from(frame), 0.5, 0.25], [0.0, 0.0, 0.0, 1.0]).unwrap();
        let color: Vec<u8> = (0..600).map(|_| random.next() as u8).collect();
        log.color(stamp, format::PNG, &color).unwrap();
        let depth: Vec<u16> = (0..pixels).map(|_| random.next() as u16 % 3000).collect();
        log.depth(stamp, &depth).unwrap();
        let class: Vec<u16> = (0..pixels).map(|i| u16::from(i % 7 == 0)).collect();
        let area = class.iter().map(|c| u32::from(*c)).sum();
        let segments = vec![Segment { id: 1, category_id: 1, area, ..Segment::default() }];
        log.mask(0, stamp, &Mask { instance: class.clone(), class, segments }).unwrap();
    }
    log.log().metadata("pslam/import", BTreeMap::from([("paired".to_owned(), FRAMES.to_string())])).unwrap();
    log.finish().unwrap();
}

/// Messages by topic and sequence: log time and payload.
type Messages = BTreeMap<(String, u32), (u64, Vec<u8>)>;

/// Reads a valid log whole, with all checksums.
fn read_log(path: &Path) -> Messages {
    let bytes = fs::read(path).unwrap();
    mcap::Summary::read(&bytes).unwrap().expect("a recovered log has a summary");
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(|message| {
        let message = message.unwrap();
        ((message.channel.topic.clone(), message.sequence), (message.log_time, message.data.to_vec()))
    });
    messages.collect()
}

/// A chunk of the undamaged log.
struct Chunk {
    bytes: std::ops::Range<usize>,
    /// Topic and sequence of its messages.
    messages: Vec<(String, u32)>,
}

fn chunks(bytes: &[u8]) -> Vec<Chunk> {
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    let index = summary.chunk_indexes.iter().map(|chunk| {
        let start = chunk.chunk_start_offset as usize;
        let messages = summary.stream_chunk(bytes, chunk).unwrap().map(|message| {
            let message = message.unwrap();
            (message.channel.topic.clone(), message.sequence)
        });
        Chunk { bytes: start..start + chunk.chunk_length as usize, messages: messages.collect() }
    });
    index.collect()
}

struct Case {
    dir: tempfile::TempDir,
    bytes: Vec<u8>,
    original: Messages,
}

impl Case {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.mcap");
        write_log(&path);
        let bytes = fs::read(&path).unwrap();
        let original = read_log(&path);
        assert_eq!(original.len(), 9 * FRAMES as usize + 2);
        Self { dir, bytes, original }
    }

    fn recover(&self, damaged: &[u8]) -> Result<(RecoverReport, Messages), RecoverError> {
        let (path, out) = (self.dir.path().join("damaged.mcap"), self.dir.path().join("out.mcap"));
        fs::write(&path, damaged).unwrap();
        let report = recover(&path, &out, true)?;
        let messages = read_log(&out);
        assert_eq!(report.messages, messages.len() as u64);
        for (key, value) in &messages {
            assert_eq!(self.original.get(key), Some(value), "{key:?} is not what was recorded");
        }
        if messages.len() < self.original.len() {
            assert!(
                report.lossy,
                "{} messages are missing and the report says complete",
                self.original.len() - messages.len()
            );
            assert!(report.to_string().contains("LOSSY"));
        }
        Ok((report, messages))
    }

    /// Every message of the chunks that `intact` picks must be there.
    fn assert_kept(&self, messages: &Messages, intact: impl Fn(&std::ops::Range<usize>) -> bool, what: &str) {
        for chunk in chunks(&self.bytes).iter().filter(|chunk| intact(&chunk.bytes)) {
            let lost = chunk.messages.iter().find(|key| !messages.contains_key(*key));
            assert!(lost.is_none(), "{what}: chunk at {:?} is intact, but {lost:?} is lost", chunk.bytes);
        }
    }
}

#[test]
fn fifty_cuts() {
    let case = Case::new();
    assert!(chunks(&case.bytes).len() >= 8, "the test needs several chunks");
    let mut random = Random(20_240_901);
    for _ in 0..50 {
        let cut = random.below(case.bytes.len());
        match case.recover(&case.bytes[..cut]) {
            Ok((_, messages)) => case.assert_kept(&messages, |range| range.end <= cut, &format!("cut at {cut}")),
            Err(error) => assert!(cut < 8 && matches!(error, RecoverError::NotALog { .. }), "cut at {cut}: {error}"),
        }
    }
}

#[test]
fn fifty_bit_flips() {
    let case = Case::new();
    let mut random = Random(77);
    for _ in 0..50 {
        let (at, bit) = (random.below(case.bytes.len()), random.below(8));
        let mut damaged = case.bytes.clone();
        damaged[at] ^= 1 << bit;
        let (_, messages) = case.recover(&damaged).unwrap();
        case.assert_kept(&messages, |range| !range.contains(&at), &format!("bit {bit} of byte {at}"));
    }
}

#[test]
fn every_bit_of_heads_and_tails() {
    let case = Case::new();
    let second = chunks(&case.bytes)[1].bytes.clone();
    let end = case.bytes.len();
    let places = (0..200)
        .chain(second.start - 60..second.start + 60)
        .chain(second.end - 4..second.end + 40)
        .chain(end - 400..end);
    for at in places {
        let bit = at % 8;
        let mut damaged = case.bytes.clone();
        damaged[at] ^= 1 << bit;
        let (report, messages) = case.recover(&damaged).unwrap();
        case.assert_kept(&messages, |range| !range.contains(&at), &format!("bit {bit} of byte {at}"));
        let head_of_second = at >= second.start && at < second.start + 37;
        // Opcode, lengths, times and size of a chunk are no data: its CRC still vouches for the content.
        let crc = second.start + 33..second.start + 37;
        if head_of_second && !crc.contains(&at) {
            assert_eq!(messages.len(), case.original.len(), "byte {at} of a chunk's head");
            assert!(!report.lossy);
        }
    }
}

#[test]
fn an_undamaged_log_is_complete() {
    let case = Case::new();
    let (report, messages) = case.recover(&case.bytes).unwrap();
    assert_eq!(messages.len(), case.original.len());
    assert!(
        !report.lossy && report.data_section_intact && report.summary_intact && report.damage.is_empty(),
        "{report}"
    );
    assert_eq!((report.attachments, report.first_stamp), (1, Some(Stamp(1_000_000_000))));
    // Cutting only the end of the summary loses no data, and the data section's own checksum proves it.
    let (report, messages) = case.recover(&case.bytes[..case.bytes.len() - 9]).unwrap();
    assert_eq!(messages.len(), case.original.len());
    assert!(!report.lossy && report.data_section_intact && !report.summary_intact, "{report}");
}

#[test]
fn a_lost_chunk_does_not_take_its_definitions_along() {
    let case = Case::new();
    let poses = |messages: &Messages| messages.keys().filter(|(topic, _)| topic == "/ground_truth/pose").count();
    // The chunk that defines the pose channel.
    let defining = &chunks(&case.bytes)[1];
    let mut damaged = case.bytes.clone();
    damaged[defining.bytes.start + 100] ^= 0x10;
    let without_summary = damaged.len() - 2000;

    let (report, messages) = case.recover(&damaged).unwrap();
    assert_eq!((messages.len(), report.messages_without_channel), (case.original.len(), 0));
    assert!(defining.messages.is_empty() && !report.lossy && !report.data_section_intact, "{report}");
    assert!(report.damage.iter().any(|d| d.offset == defining.bytes.start as u64 && d.what.contains("chunk")));

    // Without the summary, the copy outside the chunks still names the messages.
    let (report, messages) = case.recover(&damaged[..without_summary]).unwrap();
    assert!(report.lossy && !report.summary_intact && report.messages_without_channel == 0, "{report}");
    assert_eq!(poses(&messages), FRAMES as usize);

    // Without that as well, nobody knows what they are: they are counted, not guessed.
    let copy = b"pslam/channel/ground_truth/pose";
    let at = damaged.windows(copy.len()).position(|window| window == copy).unwrap();
    damaged[at] ^= 1;
    let (report, messages) = case.recover(&damaged[..without_summary]).unwrap();
    assert_eq!((poses(&messages), report.messages_without_channel), (0, u64::from(FRAMES)));
    assert!(report.to_string().contains("40 messages whose channel is unknown"));
}

#[test]
fn missing_sequences_are_told() {
    let case = Case::new();
    let whole = chunks(&case.bytes);
    let lost = &whole[whole.len() - 3];
    let mut damaged = case.bytes.clone();
    damaged[lost.bytes.end - 10] ^= 1;
    let (report, _) = case.recover(&damaged).unwrap();
    let in_chunk: Vec<u32> = lost.messages.iter().filter(|(topic, _)| topic == "/tf").map(|(_, n)| *n).collect();
    let tf = &report.channels["/tf"];
    assert_eq!(tf.missing_sequences, [(in_chunk[0], in_chunk[in_chunk.len() - 1])]);
    assert_eq!((tf.expected, tf.messages), (Some(u64::from(FRAMES)), u64::from(FRAMES) - in_chunk.len() as u64));
}

#[test]
fn damaged_metadata_and_attachments_are_not_passed_on() {
    let case = Case::new();
    let find = |needle: &[u8]| case.bytes.windows(needle.len()).position(|window| window == needle).unwrap();
    for (needle, kept) in [(&b"units_per_metre"[..], "metadata"), (b"an attached file", "attachment")] {
        // The channel's copy of the key is compressed; the first plain one is the metadata record's.
        let mut damaged = case.bytes.clone();
        damaged[find(needle)] ^= 1;
        let (report, messages) = case.recover(&damaged).unwrap();
        assert_eq!(messages.len(), case.original.len());
        assert!(report.lossy, "{report}");
        assert!(report.damage.iter().any(|damage| damage.what.starts_with(kept)), "{report}");
    }
}

#[test]
fn what_is_no_log_is_refused() {
    let case = Case::new();
    for bytes in [&b""[..], b"hello", &[0; 4096]] {
        assert!(matches!(case.recover(bytes), Err(RecoverError::NotALog { .. })));
    }
    let path = case.dir.path().join("log.mcap");
    assert!(matches!(recover(&path, &path, true), Err(RecoverError::SameFile(_))));
    assert!(recover(&case.dir.path().join("missing.mcap"), &case.dir.path().join("x.mcap"), false).is_err());
    let existing = case.dir.path().join("existing.mcap");
    fs::write(&existing, "keep me").unwrap();
    assert!(matches!(recover(&path, &existing, false), Err(RecoverError::Write(_))));
    assert_eq!(fs::read(&existing).unwrap(), b"keep me");
}

#[test]
fn a_crashed_writer_loses_only_the_open_chunk() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("live.mcap");
    let camera = CameraModel { width: 2, height: 1, ..Preset::Freiburg3.camera() };
    let mut log = RgbdLog::create(&path, &LogOptions::default(), &RgbdSpec::new("test", "live", camera)).unwrap();
    for i in 0..5 {
        log.depth(Stamp(i), &[1, 2]).unwrap();
    }
    log.log().flush().unwrap();
    log.depth(Stamp(9), &[3, 4]).unwrap();
    // What a crash leaves: the bytes on the disk at this moment.
    let partial = dir.path().join("live.mcap.partial");
    let left = fs::read(&partial).unwrap();
    log.discard();
    assert!(!partial.exists() && !path.exists());
    fs::write(&partial, left).unwrap();
    // The natural output name: beside the partial file.
    let report = recover(&partial, &path, false).unwrap();
    assert!(report.lossy);
    assert_eq!(report.channels["/camera/depth/image"].messages, 5);
    assert!(partial.exists());
    // A new writer does not run over what an interrupted one left.
    fs::remove_file(&path).unwrap();
    assert!(matches!(
        recorder::LogWriter::create(&path, &LogOptions::default()),
        Err(recorder::WriteError::Unfinished(_))
    ));
}

#[test]
fn any_mutilation_passes_on_nothing_wrong() {
    let case = Case::new();
    let mut random = Random(4242);
    for round in 0..60 {
        let mut damaged = case.bytes.clone();
        for _ in 0..=random.below(6) {
            let at = random.below(damaged.len());
            let len = random.below(3000).min(damaged.len() - at);
            match random.below(4) {
                0 => damaged[at..at + len].fill(0),
                1 => drop(damaged.drain(at..at + len)),
                2 => drop(damaged.splice(at..at, std::iter::repeat_n(0x06, len))),
                _ => damaged[at..at + len].iter_mut().for_each(|byte| *byte = random.next() as u8),
            }
        }
        let (report, messages) = case.recover(&damaged).unwrap_or_else(|error| panic!("round {round}: {error}"));
        assert!(!messages.is_empty() && !report.gave_up, "round {round} keeps nothing");
    }
}
