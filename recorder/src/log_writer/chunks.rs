//! How large the chunks of a log become.

/// Uncompressed bytes of a chunk.
pub(super) const CHUNK_BYTES: u64 = 1 << 20;
/// The largest that chunks grow to: a quarter of a second of two pictures of 1280x720 at 30 Hz.
pub(super) const MAX_CHUNK_BYTES: u64 = 16 << 20;
/// Chunks of one size, after which they are twice as large.
const CHUNKS_OF_A_SIZE: u64 = 16_384;
/// Record header and message header.
const MESSAGE_HEAD_BYTES: u64 = 31;

/// The container's index has an entry a chunk, which its writer holds in memory until the end, half a kilobyte each. With
/// chunks that grow it stays at some tens of megabytes for days of pictures instead of growing with every hour.
#[derive(Debug, Default)]
pub(super) struct Chunks {
    closed: u64,
    open_bytes: u64,
}

impl Chunks {
    /// Whether the open chunk has its size, so that the next message begins another one.
    pub fn is_full(&self) -> bool {
        self.open_bytes > (CHUNK_BYTES << (self.closed / CHUNKS_OF_A_SIZE).min(8)).min(MAX_CHUNK_BYTES)
    }

    /// A message with so many bytes went into the open chunk.
    pub fn add(&mut self, bytes: usize) {
        self.open_bytes += bytes as u64 + MESSAGE_HEAD_BYTES;
    }

    /// The open chunk was closed, if there was one.
    pub fn close(&mut self) {
        self.closed += u64::from(self.open_bytes > 0);
        self.open_bytes = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_of_a_day_are_few() {
        // 60 MB/s for a day, messages of 100 kB, closed twice a second.
        let (mut chunks, mut first, mut largest) = (Chunks::default(), 0, 0);
        for i in 0..86_400 * 600 {
            if chunks.is_full() || i % 300 == 0 {
                largest = largest.max(chunks.open_bytes);
                chunks.close();
            }
            chunks.add(100_000);
            first = if i == 599 { chunks.closed } else { first };
        }
        assert!((54..=56).contains(&first), "the first second has chunks of a megabyte: {first}");
        assert!(largest <= MAX_CHUNK_BYTES + 200_000, "{largest}");
        assert!(chunks.closed < 400_000, "{}: 5 million without", chunks.closed);
    }
}
