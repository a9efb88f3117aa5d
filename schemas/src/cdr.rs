//! CDR, the byte layout of ROS 2 messages (OMG CDR version 1, "XCDR1").
//!
//! A message is a 4-byte header (representation, options) and the fields in order; each number stands at a multiple of
//! its own size, counted from after the header. Strings carry their length with the closing zero, sequences their
//! element count. This writer always writes little endian; the reader takes both.

/// Bytes of the representation header before the first field.
pub const HEADER_BYTES: usize = 4;
const LITTLE_ENDIAN_HEADER: [u8; HEADER_BYTES] = [0, 1, 0, 0];

/// Why bytes are not the expected message. Offsets count from the start of the message, header included.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The message ends inside a field.
    #[error("message of {len} bytes ends too early: {needed} bytes wanted at offset {offset}")]
    Truncated {
        /// Where the field starts.
        offset: usize,
        /// Bytes the field needs.
        needed: usize,
        /// Bytes the message has.
        len: usize,
    },
    /// The header names a representation other than plain CDR version 1.
    #[error("representation 0x{0:04x} is not plain CDR (0x0000 or 0x0001)")]
    Representation(u16),
    /// A sequence or string claims more elements than the rest of the message can hold.
    #[error("sequence at offset {offset} claims {count} elements, {left} bytes are left")]
    Length {
        /// Where the count stands.
        offset: usize,
        /// The claimed count.
        count: usize,
        /// Bytes left after the count.
        left: usize,
    },
    /// A string is not UTF-8 or lacks its closing zero.
    #[error("string at offset {0} is not zero-terminated UTF-8")]
    Text(usize),
    /// A boolean byte is neither 0 nor 1.
    #[error("boolean at offset {offset} is {value}")]
    Bool {
        /// Where the byte stands.
        offset: usize,
        /// Its value.
        value: u8,
    },
}

/// Builds one message.
#[derive(Debug)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// Starts a message; `capacity` is the expected size in bytes.
    #[must_use]
    pub fn with_capacity(capacity: usize) -> Self {
        let mut bytes = Vec::with_capacity(capacity + HEADER_BYTES);
        bytes.extend_from_slice(&LITTLE_ENDIAN_HEADER);
        Self { bytes }
    }

    /// The finished message, header included.
    #[must_use]
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn align(&mut self, size: usize) {
        let body = self.bytes.len() - HEADER_BYTES;
        self.bytes.resize(HEADER_BYTES + body.next_multiple_of(size), 0);
    }

    /// Writes a sequence's element count.
    ///
    /// # Panics
    /// If the sequence has 2^32 elements or more, which no caller can build from a log.
    pub fn count(&mut self, count: usize) {
        let count = u32::try_from(count).expect("a CDR sequence has fewer than 2^32 elements");
        count.write(self);
    }
}

/// Takes one message apart, never reading or allocating beyond its bytes.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Reader<'a> {
    /// Reads the header.
    ///
    /// # Errors
    /// Fewer than four bytes, or a representation other than plain CDR.
    pub fn new(bytes: &'a [u8]) -> Result<Self, CdrError> {
        let header = bytes.get(..HEADER_BYTES).ok_or(CdrError::Truncated {
            offset: 0,
            needed: HEADER_BYTES,
            len: bytes.len(),
        })?;
        match u16::from_be_bytes([header[0], header[1]]) {
            kind @ (0 | 1) => Ok(Self { bytes, at: HEADER_BYTES, big_endian: kind == 0 }),
            kind => Err(CdrError::Representation(kind)),
        }
    }

    /// The next `len` raw bytes.
    ///
    /// # Errors
    /// The message ends before.
    pub fn take(&mut self, len: usize) -> Result<&'a [u8], CdrError> {
        let truncated = CdrError::Truncated { offset: self.at, needed: len, len: self.bytes.len() };
        let end = self.at.checked_add(len).ok_or(truncated.clone())?;
        let slice = self.bytes.get(self.at..end).ok_or(truncated)?;
        self.at = end;
        Ok(slice)
    }

    /// A number of `N` bytes at its alignment, as little-endian bytes.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        self.at = HEADER_BYTES + (self.at - HEADER_BYTES).next_multiple_of(N);
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        if self.big_endian {
            out.reverse();
        }
        Ok(out)
    }

    /// A sequence's element count, checked against the bytes left so that a hostile count allocates nothing.
    ///
    /// # Errors
    /// The count needs more bytes than are left.
    pub fn count(&mut self, min_element_bytes: usize) -> Result<usize, CdrError> {
        let count = u32::read(self)? as usize;
        let left = self.bytes.len() - self.at;
        if count.saturating_mul(min_element_bytes) > left {
            return Err(CdrError::Length { offset: self.at - 4, count, left });
        }
        Ok(count)
    }

    /// A sequence of bytes, borrowed from the message.
    ///
    /// # Errors
    /// The message ends before.
    pub fn byte_sequence(&mut self) -> Result<&'a [u8], CdrError> {
        let count = self.count(1)?;
        self.take(count)
    }
}

/// A value with a CDR layout. `'a` is the life of the bytes that a read value may borrow from.
pub trait Cdr<'a>: Sized {
    /// The fewest bytes that any value takes, at least 1: bounds hostile sequence counts.
    const MIN_BYTES: usize;
    /// Appends the value.
    fn write(&self, writer: &mut Writer);
    /// Reads the next value.
    ///
    /// # Errors
    /// The bytes are no such value.
    fn read(reader: &mut Reader<'a>) -> Result<Self, CdrError>;
}

macro_rules! number {
    ($($kind:ty),*) => {$(
        impl Cdr<'_> for $kind {
            const MIN_BYTES: usize = size_of::<$kind>();
            fn write(&self, writer: &mut Writer) {
                writer.align(size_of::<$kind>());
                writer.bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn read(reader: &mut Reader<'_>) -> Result<Self, CdrError> {
                Ok(<$kind>::from_le_bytes(reader.number()?))
            }
        }
    )*};
}
number!(u8, u16, u32, u64, i8, i16, i32, i64, f32, f64);

impl Cdr<'_> for bool {
    const MIN_BYTES: usize = 1;
    fn write(&self, writer: &mut Writer) {
        u8::from(*self).write(writer);
    }
    fn read(reader: &mut Reader<'_>) -> Result<Self, CdrError> {
        let offset = reader.at;
        match u8::read(reader)? {
            0 => Ok(false),
            1 => Ok(true),
            value => Err(CdrError::Bool { offset, value }),
        }
    }
}

impl Cdr<'_> for String {
    const MIN_BYTES: usize = 4;
    fn write(&self, writer: &mut Writer) {
        writer.count(self.len() + 1);
        writer.bytes.extend_from_slice(self.as_bytes());
        writer.bytes.push(0);
    }
    fn read(reader: &mut Reader<'_>) -> Result<Self, CdrError> {
        let bytes = reader.byte_sequence()?;
        let offset = reader.at - bytes.len();
        // Some writers send an empty string as length 0, without the closing zero.
        let text = match bytes {
            [] => bytes,
            [text @ .., 0] => text,
            _ => return Err(CdrError::Text(offset)),
        };
        std::str::from_utf8(text).map(str::to_owned).map_err(|_| CdrError::Text(offset))
    }
}

impl<'a, T: Cdr<'a> + Copy + Default, const N: usize> Cdr<'a> for [T; N] {
    const MIN_BYTES: usize = N * T::MIN_BYTES;
    fn write(&self, writer: &mut Writer) {
        self.iter().for_each(|item| item.write(writer));
    }
    fn read(reader: &mut Reader<'a>) -> Result<Self, CdrError> {
        let mut out = [T::default(); N];
        for item in &mut out {
            *item = T::read(reader)?;
        }
        Ok(out)
    }
}

impl<'a, T: Cdr<'a>> Cdr<'a> for Vec<T> {
    const MIN_BYTES: usize = 4;
    fn write(&self, writer: &mut Writer) {
        writer.count(self.len());
        self.iter().for_each(|item| item.write(writer));
    }
    fn read(reader: &mut Reader<'a>) -> Result<Self, CdrError> {
        let count = reader.count(T::MIN_BYTES)?;
        (0..count).map(|_| T::read(reader)).collect()
    }
}

/// Pixel data: copied once when written, not at all when read.
impl<'a> Cdr<'a> for std::borrow::Cow<'a, [u8]> {
    const MIN_BYTES: usize = 4;
    fn write(&self, writer: &mut Writer) {
        writer.count(self.len());
        writer.bytes.extend_from_slice(self);
    }
    fn read(reader: &mut Reader<'a>) -> Result<Self, CdrError> {
        reader.byte_sequence().map(std::borrow::Cow::Borrowed)
    }
}
