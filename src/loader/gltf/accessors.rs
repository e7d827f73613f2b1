//! Accessors: arrays of numbers in buffers. [glTF 2.0, 3.6]

use super::file::File;
use crate::error::{Error, Result, counted};
use gltf::accessor::sparse::IndexType;
use gltf::accessor::{Accessor, DataType, Dimensions};
use gltf::buffer::View;

/// The greatest number of elements of an accessor without a buffer view. All but a few of its elements are zero, so the
/// size of the file does not bound their number.
const MOST_ZEROS: usize = 1 << 24;

/// The conversion of integers to numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integers {
    /// Integers or fractions, as the accessor specifies.
    AsTold,
    /// Fractions of the largest integer, whatever the accessor specifies.
    Fractions,
}

impl File {
    /// Returns the elements of an accessor as `N` numbers each.
    ///
    /// # Errors
    /// If the elements have another number of components, or reach beyond their buffer view.
    pub fn numbers<const N: usize>(
        &self,
        accessor: &Accessor<'_>,
        integers: Integers,
    ) -> Result<Vec<[f32; N]>> {
        let components = accessor.dimensions().multiplicity();
        if components != N || is_matrix(accessor.dimensions()) {
            let message = format!("expected {N} components in each element, found {components}");
            return Err(self.fault(accessor, message));
        }
        let (kind, size) = (accessor.data_type(), accessor.data_type().size());
        let normalized = accessor.normalized() || integers == Integers::Fractions;
        self.elements(accessor, [0.0; N], |element| {
            std::array::from_fn(|c| number(kind, normalized, &element[c * size..][..size]))
        })
    }

    /// Returns the elements of an accessor as indices.
    ///
    /// # Errors
    /// If the elements are not single unsigned integers, or reach beyond their buffer view.
    pub fn indices(&self, accessor: &Accessor<'_>) -> Result<Vec<u32>> {
        let kind = accessor.data_type();
        let unsigned = matches!(kind, DataType::U8 | DataType::U16 | DataType::U32);
        if accessor.dimensions() != Dimensions::Scalar || !unsigned {
            return Err(self.fault(accessor, "expected single unsigned integers"));
        }
        self.elements(accessor, 0, index)
    }

    /// Returns all elements, with the sparse ones inserted.
    fn elements<T: Clone>(
        &self,
        accessor: &Accessor<'_>,
        zero: T,
        read: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>> {
        let (count, size) = (accessor.count(), accessor.size());
        let reserve = || {
            let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
            let thing = format!("accessors[{}]", accessor.index());
            self.reserve(bytes, &thing, &format!("its {}", counted(count as u64, "element", "elements")))
        };
        let _reserved;
        let mut elements: Vec<T> = match accessor.view() {
            Some(view) => {
                let slices = self.slices(accessor, &view, [accessor.offset(), count, size])?;
                _reserved = reserve()?;
                slices.map(&read).collect()
            }
            None if count > MOST_ZEROS => {
                let message =
                    format!("expected at most {MOST_ZEROS} elements without a bufferView, found {count}");
                return Err(self.fault(accessor, message));
            }
            None => {
                _reserved = reserve()?;
                vec![zero; count]
            }
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let index_size = match indices.index_type() {
                IndexType::U8 => 1,
                IndexType::U16 => 2,
                IndexType::U32 => 4,
            };
            let at = [indices.offset(), sparse.count(), index_size];
            let places = self.slices(accessor, &indices.view(), at)?.map(index);
            let of = [values.offset(), sparse.count(), size];
            let values = self.slices(accessor, &values.view(), of)?;
            for (place, value) in places.zip(values) {
                let Some(element) = elements.get_mut(place as usize) else {
                    let message = format!("a sparse index is {place}, but there are {count} elements");
                    return Err(self.fault(accessor, message));
                };
                *element = read(value);
            }
        }
        Ok(elements)
    }

    /// Returns the bytes of `count` elements of `size` bytes, from `offset` on in a view.
    fn slices<'a>(
        &'a self,
        accessor: &Accessor<'_>,
        view: &View<'_>,
        [offset, count, size]: [usize; 3],
    ) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>> {
        let bytes = self.view(view)?;
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            let message =
                format!("expected a byteStride of at least {size} in its bufferView, found {stride}");
            return Err(self.fault(accessor, message));
        }
        let spanned = match count.checked_sub(1) {
            Some(last) => last.checked_mul(stride).and_then(|n| n.checked_add(size)),
            None => Some(0),
        };
        let needed = spanned.and_then(|n| n.checked_add(offset)).unwrap_or(usize::MAX);
        if needed > bytes.len() {
            let found = counted(bytes.len() as u64, "byte", "bytes");
            let message =
                format!("it needs {needed} bytes, but its bufferViews[{}] has {found}", view.index());
            return Err(self.fault(accessor, message));
        }
        Ok((0..count).map(move |i| &bytes[offset + i * stride..][..size]))
    }

    fn fault(&self, accessor: &Accessor<'_>, message: impl Into<String>) -> Error {
        self.error(format!("accessors[{}]", accessor.index()), message)
    }
}

fn is_matrix(dimensions: Dimensions) -> bool {
    matches!(dimensions, Dimensions::Mat2 | Dimensions::Mat3 | Dimensions::Mat4)
}

/// Converts a component to a number: an integer to its value, or to a fraction of the largest integer. [glTF 2.0, 3.11]
fn number(kind: DataType, normalized: bool, bytes: &[u8]) -> f32 {
    let (value, largest) = match (kind, bytes) {
        (DataType::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
        (DataType::I8, &[a]) => (f32::from(a as i8), 127.0),
        (DataType::U8, &[a]) => (f32::from(a), 255.0),
        (DataType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32_767.0),
        (DataType::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65_535.0),
        _ => (index(bytes) as f32, u32::MAX as f32),
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

/// Reads a little-endian unsigned integer of one, two or four bytes.
fn index(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_numbers_or_fractions() {
        assert_eq!(number(DataType::U8, true, &[51]), 0.2);
        assert_eq!(number(DataType::U8, false, &[51]), 51.0);
        assert_eq!(number(DataType::I8, true, &[0x80]), -1.0);
        assert_eq!(number(DataType::I16, false, &[0xfe, 0xff]), -2.0);
        assert_eq!(number(DataType::U16, true, &[0xff, 0xff]), 1.0);
        assert_eq!(number(DataType::F32, false, &1.5f32.to_le_bytes()), 1.5);
        assert_eq!([index(&[7]), index(&[1, 2]), index(&[1, 2, 3, 4])], [7, 0x201, 0x0403_0201]);
    }
}
