//! The connections of pages.

use super::http::{Request, Response, close};
use super::state::State;
use crate::cli::signals;
use crate::report;
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant};

/// The greatest number of connections. Later ones are closed at once.
const MOST_CONNECTIONS: usize = 32;
/// The time after which a page gets the state although nothing but the progress has changed.
const STATE_INTERVAL: Duration = Duration::from_secs(1);
/// The time after which an error of the system may have passed.
const RETRY: Duration = Duration::from_millis(100);

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// The state, and the connections that wait for it.
pub struct Server {
    host: String,
    token: String,
    state: Mutex<State>,
    changed: Condvar,
    connections: AtomicUsize,
}

/// What follows an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Then {
    Nothing,
    /// The picture with this number was taken.
    Taken(u32),
    /// The render stops.
    Stop,
}

/// A connection, which is counted.
struct Connection(Arc<Server>);

impl Drop for Connection {
    fn drop(&mut self) {
        self.0.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Starts a thread that serves the connections to a port until the process ends.
///
/// # Errors
/// If there can be no thread.
pub fn listen(server: &Arc<Server>, listener: TcpListener) -> std::io::Result<()> {
    let server = server.clone();
    let accept = move || {
        loop {
            // An error is one of the client, or the system has no file left for the moment.
            let Ok((stream, _)) = listener.accept() else {
                std::thread::sleep(RETRY);
                continue;
            };
            let before = server.connections.fetch_add(1, Ordering::Relaxed);
            let connection = Connection(server.clone());
            if before < MOST_CONNECTIONS {
                // Without a thread, the connection is closed.
                _ = Builder::new().name("watch page".into()).spawn(move || connection.0.serve(stream));
            }
        }
    };
    Builder::new().name("watch".into()).spawn(accept).map(drop)
}

impl Server {
    /// Creates a server for a host, whose pages have a secret token in their address.
    pub fn new(host: String, token: String) -> Self {
        Server {
            host,
            token,
            state: Mutex::default(),
            changed: Condvar::new(),
            connections: AtomicUsize::new(0),
        }
    }

    /// Returns the state.
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and tells the pages.
    pub fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.state();
        change(&mut state);
        state.number += 1;
        self.changed.notify_all();
    }

    /// Waits until the open pages know of the end and have the last picture.
    pub fn wait_for_pages(&self, patience: Duration) {
        let until = Instant::now() + patience;
        let mut state = self.state();
        while state.is_open() && !state.is_known() && Instant::now() < until {
            let wait = self.changed.wait_timeout(state, RETRY);
            state = wait.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Answers the request of a connection.
    fn serve(&self, mut stream: TcpStream) {
        // A client that sends no request gets no answer.
        let Ok(request) = Request::read(&mut stream) else { return };
        let then = match self.name_of(&request) {
            Ok(name) => {
                self.state().begin_answer();
                let (response, then) = self.answer(&request, name);
                let then = response.send(&mut stream).map_or(Then::Nothing, |()| then);
                self.state().end_answer(if let Then::Taken(number) = then { Some(number) } else { None });
                self.changed.notify_all();
                then
            }
            Err(why) => {
                // Nothing depends on whether a stranger reads why.
                _ = Response::sentence("403 Forbidden", why).send(&mut stream);
                Then::Nothing
            }
        };
        close(stream);
        if then == Then::Stop {
            signals::stop();
        }
    }

    /// Returns what a request asks for.
    ///
    /// # Errors
    /// If the client may not ask.
    fn name_of<'r>(&self, request: &'r Request) -> Result<&'r str, &'static str> {
        if !request.is_for(&self.host) {
            return Err(
                "The header Host has a name that is not the one of --watch. Use an address or localhost.",
            );
        }
        let parts = request.target.strip_prefix('/').and_then(|target| target.split_once('/'));
        match parts {
            Some((token, name)) if is_same(token, &self.token) => Ok(name),
            _ => Err("The address lacks the token. Use the whole address that the render has printed."),
        }
    }

    /// Returns the answer to a request for `name`.
    fn answer(&self, request: &Request, name: &str) -> (Response, Then) {
        let (name, query) = name.split_once('?').unwrap_or((name, ""));
        let answer = match (request.method.as_str(), name) {
            ("GET", "") => file("text/html; charset=utf-8", &[PAGE]),
            ("GET", "page.css") => file("text/css; charset=utf-8", &[report::STYLE, STYLE]),
            ("GET", "page.js") => file("text/javascript; charset=utf-8", &[report::STAGE, SCRIPT]),
            ("GET", "state") => self.state_after(number(query, "after"), number(query, "have")),
            ("GET", "picture") => return self.picture(),
            ("POST", "stop" | "enough") if !request.is_of_own_page() => Response::sentence(
                "403 Forbidden",
                "The header Origin is not that of this page, so another page may have sent this.",
            ),
            ("POST", "stop") => {
                // Another signal would end the program without an image.
                let then = if self.state().stop() { Then::Stop } else { Then::Nothing };
                return (Response::sentence("200 OK", "The render stops."), then);
            }
            ("POST", "enough") if self.state().request_end() => {
                Response::sentence("200 OK", "The render ends after the current part of its pass.")
            }
            ("POST", "enough") => {
                Response::sentence("409 Conflict", "No samples are being taken now that could be enough.")
            }
            (_, "" | "page.css" | "page.js" | "state" | "picture" | "stop" | "enough") => {
                Response::sentence("405 Method Not Allowed", "There is no such method here.")
            }
            _ => Response::sentence("404 Not Found", "There is nothing here."),
        };
        (answer, Then::Nothing)
    }

    /// Waits until there is a state after the one with a number, but no longer than a second, and returns it to a page
    /// that has a picture.
    fn state_after(&self, after: Option<u64>, has: Option<u64>) -> Response {
        let until = Instant::now() + STATE_INTERVAL;
        let mut state = self.state();
        while state.ending.is_none() && after.is_some_and(|after| state.number <= after) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let wait = self.changed.wait_timeout(state, left);
            state = wait.unwrap_or_else(PoisonError::into_inner).0;
        }
        state.inform(has);
        file("application/json", &[&state.json().to_string()])
    }

    fn picture(&self) -> (Response, Then) {
        match &self.state().picture {
            Some(picture) => (
                Response::new("application/octet-stream", picture.bytes.clone()),
                Then::Taken(picture.number),
            ),
            None => (Response::sentence("404 Not Found", "There is no picture yet."), Then::Nothing),
        }
    }
}

fn file(media_type: &'static str, parts: &[&str]) -> Response {
    Response::new(media_type, parts.concat().into_bytes())
}

/// Returns the value of a number in a query.
fn number(query: &str, name: &str) -> Option<u64> {
    query.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('=')?.parse().ok())
}

/// Returns whether two texts are the same, in a time that does not depend on where they differ.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}
