//! `--display-server`: the image so far in a viewer that speaks tev's protocol, such as tev and HDRView.
//!
//! A thread of its own sends the images, so the render does not wait for a slow viewer: while it takes one image, later
//! ones are left out. Only the end of the render waits for the last image. A viewer that is gone is a warning.

use crate::error::{Error, Result};
use crate::film::Tile;
use crate::image::Image;
use crate::render::Rendered;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// The time between two images.
pub const INTERVAL: Duration = Duration::from_secs(1);
/// The time that the viewer has to answer, and to take any part of an image.
const PATIENCE: Duration = Duration::from_secs(3);
/// The greatest number of values in a packet, whose length in bytes has 32 bits.
const MOST_VALUES: usize = 1 << 24;
/// The layer with the standard error of the picture.
const STANDARD_ERROR: [&str; 3] = ["standard_error.R", "standard_error.G", "standard_error.B"];

/// Returns the bytes of the copies of an image with `image` bytes that a viewer gets: a copy, and two with the standard
/// error, one of which is being sent.
pub fn memory(image: u64, pixels: u64) -> u64 {
    let with_error = image.saturating_add(pixels.saturating_mul(4 * STANDARD_ERROR.len() as u64));
    with_error.saturating_mul(2).saturating_add(image)
}

/// A connection to a viewer.
pub struct DisplayServer {
    images: SyncSender<Image>,
    thread: JoinHandle<()>,
    /// The number of images that were sent, and of those that the viewer has taken.
    sent: AtomicU64,
    taken: Arc<AtomicU64>,
    last: Mutex<Option<Instant>>,
}

impl DisplayServer {
    /// Checks that an address is `HOST:PORT`.
    ///
    /// # Errors
    /// If it is not.
    pub fn check(address: &str) -> Result<()> {
        let parts = address.rsplit_once(':');
        match parts.is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok()) {
            true => Ok(()),
            false => Err(Error::usage(format!(
                "--display-server {address}: expected HOST:PORT, such as localhost:14158"
            ))),
        }
    }

    /// Connects to the viewer at an address, `HOST:PORT`. The image has the name of a file there. Unless `quiet`, a
    /// viewer that does not take an image later is a warning.
    ///
    /// # Errors
    /// If nobody answers there.
    pub fn connect(address: &str, file: &Path, quiet: bool) -> Result<Self> {
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        let failed = |why: String| Error::output(why).about(format!("--display-server {address}"));
        let addresses = address.to_socket_addrs().map_err(|e| failed(e.to_string()))?;
        let mut last = "the name has no address".to_owned();
        for address in addresses {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => {
                    stream.set_write_timeout(Some(PATIENCE)).map_err(|e| failed(e.to_string()))?;
                    let (images, waiting) = sync_channel(1);
                    let gone = failed("the viewer is gone".into());
                    let taken = Arc::new(AtomicU64::new(0));
                    let counter = taken.clone();
                    let thread = std::thread::spawn(move || {
                        if send_all(TevClient::wrap(stream), &name, &waiting, &counter).is_err() && !quiet {
                            super::report!("buffon: warning: {gone}");
                        }
                    });
                    let (sent, last) = (AtomicU64::new(0), Mutex::new(None));
                    return Ok(DisplayServer { images, thread, sent, taken, last });
                }
                Err(e) => last = e.to_string(),
            }
        }
        Err(failed(last))
    }

    /// Shows the image so far, unless the viewer is gone or still taking the one before, or that was less than
    /// [`INTERVAL`] ago.
    pub fn show(&self, rendered: &Rendered, image: impl FnOnce() -> Image) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let is_early = last.is_some_and(|last| last.elapsed() < INTERVAL);
        let is_busy = self.taken.load(Ordering::Relaxed) < self.sent.load(Ordering::Relaxed);
        if !is_early && !is_busy && !self.thread.is_finished() {
            self.sent.fetch_add(1, Ordering::Relaxed);
            // Without a viewer, the render goes on.
            _ = self.images.try_send(with_standard_error(image(), rendered));
            *last = Some(Instant::now());
        }
    }

    /// Shows the last image, and waits until the viewer has it or is given up.
    pub fn finish(self, rendered: &Rendered, image: impl FnOnce() -> Image) {
        if !self.thread.is_finished() {
            _ = self.images.send(with_standard_error(image(), rendered));
        }
        drop(self.images);
        _ = self.thread.join();
    }
}

/// Sends images until there are no more, and counts them.
fn send_all(
    mut viewer: TevClient,
    name: &str,
    images: &Receiver<Image>,
    taken: &AtomicU64,
) -> std::io::Result<()> {
    let mut created = false;
    for image in images {
        let Image { width, channels, data, .. } = &image;
        let n = channels.len();
        if !created {
            let [width, height] = [image.width, image.height].map(|size| size as u32);
            let packet = PacketCreateImage {
                image_name: name,
                grab_focus: true,
                width,
                height,
                channel_names: channels,
            };
            viewer.send(packet)?;
            created = true;
        }
        let (offsets, strides): (Vec<u64>, Vec<u64>) = (0..n).map(|c| (c as u64, n as u64)).unzip();
        let rows = (MOST_VALUES / (width * n)).max(1);
        for (i, strip) in data.chunks(rows * width * n).enumerate() {
            viewer.send(PacketUpdateImage {
                image_name: name,
                grab_focus: false,
                channel_names: channels,
                channel_offsets: &offsets,
                channel_strides: &strides,
                x: 0,
                y: (i * rows) as u32,
                width: *width as u32,
                height: (strip.len() / (width * n)) as u32,
                data: strip,
            })?;
        }
        taken.fetch_add(1, Ordering::Relaxed);
    }
    Ok(())
}

/// Returns the image with a layer of the standard error of the picture, from the variance between replicates, unless it
/// has one.
fn with_standard_error(image: Image, rendered: &Rendered) -> Image {
    if image.channels.iter().any(|channel| STANDARD_ERROR.contains(&channel.as_str())) {
        return image;
    }
    let n = image.channels.len();
    let channels = image.channels.iter().map(String::as_str).chain(STANDARD_ERROR);
    let mut with = Image::new(image.width, image.height, &channels.collect::<Vec<_>>());
    for (to, from) in with.data.chunks_exact_mut(n + 3).zip(image.data.chunks_exact(n)) {
        to[..n].copy_from_slice(from);
    }
    for tile in &rendered.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let [x, y] = [x - rendered.rect.x, y - rendered.rect.y].map(|v| v as usize);
            for (c, to) in with.pixel_mut(x, y)[n..].iter_mut().enumerate() {
                *to = standard_error(tile, i, c);
            }
        }
    }
    with
}

fn standard_error(tile: &Tile, i: usize, c: usize) -> f32 {
    tile.estimate(i, c).variance.map_or(0.0, |variance| variance.sqrt() as f32)
}
