//! The order of attributes in the header of an OpenEXR file.
//!
//! The crate `exr` keeps attributes in a hash map and writes them in an order that changes between runs. OpenEXR
//! writes them sorted by name, and so does this module.

use std::ops::Range;

/// Sorts the attributes in the header of a single-part file by name. A header that cannot be parsed is not changed.
/// The header keeps its length, so the offsets after it remain valid.
///
/// The layout of the OpenEXR file format is: magic number and version (8 bytes), then for each attribute its name, a
/// NUL, its type, a NUL, the value's size in 4 bytes and the value; then a NUL.
pub(super) fn sort_attributes(file: &mut [u8]) {
    let mut attributes: Vec<(Range<usize>, Range<usize>)> = Vec::new();
    let mut at = 8;
    while file.get(at).is_some_and(|&b| b != 0) {
        let Some((name, end)) = attribute(file, at) else { return };
        attributes.push((name, at..end));
        at = end;
    }
    attributes.sort_by(|(a, _), (b, _)| file[a.clone()].cmp(&file[b.clone()]));
    let sorted: Vec<u8> = attributes.into_iter().flat_map(|(_, whole)| file[whole].to_vec()).collect();
    if let Some(header) = file.get_mut(8..8 + sorted.len()) {
        header.copy_from_slice(&sorted);
    }
}

/// Returns the range of the name of the attribute that begins at `start`, and the attribute's end.
fn attribute(file: &[u8], start: usize) -> Option<(Range<usize>, usize)> {
    let nul = |from: usize| Some(from + file.get(from..)?.iter().position(|&b| b == 0)?);
    let name_end = nul(start)?;
    let value_size = nul(name_end + 1)? + 1;
    let size = u32::from_le_bytes(file.get(value_size..value_size + 4)?.try_into().ok()?);
    let end = value_size + 4 + usize::try_from(size).ok()?;
    (end <= file.len()).then_some((start..name_end, end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_are_sorted_and_the_rest_stays() {
        let mut file = b"magicver".to_vec();
        file.extend(b"zoom\0int\0\x04\0\0\0abcd");
        file.extend(b"a\0string\0\x00\0\0\0");
        file.extend(b"\0rest z");
        let mut expected = b"magicver".to_vec();
        expected.extend(b"a\0string\0\x00\0\0\0");
        expected.extend(b"zoom\0int\0\x04\0\0\0abcd");
        expected.extend(b"\0rest z");
        sort_attributes(&mut file);
        assert_eq!(file, expected);
    }

    #[test]
    fn what_is_not_a_header_stays() {
        for bad in [&b""[..], b"magicver", b"magicverb\0", b"magicverb\0int\0\xff\xff\xff\xff1", b"magicverb"]
        {
            let mut file = bad.to_vec();
            sort_attributes(&mut file);
            assert_eq!(file, bad);
        }
    }
}
