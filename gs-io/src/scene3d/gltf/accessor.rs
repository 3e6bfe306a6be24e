//! Reads the numbers of accessors as `f32`.

use super::{
    buffers::Buffers,
    document::{Accessor, BufferView, Document},
};
use crate::{
    error::Error,
    scene3d::{source::Source, values::Number},
};

/// The number type of a component by glTF's and OpenGL's code.
fn component(code: u32) -> Option<Number> {
    Some(match code {
        5120 => Number::I8,
        5121 => Number::U8,
        5122 => Number::I16,
        5123 => Number::U16,
        5126 => Number::F32,
        _ => return None,
    })
}

/// The integer that stands for 1 in an accessor of normalised integers; `None` for any other.
fn largest(accessor: &Accessor) -> Option<u16> {
    match component(accessor.component_type).filter(|_| accessor.normalized)? {
        Number::I8 => Some(127),
        Number::U8 => Some(255),
        Number::I16 => Some(32_767),
        Number::U16 => Some(65_535),
        _ => None,
    }
}

const OUTSIDE: &str = "one that points outside";

/// Reads accessors.
#[derive(Debug)]
pub(super) struct Accessors<'a> {
    pub(super) source: &'a Source<'a>,
    pub(super) document: &'a Document,
    pub(super) buffers: &'a Buffers<'a>,
}

impl Accessors<'_> {
    /// The number of rows that accessor `number` claims to have.
    pub(super) fn count(&self, number: usize) -> Result<u64, Error> {
        Ok(self.accessor(number)?.count)
    }

    /// The number of equal steps between 0 and 1 in accessor `number`; `None` for floats and
    /// integers that are not normalised.
    pub(super) fn steps(&self, number: usize) -> Result<Option<u16>, Error> {
        self.accessor(number).map(largest)
    }

    /// All rows of accessor `number`, each of N numbers; `name` is for messages.
    pub(super) fn rows<const N: usize>(&self, number: usize, name: &str) -> Result<Vec<[f32; N]>, Error> {
        let bad = |expected: &str, found: String| self.source.damaged(0, format!("{expected} in {name}"), found);
        let accessor = self.accessor(number)?;
        let wanted = match N {
            1 => "SCALAR",
            3 => "VEC3",
            _ => "VEC4",
        };
        if accessor.kind != wanted {
            return Err(bad(wanted, format!("{:?}", accessor.kind)));
        }
        let component = component(accessor.component_type)
            .ok_or_else(|| bad("a component type of at most 16 bits or float", accessor.component_type.to_string()))?;
        let Some(view) = accessor.buffer_view.filter(|_| accessor.sparse.is_none()) else {
            let what = format!("an accessor that is sparse or has no buffer, {name},");
            return Err(Error::unsupported(self.source.path, what, "export it with plain accessors"));
        };
        let (view, part) = self.view(view, name)?;
        let row_bytes = (N * component.bytes()) as u64;
        let stride = view.byte_stride.unwrap_or(row_bytes);
        if stride < row_bytes {
            return Err(bad(&format!("a stride of at least {row_bytes} bytes"), stride.to_string()));
        }
        let Some(last) = accessor.count.checked_sub(1) else { return Ok(Vec::new()) };
        let bytes = last
            .checked_mul(stride)
            .and_then(|len| len.checked_add(row_bytes))
            .and_then(|len| range(accessor.byte_offset, len))
            .and_then(|range| part.get(range))
            .ok_or_else(|| bad("an accessor within its bounds", OUTSIDE.to_owned()))?;
        let largest = largest(accessor).map(f32::from);
        let value = |bytes: &[u8]| {
            let value = component.decode::<true>(bytes) as f32;
            largest.map_or(value, |largest| (value / largest).max(-1.0))
        };
        let row = |row: &[u8]| std::array::from_fn(|k| value(&row[k * component.bytes()..]));
        Ok(bytes.chunks(stride as usize).map(row).collect())
    }

    /// A buffer view, and its bytes; `name` is for messages.
    pub(super) fn view(&self, number: usize, name: &str) -> Result<(&BufferView, &[u8]), Error> {
        let bad = |expected: &str, found: String| self.source.damaged(0, format!("{expected} in {name}"), found);
        let view = self.document.buffer_views.get(number);
        let view = view.ok_or_else(|| bad("a buffer view that there is", number.to_string()))?;
        let buffer =
            self.buffers.get(view.buffer).ok_or_else(|| bad("a buffer that there is", view.buffer.to_string()))?;
        let part = range(view.byte_offset, view.byte_length).and_then(|range| buffer.get(range));
        Ok((view, part.ok_or_else(|| bad("a buffer view within its bounds", OUTSIDE.to_owned()))?))
    }

    fn accessor(&self, number: usize) -> Result<&Accessor, Error> {
        let there = self.document.accessors.get(number);
        there.ok_or_else(|| self.source.damaged(0, "an accessor that there is", format!("accessor {number}")))
    }
}

fn range(start: u64, len: u64) -> Option<std::ops::Range<usize>> {
    let (start, len) = (usize::try_from(start).ok()?, usize::try_from(len).ok()?);
    Some(start..start.checked_add(len)?)
}
