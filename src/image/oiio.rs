//! Image files and comparison with OpenImageIO, through the C shim of `buffon-oiio-sys`.

use std::ffi::{CStr, CString, c_char};
use std::marker::PhantomData;
use std::path::Path;
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicUsize, Ordering};

use buffon_oiio_sys as sys;

use super::format::{Difference, ExrOutput, Format, ImagePart, MAX_VALUES, preserved_metadata};
use super::srgb::{BytePixels, Raster, StoredPixels, StoredSamples};
use super::{Compression, Image, Metadata, SampleFormat, Value};

/// Buffon's names of metadata for which OpenImageIO has different names.
const NAMES: [(&str, &str); 4] = [
    ("worldToCamera", "worldtocamera"),
    ("worldToNDC", "worldtoNDC"),
    ("comments", "ImageDescription"),
    ("owner", "Copyright"),
];

/// Threads of the library; 0 = as many as there are cores.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// The functions of the library, which the first call loads.
fn library() -> Result<&'static sys::Functions, &'static str> {
    sys::functions(|library| limit_threads(library, THREADS.load(Ordering::Relaxed)))
}

/// Returns whether the library can be used; loads it.
pub(super) fn can_load() -> bool {
    library().is_ok()
}

/// Returns why the library could not be loaded, if that was tried.
pub(super) fn load_error() -> Option<&'static str> {
    sys::load_error()
}

fn limit_threads(library: &sys::Functions, threads: usize) {
    // SAFETY: takes a number; the library guards its own settings by a lock.
    unsafe { library.buffon_oiio_set_threads(threads.try_into().unwrap_or(i32::MAX)) }
}

/// Limits the library's threads, also if it is loaded later; 0 = as many as there are cores.
pub(super) fn set_threads(threads: usize) {
    THREADS.store(threads, Ordering::Relaxed);
    if let Some(library) = sys::loaded() {
        limit_threads(library, threads);
    }
}

/// A buffer for the message of a failed call.
struct Message([c_char; 1024]);

impl Message {
    fn new() -> Self {
        Message([0; 1024])
    }

    fn buffer(&mut self) -> (*mut c_char, usize) {
        (self.0.as_mut_ptr(), self.0.len())
    }

    /// Returns the library's message.
    fn text(&self) -> String {
        let bytes: Vec<u8> = self.0.iter().take_while(|&&c| c != 0).map(|&c| c as u8).collect();
        let text = String::from_utf8_lossy(&bytes).trim().replace('\n', "; ");
        if text.is_empty() { "OpenImageIO reported no reason".into() } else { text }
    }
}

/// Converts a path for the library.
fn c_path(path: &Path) -> Result<CString, String> {
    #[cfg(unix)]
    let bytes = std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str());
    #[cfg(not(unix))]
    let bytes = path.to_str().ok_or("the name is not Unicode")?.as_bytes();
    c_text(bytes)
}

/// Appends a NUL to the bytes.
fn c_text(bytes: impl AsRef<[u8]>) -> Result<CString, String> {
    CString::new(bytes.as_ref())
        .map_err(|e| format!("expected text without NUL, found {:?}", String::from_utf8_lossy(&e.into_vec())))
}

/// Returns the library's name of a format.
fn format_name(format: Format) -> &'static CStr {
    match format {
        Format::OpenExr => c"openexr",
        Format::Png => c"png",
        Format::Jpeg => c"jpeg",
        Format::Bmp => c"bmp",
        Format::Tga => c"targa",
        Format::Hdr => c"hdr",
        Format::Pfm | Format::Npy => unreachable!("these files are read and written without a library"),
    }
}

/// An open file, on disk or in bytes that are borrowed for `'a`; the only owner of the shim's reader.
struct OiioReader<'a> {
    library: &'static sys::Functions,
    reader: NonNull<sys::BuffonOiioReader>,
    bytes: PhantomData<&'a [u8]>,
}

impl Drop for OiioReader<'_> {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `buffon_oiio_open` or `buffon_oiio_open_memory`, this is its only owner and
        // gives it up here.
        unsafe { self.library.buffon_oiio_close(self.reader.as_ptr()) }
    }
}

impl<'a> OiioReader<'a> {
    fn open(path: &Path, format: Format) -> Result<Self, String> {
        let (library, path, mut message) = (library()?, c_path(path)?, Message::new());
        let (buffer, size) = message.buffer();
        // SAFETY: both names end with a NUL, and `size` bytes of `buffer` are ours to write.
        let reader =
            unsafe { library.buffon_oiio_open(path.as_ptr(), format_name(format).as_ptr(), buffer, size) };
        let reader = NonNull::new(reader).ok_or_else(|| message.text())?;
        Ok(OiioReader { library, reader, bytes: PhantomData })
    }

    /// Opens a file in memory.
    fn open_memory(bytes: &'a [u8], format: Format) -> Result<Self, String> {
        let (library, mut message) = (library()?, Message::new());
        let (buffer, size) = message.buffer();
        let (data, length, name) = (bytes.as_ptr(), bytes.len(), format_name(format).as_ptr());
        // SAFETY: `data` are `length` bytes, which the reader only reads and which live as long as it does (`'a`); the
        // name ends with a NUL, and `size` bytes of `buffer` are ours to write.
        let reader = unsafe { library.buffon_oiio_open_memory(data, length, name, buffer, size) };
        let reader = NonNull::new(reader).ok_or_else(|| message.text())?;
        Ok(OiioReader { library, reader, bytes: PhantomData })
    }

    /// Selects a part; `None` after the last.
    fn part(&mut self, index: i32) -> Result<Option<sys::BuffonOiioPart>, String> {
        let mut message = Message::new();
        let (buffer, size) = message.buffer();
        let mut part = sys::BuffonOiioPart {
            width: 0,
            height: 0,
            channels: 0,
            sample: 0,
            deep: 0,
            attributes: 0,
            name: ptr::null(),
        };
        // SAFETY: the reader is open, `part` and `size` bytes of `buffer` are ours to write.
        match unsafe { self.library.buffon_oiio_part(self.reader.as_ptr(), index, &mut part, buffer, size) } {
            0 if message.0[0] == 0 => Ok(None),
            0 => Err(message.text()),
            _ => Ok(Some(part)),
        }
    }

    /// Returns the names of the current part's channels.
    fn channels(&self, count: i32) -> Vec<String> {
        (0..count)
            .map(|c| {
                // SAFETY: the reader is open; a name that is not null lives until the next `part`.
                unsafe { text(self.library.buffon_oiio_channel(self.reader.as_ptr(), c)) }
            })
            .collect()
    }

    /// Returns the metadata of the current part.
    fn metadata(&self, count: usize) -> Metadata {
        let mut metadata = Metadata::new();
        for index in 0..count {
            let mut a = attribute(ptr::null());
            // SAFETY: the reader is open and `a` is ours to write.
            if unsafe { self.library.buffon_oiio_attribute(self.reader.as_ptr(), index, &mut a) } == 0 {
                continue;
            }
            let value = match a.kind as u32 {
                sys::BUFFON_OIIO_INT => Value::Int(a.integer),
                sys::BUFFON_OIIO_FLOAT => Value::Float(a.number),
                // SAFETY: of this kind the text is set, and it lives as long as the reader's part.
                sys::BUFFON_OIIO_TEXT => Value::Text(unsafe { text(a.text) }),
                _ => Value::Matrix(a.matrix),
            };
            // SAFETY: the name is set on success and lives as long as the reader's part.
            let theirs = unsafe { text(a.name) };
            let ours =
                NAMES.iter().find(|(_, name)| *name == theirs).map_or(theirs.as_str(), |(name, _)| name);
            metadata.set(ours, value);
        }
        preserved_metadata(metadata)
    }

    /// Reads the pixels of the current part.
    fn pixels(&mut self, part: &sys::BuffonOiioPart) -> Result<Vec<f32>, String> {
        let mut data = vec![0.0f32; values(part, MAX_VALUES)?];
        let mut message = Message::new();
        let (buffer, size) = message.buffer();
        // SAFETY: the reader is open; `data` has the length given, which the shim checks against the part;
        // `size` bytes of `buffer` are ours to write.
        let done = unsafe {
            self.library.buffon_oiio_read(self.reader.as_ptr(), data.as_mut_ptr(), data.len(), buffer, size)
        };
        if done == 0 { Err(message.text()) } else { Ok(data) }
    }

    /// Reads the samples of the current part as stored, or as floats if they are not integers of 8 or 16 bits.
    fn samples(&mut self, part: &sys::BuffonOiioPart, most: u64) -> Result<StoredSamples, String> {
        let (count, mut message) = (values(part, most)?, Message::new());
        let (buffer, size) = message.buffer();
        let (library, reader) = (self.library, self.reader.as_ptr());
        let (samples, done) = match part.sample as u32 {
            sys::BUFFON_OIIO_SAMPLE_BYTE => {
                let mut bytes = vec![0u8; count];
                // SAFETY: the reader is open; `bytes` has `count` numbers of the type given by the sample's kind, and
                // the shim checks both against the part; `size` bytes of `buffer` are writable.
                let done = unsafe {
                    let to = bytes.as_mut_ptr().cast();
                    library.buffon_oiio_read_codes(reader, part.sample, to, count, buffer, size)
                };
                (StoredSamples::Bytes(bytes), done)
            }
            sys::BUFFON_OIIO_SAMPLE_SHORT => {
                let mut shorts = vec![0u16; count];
                // SAFETY: as above.
                let done = unsafe {
                    let to = shorts.as_mut_ptr().cast();
                    library.buffon_oiio_read_codes(reader, part.sample, to, count, buffer, size)
                };
                (StoredSamples::Shorts(shorts), done)
            }
            _ => return self.pixels(part).map(StoredSamples::Floats),
        };
        if done == 0 { Err(message.text()) } else { Ok(samples) }
    }
}

/// Returns the number of values in a part, which must be at least one and at most `most`.
fn values(part: &sys::BuffonOiioPart, most: u64) -> Result<usize, String> {
    let sides = [part.width, part.height, part.channels].map(|n| u64::try_from(n).unwrap_or(0));
    let values = sides.iter().fold(1u64, |product, n| product.saturating_mul(*n));
    if values == 0 || values > most {
        return Err(format!("expected at least one and at most {most} values, found {values}"));
    }
    Ok(values as usize)
}

/// Copies a C string; empty for null.
///
/// # Safety
/// `text` is null or points to bytes that end with a NUL.
unsafe fn text(text: *const c_char) -> String {
    match text.is_null() {
        true => String::new(),
        // SAFETY: not null; the caller guarantees the rest.
        false => unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned(),
    }
}

/// Creates an attribute with only a name.
fn attribute(name: *const c_char) -> sys::BuffonOiioAttribute {
    let kind = sys::BUFFON_OIIO_INT as i32;
    sys::BuffonOiioAttribute { name, kind, integer: 0, number: 0.0, text: ptr::null(), matrix: [0.0; 16] }
}

/// Reads all parts of an OpenEXR file.
pub(super) fn read_exr(path: &Path) -> Result<Vec<ImagePart>, String> {
    let mut reader = OiioReader::open(path, Format::OpenExr)?;
    let mut parts = Vec::new();
    while let Some(part) = reader.part(parts.len() as i32)? {
        if part.deep != 0 {
            return Err("deep images are not supported".into());
        }
        // SAFETY: the name lives until the next call of `part`.
        let name = unsafe { text(part.name) };
        let (channels, metadata) = (reader.channels(part.channels), reader.metadata(part.attributes));
        let data = reader.pixels(&part)?;
        let (width, height) = (part.width as usize, part.height as usize);
        parts.push(ImagePart { name, image: Image { width, height, channels, data, metadata } });
    }
    Ok(parts)
}

/// Reads the samples of a PNG, JPEG, BMP, TGA or HDR file.
pub(super) fn read_raster(path: &Path, format: Format) -> Result<Raster, String> {
    read_stored(path, format, MAX_VALUES).map(Raster::from)
}

/// Reads the stored samples of a PNG, JPEG, BMP, TGA or HDR file, if there are at most `most`.
pub(super) fn read_stored(path: &Path, format: Format, most: u64) -> Result<StoredPixels, String> {
    stored(OiioReader::open(path, format)?, most)
}

/// Decodes a file in memory as [`read_stored`] does.
pub(super) fn decode_stored(bytes: &[u8], format: Format, most: u64) -> Result<StoredPixels, String> {
    stored(OiioReader::open_memory(bytes, format)?, most)
}

/// Reads the samples of an open file's first part.
fn stored(mut reader: OiioReader<'_>, most: u64) -> Result<StoredPixels, String> {
    let part = reader.part(0)?.ok_or("expected an image in the file, found none")?;
    if !(1..=4).contains(&part.channels) {
        return Err(format!("expected 1 to 4 channels, found {}", part.channels));
    }
    let samples = reader.samples(&part, most)?;
    let (width, height) = (part.width as usize, part.height as usize);
    Ok(StoredPixels { width, height, channels: part.channels as usize, samples })
}

/// Strings and attributes in the library's representation; the attributes point into the strings.
struct OiioAttributes {
    list: Vec<sys::BuffonOiioAttribute>,
    _strings: Vec<CString>,
}

impl OiioAttributes {
    fn of(metadata: &Metadata) -> Result<Self, String> {
        let (mut list, mut strings) = (Vec::new(), Vec::new());
        for (name, value) in metadata.iter() {
            let theirs = NAMES.iter().find(|(ours, _)| *ours == name).map_or(name, |(_, theirs)| theirs);
            // The bytes of a CString do not move with the CString.
            let name = c_text(theirs)?;
            let mut a = attribute(name.as_ptr());
            strings.push(name);
            match value {
                Value::Int(value) => a.integer = *value,
                Value::Float(value) => (a.kind, a.number) = (sys::BUFFON_OIIO_FLOAT as i32, *value),
                Value::Matrix(value) => (a.kind, a.matrix) = (sys::BUFFON_OIIO_MATRIX as i32, *value),
                Value::Text(value) => {
                    let value = c_text(value)?;
                    (a.kind, a.text) = (sys::BUFFON_OIIO_TEXT as i32, value.as_ptr());
                    strings.push(value);
                }
            }
            list.push(a);
        }
        Ok(OiioAttributes { list, _strings: strings })
    }
}

/// The image to write, in safe types.
struct EncodeJob<'a> {
    format: Format,
    width: usize,
    height: usize,
    channels: Vec<&'a str>,
    /// For each channel.
    samples: Vec<i32>,
    floats: Option<&'a [f32]>,
    bytes: Option<&'a [u8]>,
    compression: String,
    metadata: Metadata,
}

/// An encoded file; the only owner of the shim's buffer.
struct EncodedFile {
    library: &'static sys::Functions,
    buffer: NonNull<sys::BuffonOiioBuffer>,
}

impl Drop for EncodedFile {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `buffon_oiio_encode`, this is its only owner and gives it up here.
        unsafe { self.library.buffon_oiio_free(self.buffer.as_ptr()) }
    }
}

impl EncodedFile {
    fn bytes(&self) -> Vec<u8> {
        let mut size = 0;
        // SAFETY: the buffer is alive, and so for as long as `self` are the `size` bytes that are returned;
        // there are some, because every format has a header.
        unsafe {
            let bytes = self.library.buffon_oiio_bytes(self.buffer.as_ptr(), &mut size);
            std::slice::from_raw_parts(bytes, size).to_vec()
        }
    }
}

/// The bytes of a file.
fn encode(job: &EncodeJob) -> Result<Vec<u8>, String> {
    let library = library()?;
    let names: Vec<CString> = job.channels.iter().map(c_text).collect::<Result<_, _>>()?;
    let name_pointers: Vec<*const c_char> = names.iter().map(|n| n.as_ptr()).collect();
    let compression = c_text(&job.compression)?;
    let attributes = OiioAttributes::of(&job.metadata)?;
    let values = job.width * job.height * job.channels.len();
    let given = job.floats.map_or(0, <[f32]>::len) + job.bytes.map_or(0, <[u8]>::len);
    assert_eq!(given, values, "the buffer does not fit the image");
    assert_eq!(job.samples.len(), job.channels.len(), "one sample format for each channel");
    let output = sys::BuffonOiioOutput {
        format: format_name(job.format).as_ptr(),
        width: job.width as i32,
        height: job.height as i32,
        channels: job.channels.len() as i32,
        samples: job.samples.as_ptr(),
        channel_names: name_pointers.as_ptr(),
        floats: job.floats.map_or(ptr::null(), <[f32]>::as_ptr),
        bytes: job.bytes.map_or(ptr::null(), <[u8]>::as_ptr),
        compression: compression.as_ptr(),
        attributes: attributes.list.as_ptr(),
        attribute_count: attributes.list.len(),
    };
    let mut message = Message::new();
    let (buffer, size) = message.buffer();
    // SAFETY: all strings end with a NUL and, like the arrays, outlive the call; there are as many names and sample
    // formats as channels, and exactly one of the pixel buffers is given, of the length that size and channels ask for;
    // `size` bytes of `buffer` are ours to write.
    let encoded = unsafe { library.buffon_oiio_encode(&output, buffer, size) };
    let buffer = NonNull::new(encoded).ok_or_else(|| message.text())?;
    Ok(EncodedFile { library, buffer }.bytes())
}

/// Encodes a single-part OpenEXR file.
pub(super) fn encode_exr(output: &ExrOutput) -> Result<Vec<u8>, String> {
    let image = output.image;
    let sample = |format: &SampleFormat| match format {
        SampleFormat::Half => sys::BUFFON_OIIO_SAMPLE_HALF as i32,
        SampleFormat::Float => sys::BUFFON_OIIO_SAMPLE_FLOAT as i32,
    };
    let compression = match output.compression {
        Compression::None => "none",
        Compression::Rle => "rle",
        Compression::Zips => "zips",
        Compression::Zip => "zip",
        Compression::Piz => "piz",
    };
    encode(&EncodeJob {
        format: Format::OpenExr,
        width: image.width,
        height: image.height,
        channels: image.channels.iter().map(String::as_str).collect(),
        samples: output.samples.iter().map(sample).collect(),
        floats: Some(output.data),
        bytes: None,
        compression: compression.into(),
        metadata: image.metadata.clone(),
    })
}

/// Encodes a PNG or JPEG file; JPEG with full chroma resolution.
pub(super) fn encode_bytes(format: Format, pixels: &BytePixels, quality: u8) -> Result<Vec<u8>, String> {
    let channels: &[&str] = match pixels.channels {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
    };
    let (compression, metadata) = match format {
        Format::Jpeg => {
            (format!("jpeg:{quality}"), Metadata::new().with("jpeg:subsampling", Value::Text("4:4:4".into())))
        }
        _ => ("zip".into(), Metadata::new()),
    };
    encode(&EncodeJob {
        format,
        width: pixels.width,
        height: pixels.height,
        channels: channels.to_vec(),
        samples: vec![sys::BUFFON_OIIO_SAMPLE_BYTE as i32; channels.len()],
        floats: None,
        bytes: Some(&pixels.bytes),
        compression,
        metadata,
    })
}

/// Returns width, height and channels, which are checked against the number of values.
fn shape(image: &Image) -> Result<[i32; 3], String> {
    let sides = [image.width, image.height, image.channels.len()];
    assert_eq!(
        image.data.len(),
        sides.iter().product::<usize>(),
        "the number of values does not match the image's size"
    );
    match sides.map(i32::try_from) {
        [Ok(width), Ok(height), Ok(channels)] => Ok([width, height, channels]),
        _ => Err(format!("an image of {}x{} is too large for OpenImageIO", image.width, image.height)),
    }
}

/// Computes the differences of two images of the same shape.
pub(super) fn difference(a: &Image, b: &Image) -> Result<Difference, String> {
    let [width, height, channels] = shape(a)?;
    assert_eq!(shape(b)?, [width, height, channels], "images of different shape");
    let library = library()?;
    let mut found =
        sys::BuffonOiioDifference { mean: 0.0, rms: 0.0, psnr: 0.0, max: 0.0, x: 0, y: 0, channel: 0 };
    let mut message = Message::new();
    let (buffer, size) = message.buffer();
    let (first, second) = (a.data.as_ptr(), b.data.as_ptr());
    // SAFETY: both images hold width * height * channels values, as `shape` has made sure, and are only read;
    // `found` and `size` bytes of `buffer` are ours to write.
    let done = unsafe {
        library.buffon_oiio_compare(first, second, width, height, channels, &mut found, buffer, size)
    };
    if done == 0 {
        return Err(message.text());
    }
    Ok(Difference {
        mean_absolute: found.mean,
        rms: found.rms,
        psnr: found.psnr,
        max: found.max,
        x: found.x as usize,
        y: found.y as usize,
        channel: found.channel as usize,
    })
}
