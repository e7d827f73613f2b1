//! Files of measured materials, in the format of the RGL database.

use crate::bsdf::Measured;
use crate::bsdf::measured::{Table, Tables};
use crate::error::{Error, Result};
use crate::memory::Budget;
use std::path::Path;

/// The start of a file: an identifier and the version.
const MAGIC: &[u8] = b"tensor_file\0\x01\x00";

/// An array in a file.
struct Field<'a> {
    shape: Vec<usize>,
    /// The code of the type of its elements.
    kind: u8,
    /// The bytes from its first element to the end of the file.
    bytes: &'a [u8],
}

/// Codes of types.
const UINT8: u8 = 1;
const FLOAT32: u8 = 10;

impl Field<'_> {
    fn len(&self) -> Option<usize> {
        self.shape.iter().try_fold(1usize, |product, n| product.checked_mul(*n))
    }

    fn floats(&self, name: &str, dimensions: usize) -> Result<Vec<f32>, String> {
        let bytes = self.len().and_then(|n| n.checked_mul(4)).and_then(|n| self.bytes.get(..n));
        match bytes {
            Some(bytes) if self.kind == FLOAT32 && self.shape.len() == dimensions => {
                Ok(bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
            }
            _ => Err(format!(
                "expected the field {name} to be an array of float32 with {dimensions} dimensions"
            )),
        }
    }

    /// Returns a table of slices, whose last dimensions are rows and columns.
    fn table(&self, name: &str, dimensions: usize) -> Result<Table, String> {
        let values = self.floats(name, dimensions)?;
        let [height, width] = [2, 1].map(|i| self.shape[dimensions - i]);
        let slices = self.shape[..dimensions - 2].iter().product();
        Table::new(width, height, slices, values).map_err(|e| format!("{name}: {}", e.message))
    }
}

/// Reads the fields of a file.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let bytes = self.slice(N)?;
        Ok(bytes.try_into().expect("as many bytes as were taken"))
    }

    fn slice(&mut self, count: usize) -> Result<&'a [u8], String> {
        let bytes = self.at.checked_add(count).and_then(|end| self.bytes.get(self.at..end));
        self.at = self.at.saturating_add(count);
        bytes.ok_or_else(|| "the list of fields ends early".to_owned())
    }

    fn field(&mut self) -> Result<(&'a str, Field<'a>), String> {
        let length = u16::from_le_bytes(self.take()?);
        let name =
            std::str::from_utf8(self.slice(length.into())?).map_err(|_| "a name of a field is not text")?;
        let dimensions = u16::from_le_bytes(self.take()?);
        let [kind] = self.take()?;
        let offset = u64::from_le_bytes(self.take()?) as usize;
        let shape = (0..dimensions).map(|_| Ok(u64::from_le_bytes(self.take()?) as usize));
        let shape = shape.collect::<Result<_, String>>()?;
        let bytes = self.bytes.get(offset..).ok_or_else(|| format!("the field {name} is beyond the end"))?;
        Ok((name, Field { shape, kind, bytes }))
    }
}

/// Reads a measured material.
///
/// # Errors
/// If the file cannot be read, is malformed, has no channels of linear sRGB, or needs more memory than is left.
pub fn load(path: &Path, memory: &Budget) -> Result<Measured> {
    let (bytes, _reserved) = super::read_bytes(path, memory)?;
    let wrong = |message: String| Error::scene(message).in_file(path);
    // Each density has a distribution function, too.
    let planned = memory
        .reserve(2 * bytes.len() as u64)
        .map_err(|refusal| wrong(refusal.sentence("its tables", "use a smaller file")))?;
    let measured = parse(&bytes).map_err(wrong)?;
    planned.keep(measured.memory_bytes() as u64);
    Ok(measured)
}

fn parse(bytes: &[u8]) -> Result<Measured, String> {
    if !bytes.starts_with(MAGIC) {
        return Err("expected a file that begins with tensor_file and the version 1.0".into());
    }
    let mut reader = Reader { bytes, at: MAGIC.len() };
    let count = u32::from_le_bytes(reader.take()?);
    let fields: Vec<_> = (0..count).map(|_| reader.field()).collect::<Result<_, _>>()?;
    let find = |name: &str| fields.iter().find(|(found, _)| *found == name).map(|(_, field)| field);
    let field = |name: &str| find(name).ok_or_else(|| format!("the field {name} is missing"));
    if find("rgb").is_none() && find("spectra").is_some() {
        return Err(
            "the file has spectra and no channels of RGB: use the file of this material for RGB".into()
        );
    }
    let jacobian = field("jacobian")?;
    let (UINT8, [1], [jacobian, ..]) = (jacobian.kind, &jacobian.shape[..], jacobian.bytes) else {
        return Err("expected the field jacobian to be an array of one uint8".into());
    };
    let tables = Tables {
        phi: field("phi_i")?.floats("phi_i", 1)?,
        theta: field("theta_i")?.floats("theta_i", 1)?,
        ndf: field("ndf")?.table("ndf", 2)?,
        sigma: field("sigma")?.table("sigma", 2)?,
        vndf: field("vndf")?.table("vndf", 4)?,
        luminance: field("luminance")?.table("luminance", 4)?,
        channels: field("rgb")?.table("rgb", 5)?,
        jacobian: *jacobian != 0,
    };
    Measured::new(tables).map_err(|e| e.message)
}
