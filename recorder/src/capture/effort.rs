//! How much work goes into packing a picture.

use super::lane::Load;
use crate::picture::Packing;

/// How colour is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// Compressed as long as that keeps up with the camera, see `Effort::look`.
    #[default]
    Auto,
    /// Always compressed, PNG.
    Compressed,
    /// Raw pixels, and chunks uncompressed too.
    Raw,
}

impl Encoding {
    /// For the log.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Auto => "colour png, stored without compression while the encoder cannot keep up; chunks zstd",
            Self::Compressed => "colour png, chunks zstd",
            Self::Raw => "raw",
        }
    }
}

/// Pictures after which compression is tried again: five seconds at 30 Hz, so that the log does not fill with changes.
const TRY_AGAIN: u32 = 150;

/// Decides picture by picture.
#[derive(Debug, Default)]
pub(super) struct Effort {
    stored: bool,
    /// Pictures since the last change.
    since: u32,
}

impl Effort {
    /// Looks at the queue before the encoder and the one behind it. With [`Encoding::Auto`] compression goes as soon as
    /// half of the first one is full while the second one has room, for then the encoder is what is slow; it comes back
    /// once the first one is nearly empty, or the second, the disk's, is filling up. A change is told in words.
    pub fn look(&mut self, encoding: Encoding, before: Load, behind: Load) -> Option<&'static str> {
        self.since = self.since.saturating_add(1);
        if encoding != Encoding::Auto {
            return None;
        }
        let disk_is_slow = behind.is_above_one_of(2);
        let change = if self.stored {
            self.since >= TRY_AGAIN && (disk_is_slow || !before.is_above_one_of(8))
        } else {
            before.is_above_one_of(2) && !disk_is_slow
        };
        if !change {
            return None;
        }
        (self.stored, self.since) = (!self.stored, 0);
        Some(match (self.stored, disk_is_slow) {
            (true, _) => "half of its queue is full: pictures are stored without compression from here on",
            (false, true) => "the disk is what is slow: pictures are compressed from here on",
            (false, false) => "it keeps up again: pictures are compressed from here on",
        })
    }

    pub fn packing(&self) -> Packing {
        if self.stored { Packing::Stored } else { Packing::Fast }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(weight: usize) -> Load {
        Load { items: 1, weight, limit: 80 }
    }

    #[test]
    fn compression_goes_and_comes_back() {
        let mut effort = Effort::default();
        let mut look = |before, behind| {
            let told = effort.look(Encoding::Auto, load(before), load(behind)).is_some();
            (told, effort.packing() == Packing::Stored)
        };
        assert_eq!(look(40, 0), (false, false), "half is not too much");
        assert_eq!(look(41, 41), (false, false), "the disk is slow: more bytes would not help");
        assert_eq!(look(41, 0), (true, true));
        assert!((1..TRY_AGAIN).all(|_| look(0, 0) == (false, true)));
        assert_eq!(look(11, 0), (false, true), "still an eighth");
        assert_eq!(look(10, 0), (true, false));
        assert_eq!(look(41, 0), (true, true));
        assert!((1..TRY_AGAIN).all(|_| look(80, 80) == (false, true)));
        assert_eq!(look(80, 80), (true, false));
        for encoding in [Encoding::Compressed, Encoding::Raw] {
            assert_eq!(Effort::default().look(encoding, load(80), load(0)), None);
        }
    }
}
