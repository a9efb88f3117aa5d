//! What a running recording keeps for the synchronisation at its end: in bounded memory, however long it lasts.

use super::solve::usual_gap_ns;
use schemas::cdr::CdrError;
use schemas::sync::{PoseSample, Signals};
use schemas::topics;
use std::collections::BTreeMap;
use std::mem::size_of;

/// Samples stay or go in blocks of so many nanoseconds: long enough for an offset of their own.
const BLOCK_NS: i64 = 20_000_000_000;
/// Samples may take so many bytes: five minutes of a gyroscope at 200 Hz and one body at 100 Hz, of which two and a half stay at
/// least; one minute tells an offset to 0.05 ms.
const BUDGET_BYTES: usize = 4 << 20;
/// Windows of a body that are told: beyond, a flickering marker says nothing new.
const MAX_WINDOWS: usize = 10_000;

/// Signals of a recording. When they have grown to the budget every second block of 20 s goes, and so on: what stays is
/// spread over the whole recording. Clocks need no thinning, see [`schemas::sync::Arrivals`].
#[derive(Debug, Default)]
pub struct Gathering {
    signals: Signals,
    /// Blocks whose number this divides are kept; 0: all.
    stride: i64,
    /// Samples of a body so far apart have a gap between them, nanoseconds; known from the first thinning on.
    gap_ns: i64,
}

impl Gathering {
    /// Takes a message, see [`Signals::take`].
    ///
    /// # Errors
    /// The bytes are not what the topic says.
    pub fn take(&mut self, topic: &str, bytes: &[u8]) -> Result<(), CdrError> {
        self.signals.take(topic, bytes)?;
        self.bound(topic);
        Ok(())
    }

    /// What was kept.
    #[must_use]
    pub fn into_signals(self) -> Signals {
        self.signals
    }

    /// Keeps within the budget after a message of a topic.
    fn bound(&mut self, topic: &str) {
        if self.stride > 0 {
            self.drop_newest(topic);
        }
        if self.bytes() > BUDGET_BYTES {
            self.thin();
        }
    }

    fn bytes(&self) -> usize {
        let poses: usize = self.signals.bodies.values().map(Vec::len).sum();
        self.signals.gyro.len() * size_of::<(i64, [f64; 3])>() + poses * size_of::<PoseSample>()
    }

    /// Lets go what came last, if its block is not kept; when a body was seen is noted all the same.
    fn drop_newest(&mut self, topic: &str) {
        let is_kept = |stamp_ns| is_kept(stamp_ns, self.stride);
        if topic == topics::GYRO {
            self.signals.gyro.pop_if(|(stamp_ns, _)| !is_kept(*stamp_ns));
        } else if topic == topics::MOCAP {
            for (name, samples) in &mut self.signals.bodies {
                if let Some(newest) = samples.last() {
                    see(&mut self.signals.seen, name, newest, self.gap_ns);
                }
                samples.pop_if(|newest| !is_kept(newest.stamp_ns));
            }
        }
    }

    fn thin(&mut self) {
        let Signals { gyro, bodies, seen, .. } = &mut self.signals;
        if self.stride == 0 {
            self.gap_ns = usual_gap_ns(bodies.values());
            for (name, samples) in bodies.iter() {
                samples.iter().for_each(|sample| see(seen, name, sample, self.gap_ns));
            }
        }
        self.stride = (self.stride * 2).max(2);
        let stride = self.stride;
        gyro.retain(|(stamp_ns, _)| is_kept(*stamp_ns, stride));
        bodies.values_mut().for_each(|samples| samples.retain(|sample| is_kept(sample.stamp_ns, stride)));
    }
}

fn is_kept(stamp_ns: i64, stride: i64) -> bool {
    stamp_ns.div_euclid(BLOCK_NS) % stride == 0
}

/// Notes that a body was seen: in the window that ends with the sample before, or in a new one.
fn see(seen: &mut BTreeMap<String, Vec<(PoseSample, PoseSample)>>, name: &str, sample: &PoseSample, gap_ns: i64) {
    if !seen.contains_key(name) {
        seen.insert(name.to_owned(), Vec::new());
    }
    let Some(windows) = seen.get_mut(name) else { return };
    let count = windows.len();
    match windows.last_mut() {
        // Hidden: what is left is from an earlier block.
        Some((_, end)) if sample.stamp_ns <= end.stamp_ns => {}
        Some((_, end)) if sample.stamp_ns.saturating_sub(end.stamp_ns) <= gap_ns => *end = *sample,
        _ if count < MAX_WINDOWS => windows.push((*sample, *sample)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_NS: i64 = 1_700_000_000_000_000_000;

    fn turn(gathering: &mut Gathering, stamp_ns: i64) {
        gathering.signals.gyro.push((stamp_ns, [1.0, 2.0, 3.0]));
        gathering.bound(topics::GYRO);
    }

    fn see_body(gathering: &mut Gathering, stamp_ns: i64, is_seen: bool) {
        let (translation_m, rotation_xyzw) = ([0.0; 3], [0.0, 0.0, 0.0, 1.0]);
        let sample = PoseSample { stamp_ns, system_ns: None, translation_m, rotation_xyzw };
        gathering.signals.bodies.entry("quad/quad".to_owned()).or_default().extend(is_seen.then_some(sample));
        gathering.bound(topics::MOCAP);
    }

    /// `hours` of 200 Hz gyroscope and 100 Hz mocap; the body is hidden for a second of every minute. Returns the largest
    /// number of bytes on the way.
    fn gathered(hours: i64) -> (Gathering, usize) {
        let (mut gathering, mut largest) = (Gathering::default(), 0);
        for i in 0..hours * 3600 * 200 {
            let stamp_ns = START_NS + i * 5_000_000;
            turn(&mut gathering, stamp_ns);
            if i % 2 == 0 {
                see_body(&mut gathering, stamp_ns, i % 12_000 >= 200);
            }
            largest = largest.max(gathering.bytes());
        }
        (gathering, largest)
    }

    #[test]
    fn four_hours_take_no_more_memory_than_five_minutes() {
        let (gathering, largest) = gathered(4);
        assert!(largest <= BUDGET_BYTES + 1000, "{largest}");
        let signals = gathering.into_signals();
        let end_ns = START_NS + 4 * 3_600_000_000_000;
        let blocks = |stamps: Vec<i64>| -> Vec<i64> {
            let mut blocks: Vec<i64> = stamps.into_iter().map(|stamp| stamp.div_euclid(BLOCK_NS)).collect();
            blocks.dedup();
            blocks
        };
        let turning = blocks(signals.gyro.iter().map(|(stamp, _)| *stamp).collect());
        let seen = blocks(signals.bodies["quad/quad"].iter().map(|sample| sample.stamp_ns).collect());
        assert_eq!(turning, seen, "both have the same blocks");
        assert!(turning.len() >= 6, "{turning:?}");
        assert!(
            turning.windows(2).all(|pair| pair[1] - pair[0] == turning[1] - turning[0]),
            "spread evenly: {turning:?}"
        );
        assert!(end_ns - turning[turning.len() - 1] * BLOCK_NS < 160 * BLOCK_NS, "up to the end");
        // A block that is kept has all its samples.
        let first = signals.gyro.iter().filter(|(stamp, _)| stamp.div_euclid(BLOCK_NS) == turning[1]).count();
        assert_eq!(first, 4000);
        let windows = &signals.seen["quad/quad"];
        assert_eq!(windows.len(), 240, "of every minute one");
        assert!(windows.iter().all(|(from, to)| to.stamp_ns - from.stamp_ns == 58_990_000_000), "{:?}", windows[100]);
    }

    #[test]
    fn short_recordings_are_kept_whole() {
        let mut gathering = Gathering::default();
        (0..1000).for_each(|i| turn(&mut gathering, START_NS + i * 5_000_000));
        let signals = gathering.into_signals();
        assert!(signals.gyro.len() == 1000 && signals.seen.is_empty());
    }
}
