//! The address of a page.

use crate::error::{Error, Result};
use std::io::ErrorKind;

/// The host of a page without a name.
const LOOPBACK: &str = "127.0.0.1";
/// The bytes of a token.
const TOKEN: usize = 16;

/// A host and a port.
#[derive(Debug, PartialEq, Eq)]
pub struct Address {
    /// The host, as in a URL.
    pub host: String,
    /// The port; 0 for any that is free.
    pub port: u16,
}

impl Address {
    /// Parses `:PORT` or `HOST:PORT`.
    ///
    /// # Errors
    /// If it is neither.
    pub fn parse(text: &str) -> Result<Self> {
        let is_host = |host: &str| {
            let (inner, is_bracketed) = match host.strip_prefix('[').and_then(|host| host.strip_suffix(']')) {
                Some(inner) => (inner, true),
                None => (host, false),
            };
            let is_allowed =
                |c: char| c.is_ascii_alphanumeric() || "-._".contains(c) || (is_bracketed && c == ':');
            inner.chars().all(is_allowed)
        };
        let parts = text.rsplit_once(':').and_then(|(host, port)| Some((host, port.parse().ok()?)));
        match parts {
            Some(("", port)) => Ok(Address { host: LOOPBACK.into(), port }),
            Some((host, port)) if is_host(host) => Ok(Address { host: host.into(), port }),
            _ => Err(Error::usage(format!(
                "--watch {text}: expected :PORT or HOST:PORT, such as :8000, or :0 for a free port"
            ))),
        }
    }

    /// Returns the address in the form of the system.
    pub fn to_bind(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }

    /// Returns why it is not possible to listen there.
    pub fn sentence(&self, error: &std::io::Error) -> String {
        let Address { host, port } = self;
        match error.kind() {
            ErrorKind::AddrInUse => {
                format!(
                    "another program listens at port {port} of {host}; name another port, or :0 for a free one"
                )
            }
            ErrorKind::AddrNotAvailable => format!("{host} is no address of this machine"),
            ErrorKind::PermissionDenied => {
                format!("the system does not let this user listen at port {port}; name one from 1024")
            }
            _ => format!("cannot listen at port {port} of {host}: {error}"),
        }
    }
}

/// Returns a random token of the system in hexadecimal digits.
pub fn token() -> std::result::Result<String, getrandom::Error> {
    let mut bytes = [0; TOKEN];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_host_it_is_this_machine_alone() {
        let of = |text: &str| Address::parse(text).map(|address| address.to_bind()).ok();
        assert_eq!(of(":0").as_deref(), Some("127.0.0.1:0"));
        for same in ["localhost:8000", "0.0.0.0:1", "[::1]:65535", "node-7.farm:80"] {
            assert_eq!(of(same).as_deref(), Some(same));
        }
        for wrong in ["", "8000", ":", ":65536", ":-1", "::1:80", "a b:80", "http://a:80", "a/b:80", "a:80/"]
        {
            assert_eq!(of(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn tokens_are_long_and_differ() {
        let [a, b] = [(); 2].map(|()| token().expect("random numbers"));
        assert!(a.len() == 32 && a != b);
    }
}
