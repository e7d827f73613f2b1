//! `--watch`: a page with the render, for a browser.
//!
//! The render waits for no client. It leaves a copy of the picture for the threads of the connections, while a page is
//! open. Each connection has a thread and one request; their number is limited, and a slow client is given up. An
//! address has a secret token, without which a request is refused. Requests for another host and buttons in the pages
//! of other origins are refused, too.

mod address;
mod history;
mod http;
mod picture;
mod server;
mod state;

use crate::error::{Error, Result};
use crate::image::Image;
use crate::render::{Progress, Rendered, StopReason, StopRules};
use address::Address;
use server::Server;
use state::{Ending, Picture, Render};
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The least time between two pictures.
pub const INTERVAL: Duration = Duration::from_secs(1);
/// The greatest share of the time of a render for making pictures is the inverse.
const SHARE: u32 = 20;
/// The time between two looks at the error.
const TICK: Duration = Duration::from_millis(100);
/// The time that an open page has to take the last picture.
const PATIENCE: Duration = Duration::from_secs(3);

/// A page that shows a render.
pub struct Watch(Arc<Server>);

/// Returns the bytes of the copies of an image with `image` bytes that a page gets: a copy, a picture that is sent, and
/// the next one.
pub fn memory(image: u64, pixels: u64) -> u64 {
    picture::bytes(pixels).saturating_mul(2).saturating_add(image)
}

impl Watch {
    /// Listens at `:PORT`, of this machine alone, or at `HOST:PORT`, and prints the address of the page.
    ///
    /// # Errors
    /// If it is no such address, or it is in use.
    pub fn start(given: &str) -> Result<Self> {
        let address = Address::parse(given)?;
        let failed = |why: String| Error::output(why).about(format!("--watch {given}"));
        let listener = TcpListener::bind(address.to_bind()).map_err(|e| failed(address.sentence(&e)))?;
        let port = listener.local_addr().map_err(|e| failed(e.to_string()))?.port();
        let token = address::token().map_err(|e| failed(format!("the system has no random numbers: {e}")))?;
        let url = format!("http://{}:{port}/{token}/", address.host);
        let server = Arc::new(Server::new(address.host, token));
        server::listen(&server, listener).map_err(|e| failed(format!("cannot start a thread: {e}")))?;
        record_errors(server.clone()).map_err(|e| failed(format!("cannot start a thread: {e}")))?;
        super::report!("buffon: watch: {url}");
        Ok(Watch(server))
    }

    /// Shows another render, of an image with a name.
    pub fn begin(
        &self,
        name: &Path,
        frame: Option<u64>,
        progress: &Arc<Progress>,
        pixels: u64,
        rules: StopRules,
    ) {
        let name = name.file_name().unwrap_or(name.as_os_str()).to_string_lossy().into_owned();
        let render = Render::new(name, frame, progress.clone(), pixels, rules);
        self.0.change(|state| state.begin(render));
    }

    /// Shows the image so far, if a page is open, and the last picture is old enough.
    pub fn show(&self, rendered: &Rendered, image: impl FnOnce() -> Image) {
        let is_due = self.0.state().is_due();
        if is_due {
            self.put(rendered, image);
        }
    }

    /// Shows the last image of a render.
    pub fn end(&self, rendered: &Rendered, image: impl FnOnce() -> Image) {
        self.0.change(|state| state.end_sampling(rendered));
        if rendered.stop_reason != StopReason::Interrupted || rendered.counts.most > 0 {
            self.put(rendered, image);
        }
    }

    fn put(&self, rendered: &Rendered, image: impl FnOnce() -> Image) {
        let started = Instant::now();
        let number = self.0.state().next_picture();
        let bytes = Arc::new(picture::encode(number, &image(), rendered));
        let due = Instant::now() + INTERVAL.max(started.elapsed() * SHARE);
        self.0.change(|state| state.picture = Some(Picture { number, bytes, due }));
    }

    /// Tells an open page how the program ends, and waits a moment until it has the last picture.
    pub fn finish(self, result: &Result<u8>) {
        let ending = match result {
            Ok(code) => Ending { code: *code, message: None },
            Err(error) => Ending { code: error.kind.exit_code(), message: Some(error.to_string()) },
        };
        self.0.change(|state| state.ending = Some(ending));
        self.0.wait_for_pages(PATIENCE);
    }
}

/// Starts a thread that records the error of the render until the process ends.
fn record_errors(server: Arc<Server>) -> std::io::Result<()> {
    let record = move || {
        loop {
            server.state().record();
            std::thread::sleep(TICK);
        }
    };
    std::thread::Builder::new().name("watch error".into()).spawn(record).map(drop)
}
