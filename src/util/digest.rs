//! Hashes of data that stay the same from release to release.

use postcard::ser_flavors::Flavor;
use serde::Serialize;
use xxhash_rust::xxh3::Xxh3;

/// Returns the hash of a value: XXH3 with 64 bits and seed 0 over the value's postcard encoding.
///
/// Both are specified, so that a hash in a file means the same in every build. Every field counts that is not marked
/// `#[serde(skip)]`; lengths and the variants of enums are encoded, too, so that no two values have the same encoding.
///
/// # Panics
/// If the value has a sequence of unknown length; no type of the crate has one.
pub fn digest(value: &(impl Serialize + ?Sized)) -> u64 {
    postcard::serialize_with_flavor(value, Hashing(Xxh3::new())).expect("a value with known lengths")
}

/// Hashes the bytes of an encoding instead of keeping them.
struct Hashing(Xxh3);

impl Flavor for Hashing {
    type Output = u64;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.0.update(&[byte]);
        Ok(())
    }

    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.0.update(bytes);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<u64> {
        Ok(self.0.digest())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_specification() {
        // The digest of no bytes from the specification of XXH3.
        assert_eq!(digest(&()), 0x2d06_8005_38d3_94c2);
        // An encoding: length 3, then the bytes.
        assert_eq!(digest("abc"), xxhash_rust::xxh3::xxh3_64(&[3, b'a', b'b', b'c']));
        assert_eq!(digest(&[1.0f32, -2.5]), xxhash_rust::xxh3::xxh3_64(&[0, 0, 128, 63, 0, 0, 32, 192]));
    }

    #[test]
    fn neighbouring_values_do_not_run_together() {
        assert_ne!(digest(&("ab", "c")), digest(&("a", "bc")));
        assert_ne!(digest(&[Some(0u32), None]), digest(&[None, Some(0u32)]));
        assert_ne!(digest(&0.0f32), digest(&-0.0f32));
    }
}
