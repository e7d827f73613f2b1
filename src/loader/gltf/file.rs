//! The file: its JSON, its buffers and the bytes of its images, all checked to be in range.

use super::uri::{self, Target};
use crate::error::{Error, Place, Result, counted};
use crate::loader::files::Folders;
use crate::loader::read_bytes;
use crate::memory::{Budget, Refusal, Reservation};
use crate::util::wording::quoted;
use gltf::Document;
use gltf::buffer::View;
use gltf::json::validation::{Error as Fault, Validate};
use gltf::json::{Path as JsonPath, Root};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// The extensions that a file may require.
const SUPPORTED: [&str; 8] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];
/// The greatest number of faults in an error.
const MOST_FAULTS: usize = 10;
/// The types of the chunks of a binary file: JSON and binary data. [glTF 2.0, 4.4]
const CHUNK_JSON: u32 = 0x4e4f_534a;
const CHUNK_BIN: u32 = 0x004e_4942;

/// A file whose indices are all in range.
pub struct File {
    path: PathBuf,
    /// The folders in which its other files are searched for.
    pub folders: Folders,
    /// The contents of its JSON.
    pub document: Document,
    buffers: Vec<Vec<u8>>,
    memory: Budget,
    /// The memory of the buffers.
    reserved: Vec<Reservation>,
    /// Errors for the missing files that it names.
    pub missing: Vec<Error>,
}

impl File {
    /// Reads a file and its buffers.
    ///
    /// # Errors
    /// If a file cannot be read or is malformed, requires an extension that is not supported, or has a buffer that is
    /// too short.
    pub fn open(
        path: &Path,
        search_paths: &[PathBuf],
        memory: &Budget,
        warnings: &mut Vec<Error>,
    ) -> Result<Self> {
        let (bytes, _reserved) = read_bytes(path, memory)?;
        let (json, chunk) = split(&bytes).map_err(|message| Error::scene(message).in_file(path))?;
        let root = parse(path, json)?;
        check(path, &root, warnings)?;
        let mut file = File {
            path: path.to_path_buf(),
            folders: Folders::new(path, search_paths),
            document: Document::from_json_without_validation(root),
            buffers: Vec::new(),
            memory: memory.clone(),
            reserved: Vec::new(),
            missing: Vec::new(),
        };
        file.buffers = file.read_buffers(chunk)?;
        Ok(file)
    }

    /// Creates an error about a thing in this file.
    pub fn error(&self, thing: impl Into<String>, message: impl Into<String>) -> Error {
        Error::scene(message).about(thing).in_file(&self.path)
    }

    /// Reserves memory for a thing in this file.
    ///
    /// # Errors
    /// If less memory is left.
    pub fn reserve(&self, bytes: u64, thing: &str, what: &str) -> Result<Reservation> {
        let refused = |r: Refusal| self.error(thing, r.sentence(what, "use a smaller scene"));
        self.memory.reserve(bytes).map_err(refused)
    }

    /// Reserves memory as [`reserve`](Self::reserve) does, permanently.
    ///
    /// # Errors
    /// If less memory is left.
    pub fn keep(&self, bytes: u64, thing: &str, what: &str) -> Result<()> {
        self.reserve(bytes, thing, what).map(|reserved| reserved.keep(bytes))
    }

    /// Returns the planned memory.
    pub fn memory(&self) -> &Budget {
        &self.memory
    }

    /// Returns the place that stands for the whole file.
    pub fn place(&self) -> Place {
        Place::file(&self.path)
    }

    fn read_buffers(&mut self, chunk: Option<&[u8]>) -> Result<Vec<Vec<u8>>> {
        let described = self.document.as_json().buffers.clone();
        let mut buffers = Vec::with_capacity(described.len());
        for (i, buffer) in described.into_iter().enumerate() {
            let thing = format!("buffers[{i}]");
            let bytes = match (buffer.uri, chunk) {
                (Some(uri), _) => self.fetch(&thing, &uri)?,
                (None, Some(chunk)) if i == 0 => {
                    self.reserved.push(self.reserve(chunk.len() as u64, &thing, "copying its bytes")?);
                    Some(chunk.to_vec())
                }
                (None, _) => return Err(self.error(thing, "expected a uri, or a binary chunk in the file")),
            };
            let Some(bytes) = bytes else {
                buffers.push(Vec::new());
                continue;
            };
            let (expected, found) = (buffer.byte_length.0, bytes.len() as u64);
            if found < expected {
                let expected = counted(expected, "byte", "bytes");
                return Err(self.error(thing, format!("expected {expected}, found {found}")));
            }
            buffers.push(bytes);
        }
        Ok(buffers)
    }

    /// Returns the bytes at a URI; `None` if the file is missing, which is recorded.
    fn fetch(&mut self, thing: &str, uri: &str) -> Result<Option<Vec<u8>>> {
        match uri::read(uri).map_err(|message| self.error(thing, message))? {
            Target::Data(bytes) => Ok(Some(bytes)),
            Target::File(name) => match self.folders.find(&self.path, &name) {
                Some(path) => {
                    let (bytes, reserved) = read_bytes(&path, &self.memory)?;
                    self.reserved.push(reserved);
                    Ok(Some(bytes))
                }
                None => {
                    let message = format!("there is no file {}", quoted(&name));
                    self.missing.push(self.error(thing, message));
                    Ok(None)
                }
            },
        }
    }

    /// Returns the bytes of an image; `None` if a file is missing, which is recorded.
    ///
    /// # Errors
    /// If the image has neither a URI nor a buffer view, or its bytes are out of range.
    pub fn image(&mut self, index: usize) -> Result<Option<Vec<u8>>> {
        let thing = format!("images[{index}]");
        let image = &self.document.as_json().images[index];
        if let Some(uri) = image.uri.clone() {
            return self.fetch(&thing, &uri);
        }
        let view = image.buffer_view.and_then(|view| self.document.views().nth(view.value()));
        let Some(view) = view else { return Err(self.error(thing, "expected a uri or a bufferView")) };
        if !self.missing.is_empty() {
            return Ok(None);
        }
        self.view(&view).map(|bytes| Some(bytes.to_vec()))
    }

    /// Returns the bytes of a buffer view.
    ///
    /// # Errors
    /// If the view reaches beyond its buffer.
    pub fn view(&self, view: &View<'_>) -> Result<&[u8]> {
        let buffer = &self.buffers[view.buffer().index()];
        let (offset, length) = (view.offset(), view.length());
        let bytes = buffer.get(offset..).and_then(|rest| rest.get(..length));
        bytes.ok_or_else(|| {
            let thing = format!("bufferViews[{}]", view.index());
            let message = format!(
                "expected {length} bytes from {offset} on in buffers[{}], which has {}",
                view.buffer().index(),
                buffer.len()
            );
            self.error(thing, message)
        })
    }
}

/// Splits a file into its JSON and its binary chunk. [glTF 2.0, 4.4]
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let number = |at: usize| {
        let bytes = bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        Some(u32::from_le_bytes(bytes))
    };
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    }
    let short = || format!("the file is cut short after {}", counted(bytes.len() as u64, "byte", "bytes"));
    let (version, length) = (number(4).ok_or_else(short)?, number(8).ok_or_else(short)?);
    if version != 2 {
        return Err(format!("expected version 2 of the binary format, found version {version}"));
    }
    if (bytes.len() as u64) < u64::from(length) {
        return Err(format!("the file is cut short: expected {length} bytes, found {}", bytes.len()));
    }
    let mut at = 12;
    let mut chunk = || {
        let (length, kind) = (number(at)? as usize, number(at + 4)?);
        let data = bytes.get(at + 8..)?.get(..length)?;
        at += 8 + length;
        Some((kind, data))
    };
    let Some((CHUNK_JSON, json)) = chunk() else {
        return Err("expected a whole chunk of JSON at the start of the file".to_owned());
    };
    let binary = match chunk() {
        Some((CHUNK_BIN, data)) => Some(data),
        _ => None,
    };
    Ok((json, binary))
}

fn parse(path: &Path, json: &[u8]) -> Result<Root> {
    Root::from_slice(json).map_err(|e| {
        let text = e.to_string();
        let message = text.rsplit_once(" at line ").map_or(text.as_str(), |(message, _)| message);
        let line = json.split(|b| *b == b'\n').nth(e.line().saturating_sub(1)).unwrap_or_default();
        let place = Place {
            line: e.line() as u32,
            column: e.column() as u32,
            text: shown(line, e.column()).into_owned(),
            ..Place::file(path)
        };
        Error::scene(message).at(place)
    })
}

/// Returns a line as text; the empty text if the line is too long to be shown.
fn shown(line: &[u8], column: usize) -> Cow<'_, str> {
    if line.len() > 10_000 || column > line.len() {
        return Cow::Borrowed("");
    }
    String::from_utf8_lossy(line)
}

/// Returns an error if the file cannot be used safely or requires an unsupported extension. Adds a warning for each
/// unsupported extension that it does not require.
fn check(path: &Path, root: &Root, warnings: &mut Vec<Error>) -> Result<()> {
    let version = root.asset.min_version.as_ref().unwrap_or(&root.asset.version);
    if version.split('.').next() != Some("2") {
        let message = format!("expected glTF 2.0, found version {}", quoted(version));
        return Err(Error::scene(message).about("asset").in_file(path));
    }
    let unknown = |name: &&String| !SUPPORTED.contains(&name.as_str());
    let unsupported = |name: &String, how: &str| {
        Error::scene(format!("the extension {} {how}", quoted(name))).in_file(path)
    };
    let required = root.extensions_required.iter().filter(unknown);
    let mut faults: Vec<Error> =
        required.map(|name| unsupported(name, "is required and not supported")).collect();
    // The validation of `gltf` looks up positions before it checks their index.
    let mut attributes = root.meshes.iter().flat_map(|m| &m.primitives).flat_map(|p| p.attributes.values());
    if let Some(index) = attributes.find(|index| index.value() >= root.accessors.len()) {
        let message = format!("there is no accessors[{}], which a mesh refers to", index.value());
        return Err(Error::scene(message).in_file(path));
    }
    root.validate(root, JsonPath::new, &mut |place, fault| {
        let place = place();
        if faults.len() < MOST_FAULTS && !is_harmless(place.as_str(), fault) {
            faults.push(Error::scene(words(fault)).about(place.as_str()).in_file(path));
        }
    });
    if !faults.is_empty() {
        let first = faults.remove(0);
        return Err(first.with_others(faults));
    }
    let used = root.extensions_used.iter().filter(|name| !root.extensions_required.contains(name));
    warnings.extend(used.filter(unknown).map(|name| unsupported(name, "is ignored")));
    Ok(())
}

/// Returns whether a fault is harmless here: missing positions, missing bounds of positions, and attributes with
/// unknown names. Unsupported extensions are reported elsewhere.
fn is_harmless(place: &str, fault: Fault) -> bool {
    match fault {
        Fault::Unsupported => true,
        Fault::Missing => [".min", ".max", "[\"POSITION\"]"].iter().any(|end| place.ends_with(end)),
        Fault::Invalid => place.contains(".attributes["),
        Fault::IndexOutOfBounds | Fault::Oversize => false,
    }
}

fn words(fault: Fault) -> &'static str {
    match fault {
        Fault::IndexOutOfBounds => "the index is out of range",
        Fault::Invalid => "the value is invalid",
        Fault::Missing => "it is missing",
        Fault::Oversize => "the size is too large",
        Fault::Unsupported => "it is not supported",
    }
}
