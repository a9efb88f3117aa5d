//! When the measurements of a device came, against its own clock, in bounded memory.

/// Time over which the earliest arrival counts to begin with, nanoseconds.
const WINDOW_NS: i64 = 1_000_000_000;
/// Windows kept; one more, and each two become one of twice the length. The number of slopes between them grows with the
/// square.
const MAX_WINDOWS: usize = 1000;
/// A clock that changes by more against the host's between two arrivals has been set anew, nanoseconds.
const RESET_NS: i64 = 1_000_000_000;
/// Arrivals of a window that its median is taken from: 4 s at 1 kHz.
const MAX_PENDING: usize = 4096;

/// `(device, arrival)` in nanoseconds.
type Pair = (i64, i64);

/// The arrivals of one stream: of every second of the device's clock the earliest, the typical and the latest. What a clock
/// is fitted to needs no more, and hours need no more memory than a quarter of an hour.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Arrivals {
    current: Piece,
    /// The longest one before a reset of the device's clock.
    before: Piece,
}

/// Arrivals between two resets of the device's clock.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Piece {
    samples: usize,
    /// First of all, and the one with the latest device time.
    ends: Option<(Pair, Pair)>,
    /// Length of the closed windows, nanoseconds.
    length_ns: i64,
    windows: Vec<Window>,
    /// Number of the window that is filled at present, and its arrivals.
    open: i64,
    pending: Vec<Pair>,
}

/// Some arrivals of neighbouring device times, by their delay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The one with the least delay.
    pub earliest: (i64, i64),
    /// One whose delay is the median; where windows were joined, the first one's.
    pub typical: (i64, i64),
    /// The one with the largest delay.
    pub latest: (i64, i64),
}

impl Arrivals {
    /// One measurement: unwrapped device time and host monotonic time at arrival, nanoseconds; in order of arrival.
    pub fn push(&mut self, device_ns: i64, arrival_ns: i64) {
        let pair = (device_ns, arrival_ns);
        let jump = self.current.last_delay_ns().map_or(0, |last| delay_ns(&pair).saturating_sub(last).saturating_abs());
        if jump >= RESET_NS {
            let piece = std::mem::take(&mut self.current);
            if piece.samples > self.before.samples {
                self.before = piece;
            }
        }
        self.current.push(pair);
    }

    /// The arrivals of the longest piece; of equal ones the first.
    #[must_use]
    pub fn longest(&self) -> &Piece {
        if self.current.samples > self.before.samples { &self.current } else { &self.before }
    }
}

impl FromIterator<(i64, i64)> for Arrivals {
    fn from_iter<I: IntoIterator<Item = (i64, i64)>>(pairs: I) -> Self {
        let mut arrivals = Self::default();
        pairs.into_iter().for_each(|(device_ns, arrival_ns)| arrivals.push(device_ns, arrival_ns));
        arrivals
    }
}

fn delay_ns(pair: &Pair) -> i64 {
    pair.1.saturating_sub(pair.0)
}

impl Piece {
    /// Arrivals in all.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// The first arrival, and the one with the latest device time.
    #[must_use]
    pub fn ends(&self) -> Option<((i64, i64), (i64, i64))> {
        self.ends
    }

    /// At most a thousand windows that hold them all, in order of device time.
    #[must_use]
    pub fn windows(&self) -> Vec<Window> {
        let mut windows = self.windows.clone();
        windows.extend(Window::of(self.pending.clone()));
        windows
    }

    fn last_delay_ns(&self) -> Option<i64> {
        self.pending.last().map(delay_ns)
    }

    fn push(&mut self, pair: Pair) {
        self.samples += 1;
        let ends = self.ends.get_or_insert((pair, pair));
        if pair.0 > ends.1.0 {
            ends.1 = pair;
        }
        let number = pair.0.saturating_sub(ends.0.0) / WINDOW_NS;
        // What comes late belongs to the window that is open.
        if number > self.open || self.pending.len() >= MAX_PENDING {
            self.close_window();
            self.open = number.max(self.open);
        }
        self.pending.push(pair);
    }

    fn close_window(&mut self) {
        let Some(window) = Window::of(std::mem::take(&mut self.pending)) else { return };
        if self.length_ns == 0 {
            self.length_ns = WINDOW_NS;
        }
        let origin_ns = self.ends.map_or(0, |(first, _)| first.0);
        let number = |window: &Window, length_ns: i64| window.earliest.0.saturating_sub(origin_ns) / length_ns;
        match self.windows.last_mut() {
            Some(last) if number(last, self.length_ns) == number(&window, self.length_ns) => last.join(&window),
            _ => self.windows.push(window),
        }
        if self.windows.len() >= MAX_WINDOWS {
            self.length_ns = self.length_ns.saturating_mul(2);
            let length_ns = self.length_ns;
            self.windows.dedup_by(|later, earlier| {
                let is_one = number(later, length_ns) == number(earlier, length_ns);
                if is_one {
                    earlier.join(later);
                }
                is_one
            });
        }
    }
}

impl Window {
    fn of(mut pairs: Vec<Pair>) -> Option<Self> {
        let middle = pairs.len() / 2;
        pairs.sort_unstable_by_key(|pair| (delay_ns(pair), pair.0));
        Some(Self { earliest: *pairs.first()?, typical: *pairs.get(middle)?, latest: *pairs.last()? })
    }

    fn join(&mut self, other: &Self) {
        if delay_ns(&other.earliest) < delay_ns(&self.earliest) {
            self.earliest = other.earliest;
        }
        if delay_ns(&other.latest) > delay_ns(&self.latest) {
            self.latest = other.latest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_need_no_more_than_a_thousand_windows() {
        // 250 Hz for three hours; the delay of every hundredth is none, all others have 2 to 4 ms.
        let pair =
            |i: i64| (i * 4_000_000, i * 4_000_000 + if i % 100 == 37 { 0 } else { 2_000_000 + i % 3 * 1_000_000 });
        let arrivals: Arrivals = (0..250 * 3600 * 3).map(pair).collect();
        let piece = arrivals.longest();
        let windows = piece.windows();
        assert!((MAX_WINDOWS / 2 - 1..=MAX_WINDOWS).contains(&windows.len()), "{}", windows.len());
        assert_eq!(piece.samples(), 250 * 3600 * 3);
        assert_eq!(piece.ends(), Some((pair(0), pair(250 * 3600 * 3 - 1))));
        let delays = |window: &Window| [window.earliest, window.typical, window.latest].map(|pair| delay_ns(&pair));
        assert!(windows.iter().all(|window| delays(window) == [0, 3_000_000, 4_000_000]), "{windows:?}");
        assert!(windows.windows(2).all(|pair| pair[1].earliest.0 - pair[0].earliest.0 <= 2 * 16_000_000_000));
    }

    #[test]
    fn nothing_grows_with_a_rate_or_a_jump() {
        // A device whose clock stands still, then one that jumps each time.
        let still: Arrivals = (0..100_000).map(|i| (5, 5 + i)).collect();
        assert!(still.longest().pending.len() <= MAX_PENDING && still.longest().windows.len() <= 1);
        let jumping: Arrivals = (0..10_000).map(|i| (i64::MAX / 2 * (i % 2), i)).collect();
        assert_eq!(jumping.longest().samples(), 1);
        assert!(Arrivals::default().longest().windows().is_empty());
    }
}
