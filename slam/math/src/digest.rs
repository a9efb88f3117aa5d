//! Canonical bytes and their hash: what "the same result" means.

use xxhash_rust::xxh3::Xxh3;

/// xxh3-128 of canonical bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Digest(pub u128);

impl std::fmt::Display for Digest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl Digest {
    /// Continues a chain: the hash of the previous link followed by this one.
    #[must_use]
    pub fn chain(self, next: Self) -> Self {
        let mut w = DigestWriter::default();
        w.bytes(&self.0.to_le_bytes());
        w.bytes(&next.0.to_le_bytes());
        w.finish()
    }
}

/// Collects values as little-endian bytes. Floats go in by their bits: equal means equal to the last bit.
#[derive(Clone, Default)]
pub struct DigestWriter {
    hasher: Xxh3,
    len: u64,
}

impl DigestWriter {
    /// Raw bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.hasher.update(bytes);
        self.len += bytes.len() as u64;
    }
    /// One byte.
    pub fn u8(&mut self, v: u8) {
        self.bytes(&[v]);
    }
    /// 32 bits.
    pub fn u32(&mut self, v: u32) {
        self.bytes(&v.to_le_bytes());
    }
    /// 64 bits.
    pub fn u64(&mut self, v: u64) {
        self.bytes(&v.to_le_bytes());
    }
    /// 64 bits, signed.
    pub fn i64(&mut self, v: i64) {
        self.bytes(&v.to_le_bytes());
    }
    /// A float by its bits.
    pub fn f32(&mut self, v: f32) {
        self.bytes(&v.to_bits().to_le_bytes());
    }
    /// A float by its bits.
    pub fn f64(&mut self, v: f64) {
        self.bytes(&v.to_bits().to_le_bytes());
    }
    /// Floats by their bits.
    pub fn f64s(&mut self, values: &[f64]) {
        for v in values {
            self.f64(*v);
        }
    }
    /// A string with its length in front.
    pub fn str(&mut self, s: &str) {
        self.u64(s.len() as u64);
        self.bytes(s.as_bytes());
    }
    /// Bytes written so far.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.len
    }
    /// True when nothing was written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
    /// The hash of everything written.
    #[must_use]
    pub fn finish(&self) -> Digest {
        Digest(self.hasher.digest128())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_bit_changes_the_digest() {
        let digest = |x: f64| {
            let mut w = DigestWriter::default();
            w.f64(x);
            w.finish()
        };
        assert_eq!(digest(1.0), digest(1.0));
        assert_ne!(digest(1.0), digest(f64::from_bits(1.0f64.to_bits() + 1)));
        assert_ne!(digest(0.0), digest(-0.0));
    }

    #[test]
    fn a_chain_depends_on_order() {
        let (a, b) = (Digest(1), Digest(2));
        assert_ne!(a.chain(b), b.chain(a));
    }
}
