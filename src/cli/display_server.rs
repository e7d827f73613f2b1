//! `--display-server`: the image so far in a viewer that speaks tev's protocol, such as tev and HDRView.
//!
//! A thread of its own sends the images, so a slow viewer never holds up the render: while it takes one image, later
//! ones are dropped. A viewer that is gone is a warning.

use crate::error::{Error, Result};
use crate::film::Tile;
use crate::image::Image;
use crate::render::Rendered;
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// The time between two images.
pub const INTERVAL: Duration = Duration::from_secs(1);
/// The time that the viewer has to answer, and to take a part of an image.
const PATIENCE: Duration = Duration::from_secs(3);
/// The greatest number of values in a packet, whose length in bytes has 32 bits.
const MOST_VALUES: usize = 1 << 24;
/// The layer with the standard error of the picture.
const STANDARD_ERROR: [&str; 3] = ["standard_error.R", "standard_error.G", "standard_error.B"];

/// A connection to a viewer.
pub struct DisplayServer {
    images: SyncSender<Image>,
    thread: JoinHandle<()>,
}

impl DisplayServer {
    /// Checks that an address is `HOST:PORT`.
    ///
    /// # Errors
    /// If it is not.
    pub fn check(address: &str) -> Result<()> {
        match address.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok()) {
            true => Ok(()),
            false => Err(Error::usage(format!(
                "--display-server {address}: expected HOST:PORT, such as localhost:14158"
            ))),
        }
    }

    /// Connects to the viewer at an address, `HOST:PORT`. `name` is the name of the image there. `warn` is called at
    /// most once, if the viewer does not take an image.
    ///
    /// # Errors
    /// If nobody answers there.
    pub fn connect(address: &str, name: String, warn: impl Fn(Error) + Send + 'static) -> Result<Self> {
        let failed = |why: String| Error::output(why).about(format!("--display-server {address}"));
        let addresses = address.to_socket_addrs().map_err(|e| failed(e.to_string()))?;
        let mut last = "the name has no address".to_owned();
        for address in addresses {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => {
                    stream.set_write_timeout(Some(PATIENCE)).map_err(|e| failed(e.to_string()))?;
                    let (images, waiting) = sync_channel(1);
                    let gone = failed("the viewer is gone".into());
                    let thread = std::thread::spawn(move || {
                        if send_all(TevClient::wrap(stream), &name, &waiting).is_err() {
                            warn(gone);
                        }
                    });
                    return Ok(DisplayServer { images, thread });
                }
                Err(e) => last = e.to_string(),
            }
        }
        Err(failed(last))
    }

    /// Shows an image, unless the viewer is still taking the one before.
    pub fn show(&self, image: Image, rendered: &Rendered) {
        // Without a viewer, the render goes on.
        _ = self.images.try_send(with_standard_error(image, rendered));
    }

    /// Shows the last image, and waits until the viewer has it or is given up.
    pub fn finish(self, image: Image, rendered: &Rendered) {
        let DisplayServer { images, thread } = self;
        _ = images.send(with_standard_error(image, rendered));
        drop(images);
        _ = thread.join();
    }
}

/// Sends images until there are no more.
fn send_all(mut viewer: TevClient, name: &str, images: &Receiver<Image>) -> std::io::Result<()> {
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
    }
    Ok(())
}

/// Returns the image with a layer of the standard error of the picture, from the variance between replicates.
fn with_standard_error(image: Image, rendered: &Rendered) -> Image {
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
