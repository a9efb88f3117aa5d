//! The bytes of a stream that have arrived and are not used yet.

/// Grows only with what has really arrived; whoever reads must use up messages before adding more.
#[derive(Debug, Default)]
pub struct StreamBuffer {
    bytes: Vec<u8>,
    /// First byte that is not used yet.
    at: usize,
    /// Offset in the stream of `bytes[0]`.
    base: u64,
}

impl StreamBuffer {
    /// Adds what has arrived.
    pub fn push(&mut self, piece: &[u8]) {
        self.bytes.drain(..self.at);
        self.base += self.at as u64;
        self.at = 0;
        self.bytes.extend_from_slice(piece);
    }

    /// What has arrived and is not used.
    #[must_use]
    pub fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// Offset in the stream of the first byte of [`StreamBuffer::rest`].
    #[must_use]
    pub fn offset(&self) -> u64 {
        self.base + self.at as u64
    }

    /// Marks the first `count` bytes of the rest as used.
    pub fn consume(&mut self, count: usize) {
        self.at += count.min(self.rest().len());
    }
}

/// Bytes for a message.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
