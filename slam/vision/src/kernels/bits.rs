//! Hamming distances.

use crate::Descriptor;

#[inline(always)]
pub(super) fn hamming_many(query: &Descriptor, descriptors: &[Descriptor], distances: &mut [u32]) {
    for (distance, descriptor) in distances.iter_mut().zip(descriptors) {
        *distance = hamming(query, descriptor);
    }
}

#[inline(always)]
pub(super) fn hamming_at(query: &Descriptor, descriptors: &[Descriptor], indices: &[u32], distances: &mut [u32]) {
    for (distance, &index) in distances.iter_mut().zip(indices) {
        *distance = hamming(query, &descriptors[index as usize]);
    }
}

/// Where popcnt exists `count_ones` is one instruction, otherwise the compiler's bit tricks.
#[inline(always)]
fn hamming(a: &Descriptor, b: &Descriptor) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}
