//! Packed little-endian values, as Vicon's protocols have them.
//!
//! Numbers stand without alignment; a text is a u32 byte count and the bytes; a list, set or map a u32 element count and
//! the elements. Nothing is allocated before the bytes for it are there.

use std::collections::{BTreeMap, BTreeSet};

/// Why bytes are not the expected value; offsets count from the start of the slice.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// The bytes end inside a value.
    #[error("{needed} bytes wanted at offset {offset}, {left} are left")]
    Truncated {
        /// Where the value begins.
        offset: usize,
        /// Bytes that it needs.
        needed: usize,
        /// Bytes that are there.
        left: usize,
    },
    /// A list claims more elements than the bytes can hold.
    #[error("a list at offset {offset} claims {count} elements, {left} bytes are left")]
    Count {
        /// Where the count stands.
        offset: usize,
        /// The claim.
        count: u32,
        /// Bytes after it.
        left: usize,
    },
}

/// Bytes that are read from front to back.
#[derive(Debug, Clone)]
pub struct Input<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Input<'a> {
    /// Begins at the first byte.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// Fewer are left.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], WireError> {
        let left = self.bytes.len() - self.at;
        if count > left {
            return Err(WireError::Truncated { offset: self.at, needed: count, left });
        }
        let taken = &self.bytes[self.at..self.at + count];
        self.at += count;
        Ok(taken)
    }

    /// Offset of the next byte.
    #[must_use]
    pub fn offset(&self) -> usize {
        self.at
    }

    /// Whether nothing is left.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.at == self.bytes.len()
    }

    fn count(&mut self, min_element_bytes: usize) -> Result<usize, WireError> {
        let offset = self.at;
        let count = u32::read(self)?;
        let left = self.bytes.len() - self.at;
        if (count as usize).saturating_mul(min_element_bytes) > left {
            return Err(WireError::Count { offset, count, left });
        }
        Ok(count as usize)
    }
}

/// A value with a packed little-endian layout.
pub trait Wire: Sized {
    /// The fewest bytes that any value takes, at least 1: bounds hostile counts.
    const MIN_BYTES: usize;
    /// Reads the next value.
    ///
    /// # Errors
    /// The bytes are no such value.
    fn read(input: &mut Input<'_>) -> Result<Self, WireError>;
    /// Appends the value.
    fn write(&self, out: &mut Vec<u8>);
}

macro_rules! number {
    ($($kind:ty),*) => {$(
        impl Wire for $kind {
            const MIN_BYTES: usize = size_of::<$kind>();
            fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
                let mut bytes = [0; size_of::<$kind>()];
                bytes.copy_from_slice(input.take(size_of::<$kind>())?);
                Ok(<$kind>::from_le_bytes(bytes))
            }
            fn write(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}
number!(u8, u16, u32, u64, i64, f32, f64);

impl Wire for bool {
    const MIN_BYTES: usize = 1;
    fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
        Ok(u8::read(input)? != 0)
    }
    fn write(&self, out: &mut Vec<u8>) {
        u8::from(*self).write(out);
    }
}

fn write_count(count: usize, out: &mut Vec<u8>) {
    u32::try_from(count).expect("our own lists have fewer than 2^32 elements").write(out);
}

/// Bytes that are no UTF-8 become replacement characters: a name is for people.
impl Wire for String {
    const MIN_BYTES: usize = 4;
    fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
        let count = input.count(1)?;
        Ok(Self::from_utf8_lossy(input.take(count)?).into_owned())
    }
    fn write(&self, out: &mut Vec<u8>) {
        write_count(self.len(), out);
        out.extend_from_slice(self.as_bytes());
    }
}

impl<T: Wire + Copy + Default, const N: usize> Wire for [T; N] {
    const MIN_BYTES: usize = N * T::MIN_BYTES;
    fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
        let mut out = [T::default(); N];
        for item in &mut out {
            *item = T::read(input)?;
        }
        Ok(out)
    }
    fn write(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|item| item.write(out));
    }
}

impl<T: Wire> Wire for Vec<T> {
    const MIN_BYTES: usize = 4;
    fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
        let count = input.count(T::MIN_BYTES)?;
        (0..count).map(|_| T::read(input)).collect()
    }
    fn write(&self, out: &mut Vec<u8>) {
        write_count(self.len(), out);
        self.iter().for_each(|item| item.write(out));
    }
}

impl<T: Wire + Ord> Wire for BTreeSet<T> {
    const MIN_BYTES: usize = 4;
    fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
        let count = input.count(T::MIN_BYTES)?;
        (0..count).map(|_| T::read(input)).collect()
    }
    fn write(&self, out: &mut Vec<u8>) {
        write_count(self.len(), out);
        self.iter().for_each(|item| item.write(out));
    }
}

impl<K: Wire + Ord, V: Wire> Wire for BTreeMap<K, V> {
    const MIN_BYTES: usize = 4;
    fn read(input: &mut Input<'_>) -> Result<Self, WireError> {
        let count = input.count(K::MIN_BYTES + V::MIN_BYTES)?;
        (0..count).map(|_| Ok((K::read(input)?, V::read(input)?))).collect()
    }
    fn write(&self, out: &mut Vec<u8>) {
        write_count(self.len(), out);
        for (key, value) in self {
            key.write(out);
            value.write(out);
        }
    }
}

/// Declares a struct whose fields are written in order.
macro_rules! wire_struct {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[$doc:meta])* pub $field:ident: $kind:ty,)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct $name { $($(#[$doc])* pub $field: $kind,)* }
        impl $crate::mocap::wire::Wire for $name {
            const MIN_BYTES: usize = 0 $(+ <$kind as $crate::mocap::wire::Wire>::MIN_BYTES)*;
            fn read(
                input: &mut $crate::mocap::wire::Input<'_>,
            ) -> Result<Self, $crate::mocap::wire::WireError> {
                Ok(Self { $($field: $crate::mocap::wire::Wire::read(input)?,)* })
            }
            fn write(&self, out: &mut Vec<u8>) {
                $($crate::mocap::wire::Wire::write(&self.$field, out);)*
            }
        }
    };
}
pub(super) use wire_struct;
