//! Distances between binary descriptors.

use crate::Kernels;

/// 256 bits; bit `i` is `word[i / 64] >> (i % 64) & 1`.
pub type Descriptor = [u64; 4];

/// Number of bits that differ, 0 to 256.
///
/// Free of branches, so it inlines into any loop; for a list of candidates [`hamming_many`] and
/// [`nearest_two`] are faster, because they ask once what the CPU offers.
#[inline]
#[must_use]
pub fn hamming(a: &Descriptor, b: &Descriptor) -> u32 {
    // Counts within nibbles of all four words are added first (at most 4 a word, 8 a pair: a nibble holds 15), so
    // that the costly horizontal sum happens once.
    let nibbles = |word: u64| {
        let pairs = word - (word >> 1 & 0x5555_5555_5555_5555);
        (pairs & 0x3333_3333_3333_3333) + (pairs >> 2 & 0x3333_3333_3333_3333)
    };
    let bytes = |nibbles: u64| (nibbles & 0x0f0f_0f0f_0f0f_0f0f) + (nibbles >> 4 & 0x0f0f_0f0f_0f0f_0f0f);
    let low = nibbles(a[0] ^ b[0]) + nibbles(a[1] ^ b[1]);
    let high = nibbles(a[2] ^ b[2]) + nibbles(a[3] ^ b[3]);
    let sums = bytes(low) + bytes(high);
    // Bytes hold up to 32; four 16-bit lanes keep the total of 256 from overflowing a byte.
    let lanes = (sums & 0x00ff_00ff_00ff_00ff) + (sums >> 8 & 0x00ff_00ff_00ff_00ff);
    (lanes.wrapping_mul(0x0001_0001_0001_0001) >> 48) as u32
}

/// Fills `distances` with the distance of `query` to every descriptor, in their order.
///
/// Panics when there are fewer or more of them.
pub fn hamming_many(query: &Descriptor, descriptors: &[Descriptor], distances: &mut [u32]) {
    assert_eq!(distances.len(), descriptors.len(), "a distance for each descriptor");
    Kernels::detect().hamming_many(query, descriptors, distances);
}

/// A descriptor of a list and its distance to the one that was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Nearest {
    /// Hamming distance; `u32::MAX` when there is none.
    pub distance: u32,
    /// Index into the list; `u32::MAX` when there is none.
    pub index: u32,
}

/// The nearest and the second nearest to `query` of `descriptors[i]` for every `i` of `indices`; of equal distances the
/// smaller index is nearer, so their order does not matter.
///
/// Panics when an index is out of range.
#[must_use]
pub fn nearest_two(query: &Descriptor, descriptors: &[Descriptor], indices: &[u32]) -> [Nearest; 2] {
    Kernels::detect().nearest_two(query, descriptors, indices)
}
