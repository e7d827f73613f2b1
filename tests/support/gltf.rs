//! glTF files created in tests.

use buffon::error::Result;
use buffon::loader::{LoadOptions, Loaded, load};
use serde_json::{Value, json};
use std::io::Cursor;
use tempfile::TempDir;

/// A file under construction: its JSON and its only buffer.
#[derive(Clone)]
pub struct Model {
    /// The JSON without the buffer.
    pub json: Value,
    /// The buffer.
    pub bytes: Vec<u8>,
}

impl Model {
    /// Creates a file whose scene has these nodes. All of them are roots except the children of others.
    pub fn new(nodes: Value) -> Self {
        let list = nodes.as_array().unwrap();
        let children: Vec<u64> = list
            .iter()
            .flat_map(|node| node["children"].as_array().cloned().unwrap_or_default())
            .filter_map(|child| child.as_u64())
            .collect();
        let roots: Vec<usize> = (0..list.len()).filter(|i| !children.contains(&(*i as u64))).collect();
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": roots }], "nodes": nodes,
            "accessors": [], "bufferViews": [], "meshes": [], "materials": [], "textures": [], "images": [],
        });
        Model { json, bytes: Vec::new() }
    }

    /// Adds an entry to a list of the file and returns its index.
    pub fn add(&mut self, list: &str, entry: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().unwrap();
        list.push(entry);
        list.len() - 1
    }

    /// Adds bytes and returns the index of their buffer view.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let entry = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        self.bytes.extend_from_slice(bytes);
        self.add("bufferViews", entry)
    }

    /// Adds an accessor of floats; `kind` is, for example, `VEC3`.
    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let components = match kind {
            "SCALAR" => 1,
            kind => kind[3..].parse().unwrap(),
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(kind, 5126, &bytes, values.len() / components)
    }

    /// Adds an accessor of any component type.
    pub fn accessor(&mut self, kind: &str, component: u32, bytes: &[u8], count: usize) -> usize {
        let view = self.view(bytes);
        let entry = json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
        self.add("accessors", entry)
    }

    /// Adds a mesh of one primitive.
    pub fn mesh(&mut self, primitive: Value) -> usize {
        self.add("meshes", json!({ "primitives": [primitive] }))
    }

    /// Adds a square from (-1, -1) to (1, 1) that faces +z, with v downwards, and returns its primitive.
    pub fn square(&mut self) -> Value {
        let positions = self.floats("VEC3", &[-1., -1., 0., 1., -1., 0., 1., 1., 0., -1., 1., 0.]);
        let uvs = self.floats("VEC2", &[0., 1., 1., 1., 1., 0., 0., 0.]);
        let indices = self.accessor("SCALAR", 5121, &[0, 1, 2, 0, 2, 3], 6);
        json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "indices": indices })
    }

    /// Adds an image with alpha as a PNG inside the buffer, and a texture of it.
    pub fn texture(&mut self, width: u32, pixels: &[[u8; 4]], sampler: Value) -> usize {
        let view = self.view(&png(width, pixels));
        let image = self.add("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        let sampler = self.add("samplers", sampler);
        self.add("textures", json!({ "source": image, "sampler": sampler }))
    }

    /// Returns the file as text, with its buffer inside.
    pub fn text(&self) -> String {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bytes.len(), "uri": data_uri(&self.bytes) }]);
        serde_json::to_string_pretty(&json).unwrap()
    }

    /// Returns the binary file.
    pub fn binary(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        let chunk = |kind: &[u8; 4], data: &[u8], filler: u8| {
            let mut data = data.to_vec();
            data.resize(data.len().next_multiple_of(4), filler);
            [&(data.len() as u32).to_le_bytes(), kind, data.as_slice()].concat()
        };
        let json = chunk(b"JSON", json.to_string().as_bytes(), b' ');
        let body = [json, chunk(b"BIN\0", &self.bytes, 0)].concat();
        let head = [2, body.len() as u32 + 12].map(u32::to_le_bytes).concat();
        [b"glTF".as_slice(), &head, &body].concat()
    }

    /// Loads the text.
    pub fn load(&self) -> Result<Loaded> {
        load_bytes("scene.gltf", self.text().as_bytes())
    }

    /// Loads the text, and asserts that there are no warnings.
    pub fn loaded(&self) -> Loaded {
        let loaded = self.load().unwrap_or_else(|e| panic!("{e}"));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        loaded
    }

    /// Returns the loader's error about the text.
    pub fn error(&self) -> String {
        self.load().map(|_| ()).unwrap_err().to_string()
    }
}

/// Loads the bytes of a file. Errors name it without its folder.
pub fn load_bytes(name: &str, bytes: &[u8]) -> Result<Loaded> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load(&path, &LoadOptions::default()).map_err(|mut error| {
        for error in std::iter::once(&mut error.place).chain(error.others.iter_mut().map(|e| &mut e.place)) {
            let place = error.as_mut().unwrap();
            place.file = place.file.file_name().unwrap().into();
        }
        error
    })
}

/// Returns a PNG of pixels with alpha.
pub fn png(width: u32, pixels: &[[u8; 4]]) -> Vec<u8> {
    let picture = image::RgbaImage::from_raw(width, pixels.len() as u32 / width, pixels.concat()).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Returns bytes in base 64 as a data URI.
pub fn data_uri(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::from("data:application/octet-stream;base64,");
    for three in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, i| bits << 8 | u32::from(three.get(i).copied().unwrap_or(0)));
        for digit in 0..4 {
            let value = bits >> (18 - 6 * digit) & 63;
            text.push(if digit <= three.len() { char::from(DIGITS[value as usize]) } else { '=' });
        }
    }
    text
}
