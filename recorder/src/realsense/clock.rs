//! The device's microsecond counter.

/// Counts on where a 32-bit microsecond counter starts again: every 2^32 us = 71.6 minutes.
///
/// One per stream. Values may come out of order by up to half a turn (35.8 minutes); a stream that was silent for longer
/// than that has lost its turn count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceClock {
    last_us: Option<i64>,
}

/// A turn of the counter.
const TURN_US: i64 = 1 << 32;

impl DeviceClock {
    /// The unwrapped value of a counter value: the one nearest to the value before it. The first value stands as it is.
    pub fn unwrap_us(&mut self, counter_us: u32) -> i64 {
        let counter = i64::from(counter_us);
        let unwrapped = self.last_us.map_or(counter, |last| {
            let ahead = (counter - last).rem_euclid(TURN_US);
            last + if ahead < TURN_US / 2 { ahead } else { ahead - TURN_US }
        });
        self.last_us = Some(unwrapped);
        unwrapped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unwrapped(values: &[i64]) -> Vec<i64> {
        let mut clock = DeviceClock::default();
        values.iter().map(|value| clock.unwrap_us(value.rem_euclid(TURN_US) as u32)).collect()
    }

    #[test]
    fn hours_pass() {
        // Frames of 30 Hz over three turns.
        let values: Vec<i64> = (0..400_000).map(|i| 5_000_000 + i * 33_333).collect();
        assert!(values[values.len() - 1] > 3 * TURN_US);
        assert_eq!(unwrapped(&values), values);
    }

    #[test]
    fn late_frames_keep_their_turn() {
        let values = [TURN_US - 10, TURN_US + 20, TURN_US - 5, TURN_US + 30];
        assert_eq!(unwrapped(&values), values);
        // Before the first value of all: the count goes below zero rather than a turn ahead.
        assert_eq!(unwrapped(&[20, -10]), [20, -10]);
    }

    #[test]
    fn half_a_turn_is_the_limit() {
        assert_eq!(unwrapped(&[0, TURN_US / 2 - 1]), [0, TURN_US / 2 - 1]);
        assert_eq!(unwrapped(&[0, TURN_US / 2]), [0, -TURN_US / 2]);
    }
}
