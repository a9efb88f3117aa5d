//! The datagram.

use crate::mocap::wire::{Input, Wire as _, WireError};

/// Bytes of an object's name, padded with zeros.
pub const NAME_BYTES: usize = 24;
const ITEM_BYTES: u16 = 72;
/// Item id of an object.
const OBJECT: u8 = 0;
/// Sizes that Tracker can send, each padded with zeros.
const SIZES: [usize; 3] = [256, 512, 1024];
/// Objects that the largest size has room for.
pub const MOST_OBJECTS: usize = 13;

/// One frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Datagram {
    /// Frame number.
    pub frame_number: u32,
    /// The objects.
    pub objects: Vec<Object>,
}

/// One object.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Object {
    /// Name.
    pub name: String,
    /// Millimetres.
    pub position_mm: [f64; 3],
    /// Angles about the moving x, then y, then z axis, radians.
    pub euler_xyz: [f64; 3],
}

impl Datagram {
    /// Reads a datagram; items of other kinds are skipped.
    ///
    /// # Errors
    /// It ends inside an item, or an object is shorter than an object.
    pub fn parse(bytes: &[u8]) -> Result<Self, WireError> {
        let mut input = Input::new(bytes);
        let frame_number = u32::read(&mut input)?;
        let items = u8::read(&mut input)?;
        let mut objects = Vec::new();
        for _ in 0..items {
            let id = u8::read(&mut input)?;
            let size = u16::read(&mut input)?;
            let mut item = Input::new(input.take(usize::from(size))?);
            if id != OBJECT {
                continue;
            }
            let name = item.take(NAME_BYTES)?;
            let end = name.iter().position(|byte| *byte == 0).unwrap_or(NAME_BYTES);
            objects.push(Object {
                name: String::from_utf8_lossy(&name[..end]).into_owned(),
                position_mm: <[f64; 3]>::read(&mut item)?,
                euler_xyz: <[f64; 3]>::read(&mut item)?,
            });
        }
        Ok(Self { frame_number, objects })
    }

    /// The bytes, padded to the smallest of Tracker's sizes that holds them. Names beyond [`NAME_BYTES`] are cut, objects
    /// beyond [`MOST_OBJECTS`] left out.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let objects = &self.objects[..self.objects.len().min(MOST_OBJECTS)];
        let mut bytes = Vec::with_capacity(SIZES[2]);
        self.frame_number.write(&mut bytes);
        (objects.len() as u8).write(&mut bytes);
        for object in objects {
            OBJECT.write(&mut bytes);
            ITEM_BYTES.write(&mut bytes);
            let mut name = [0; NAME_BYTES];
            name.iter_mut().zip(object.name.bytes()).for_each(|(to, from)| *to = from);
            bytes.extend_from_slice(&name);
            object.position_mm.write(&mut bytes);
            object.euler_xyz.write(&mut bytes);
        }
        let size = SIZES.into_iter().find(|size| bytes.len() <= *size);
        bytes.resize(size.unwrap_or(bytes.len()), 0);
        bytes
    }
}
