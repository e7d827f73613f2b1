//! A request over HTTP and its answer. A connection has one request, and a client that is slow is given up.

use std::io::{ErrorKind, Read, Result, Write};
use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The time that a client has to send a request, and to take any part of an answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// The time that a client has to close a connection after its answer.
const FAREWELL: Duration = Duration::from_millis(500);
/// The greatest length of a request in bytes. Its body is ignored.
const LONGEST: usize = 8192;
const MOST_HEADERS: usize = 64;

/// What a page may load: its own files. No other page may show it in a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// GET, POST or another.
    pub method: String,
    /// The path with its query.
    pub target: String,
    /// The header Host.
    pub host: String,
    /// The header Origin.
    pub origin: Option<String>,
}

/// An answer.
#[derive(Clone, Debug)]
pub struct Response {
    status: &'static str,
    media_type: &'static str,
    body: Arc<Vec<u8>>,
}

impl Request {
    /// Reads a request.
    ///
    /// # Errors
    /// If the client takes too long or closes the connection, or it is no request.
    pub fn read(stream: &mut TcpStream) -> Result<Self> {
        let until = Instant::now() + PATIENCE;
        let mut bytes = Vec::new();
        let mut part = [0; 1024];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(ErrorKind::TimedOut.into());
            }
            stream.set_read_timeout(Some(left))?;
            let n = stream.read(&mut part)?;
            bytes.extend(&part[..n]);
            if let Some(request) = Request::parse(&bytes)? {
                return Ok(request);
            }
            if n == 0 || bytes.len() > LONGEST {
                return Err(ErrorKind::InvalidData.into());
            }
        }
    }

    /// Parses a request; `None` if more bytes are needed.
    ///
    /// # Errors
    /// If it is no request.
    fn parse(bytes: &[u8]) -> Result<Option<Self>> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut request = httparse::Request::new(&mut headers);
        let wrong = || std::io::Error::from(ErrorKind::InvalidData);
        if request.parse(bytes).map_err(|_| wrong())?.is_partial() {
            return Ok(None);
        }
        let header = |name: &str| {
            let mut all = request.headers.iter().filter(|header| header.name.eq_ignore_ascii_case(name));
            let value = all.next().map(|header| String::from_utf8_lossy(header.value).trim().to_owned());
            if all.next().is_some() { Err(wrong()) } else { Ok(value) }
        };
        Ok(Some(Request {
            method: request.method.unwrap_or_default().to_owned(),
            target: request.path.unwrap_or_default().to_owned(),
            host: header("host")?.ok_or_else(wrong)?,
            origin: header("origin")?,
        }))
    }

    /// Returns whether the client has asked for this server by an address, which no other site can have, or by a name
    /// that is its own: `localhost` or `named`.
    pub fn is_for(&self, named: &str) -> bool {
        let is_port = |port: &str| port.bytes().all(|b| b.is_ascii_digit());
        let name = match self.host.rsplit_once(':') {
            Some((name, port)) if is_port(port) => name,
            _ => &self.host,
        };
        let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        address.parse::<IpAddr>().is_ok() || ["localhost", named].iter().any(|n| name.eq_ignore_ascii_case(n))
    }

    /// Returns whether the request is of a page of this server.
    pub fn is_of_own_page(&self) -> bool {
        self.origin.as_ref().is_some_and(|origin| *origin == format!("http://{}", self.host))
    }
}

impl Response {
    /// Creates an answer with a media type.
    pub fn new(media_type: &'static str, body: impl Into<Arc<Vec<u8>>>) -> Self {
        Response { status: "200 OK", media_type, body: body.into() }
    }

    /// Creates an answer with a sentence.
    pub fn sentence(status: &'static str, sentence: &str) -> Self {
        let body = format!("{sentence}\n").into_bytes();
        Response { status, media_type: "text/plain; charset=utf-8", body: body.into() }
    }

    /// Sends the answer, and ends the connection.
    ///
    /// # Errors
    /// If the client does not take it.
    pub fn send(&self, stream: &mut TcpStream) -> Result<()> {
        let head = format!(
            "HTTP/1.1 {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\nCache-Control: no-store\r\n\
             Content-Security-Policy: {POLICY}\r\nReferrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\n\r\n",
            self.status,
            self.media_type,
            self.body.len()
        );
        stream.set_write_timeout(Some(PATIENCE))?;
        stream.write_all(head.as_bytes())?;
        stream.write_all(&self.body)?;
        stream.shutdown(Shutdown::Write)
    }
}

/// Waits a moment until the client closes the connection: its unread bytes would reset it, and the answer be lost.
pub fn close(mut stream: TcpStream) {
    let mut rest = [0; LONGEST];
    if stream.set_read_timeout(Some(FAREWELL)).is_ok() {
        // A client that does not close it has the answer or does not want it.
        _ = stream.read(&mut rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(text: &str) -> Option<Request> {
        Request::parse(text.as_bytes()).expect("a request")
    }

    #[test]
    fn requests_are_parsed_whole_or_not_at_all() {
        let text = "GET /a?b=1 HTTP/1.1\r\nhost: x:80\r\nOrigin: http://x:80\r\n\r\n";
        assert_eq!(request(&text[..text.len() - 1]), None);
        let parsed = request(text).expect("it is whole");
        assert_eq!((parsed.method.as_str(), parsed.target.as_str()), ("GET", "/a?b=1"));
        assert!(parsed.is_of_own_page());
        for wrong in ["\0", "GET / HTTP/1.1\r\n\r\n", "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"] {
            assert!(Request::parse(wrong.as_bytes()).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn names_of_others_are_refused() {
        let is_for = |host: &str| {
            request(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")).expect("whole").is_for("node7")
        };
        for own in
            ["127.0.0.1:8000", "localhost:1", "LocalHost", "[::1]:8000", "[::1]", "10.1.2.3", "node7:80"]
        {
            assert!(is_for(own), "{own}");
        }
        for other in
            ["evil.example:8000", "127.0.0.1.evil.example", "node70:80", "localhost.:80:80", ":80", "x"]
        {
            assert!(!is_for(other), "{other}");
        }
    }

    #[test]
    fn origins_must_be_that_of_the_page() {
        let of = |origin: &str| {
            request(&format!("POST / HTTP/1.1\r\nHost: localhost:80\r\n{origin}\r\n")).expect("whole")
        };
        assert!(of("Origin: http://localhost:80\r\n").is_of_own_page());
        for other in
            ["", "Origin: null\r\n", "Origin: http://evil.example\r\n", "Origin: http://localhost:81\r\n"]
        {
            assert!(!of(other).is_of_own_page(), "{other}");
        }
    }
}
