//! Hamming distances.

use crate::{Descriptor, Nearest};

#[inline(always)]
pub(super) fn hamming_many(query: &Descriptor, descriptors: &[Descriptor], distances: &mut [u32]) {
    for (distance, descriptor) in distances.iter_mut().zip(descriptors) {
        *distance = hamming(query, descriptor);
    }
}

#[inline(always)]
pub(super) fn nearest_two(query: &Descriptor, descriptors: &[Descriptor], indices: &[u32]) -> [Nearest; 2] {
    // Distance and index in one number, so that the pair is ordered by one comparison and without a branch.
    let (mut first, mut second) = (u64::MAX, u64::MAX);
    for &index in indices {
        let key = u64::from(hamming(query, &descriptors[index as usize])) << 32 | u64::from(index);
        second = second.min(first.max(key));
        first = first.min(key);
    }
    [first, second].map(|key| Nearest { distance: (key >> 32) as u32, index: key as u32 })
}

/// Where popcnt exists `count_ones` is one instruction, otherwise the compiler's bit tricks.
#[inline(always)]
fn hamming(a: &Descriptor, b: &Descriptor) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}
