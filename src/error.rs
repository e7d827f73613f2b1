//! The error type: location, subject, value, and expectation.

use std::fmt;
use std::path::{Path, PathBuf};

/// Returns a number with its noun: "1 sample", "2 samples".
pub fn counted(n: impl Into<u128>, one: &str, many: &str) -> String {
    let n = n.into();
    format!("{n} {}", if n == 1 { one } else { many })
}

/// A position in a text file. Lines and columns are counted from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file, as named by the user or as found.
    pub file: PathBuf,
    /// The line, from 1; 0 if only the file is known.
    pub line: u32,
    /// The column in characters, from 1.
    pub column: u32,
    /// The text of that line, shown under the message.
    pub text: String,
}

impl Place {
    /// Creates a location that is a whole file.
    pub fn file(path: &Path) -> Self {
        Place { file: path.to_path_buf(), line: 0, column: 0, text: String::new() }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}", self.file.display()),
            line => write!(f, "{}:{}:{}", self.file.display(), line, self.column),
        }
    }
}

/// The kind of failure, which determines the program's exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A defect of Buffon itself or of one of its libraries (exit code 1).
    Internal,
    /// The command line (exit code 2).
    Usage,
    /// The scene or one of its files (exit code 3).
    Scene,
    /// A part of the scene's language that Buffon does not have (exit code 3).
    Unsupported,
    /// Reading or writing an image, or another output (exit code 4).
    Output,
    /// Invalid samples or warnings under `--strict` (exit code 5).
    Strict,
}

impl Kind {
    /// Returns the program's exit code.
    pub fn exit_code(self) -> u8 {
        match self {
            Kind::Internal => 1,
            Kind::Usage => 2,
            Kind::Scene | Kind::Unsupported => 3,
            Kind::Output => 4,
            Kind::Strict => 5,
        }
    }
}

/// An error with location, subject, value and expectation. It is printed as `scene.xml:12:9: <float name="alpha">:
/// expected a number, found "1,0"`, followed by the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// The kind, which determines the exit code.
    pub kind: Kind,
    /// The location; `None` if there is no file.
    pub place: Option<Place>,
    /// The subject of the error, such as `<float name="alpha">` or `--crop`; may be empty.
    pub thing: String,
    /// The problem, such as `expected a number, found "1,0"`.
    pub message: String,
    /// More errors with the same cause (all missing files are listed together).
    pub others: Vec<Error>,
}

/// `std::result::Result` with Buffon's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// Creates an error with only a message.
    pub fn new(kind: Kind, message: impl Into<String>) -> Self {
        let message = without_code(message.into());
        Error { kind, place: None, thing: String::new(), message, others: Vec::new() }
    }

    /// Creates an internal error.
    pub fn internal(message: impl Into<String>) -> Self {
        Error::new(Kind::Internal, message)
    }

    /// Creates an error of the command line.
    pub fn usage(message: impl Into<String>) -> Self {
        Error::new(Kind::Usage, message)
    }

    /// Creates an error of the scene.
    pub fn scene(message: impl Into<String>) -> Self {
        Error::new(Kind::Scene, message)
    }

    /// Creates an error of an output.
    pub fn output(message: impl Into<String>) -> Self {
        Error::new(Kind::Output, message)
    }

    /// Returns the error with a location.
    pub fn at(mut self, place: Place) -> Self {
        self.place = Some(place);
        self
    }

    /// Returns the error with a file as its location, without a line.
    pub fn in_file(self, path: &Path) -> Self {
        self.at(Place::file(path))
    }

    /// Returns the error with a subject.
    pub fn about(mut self, thing: impl Into<String>) -> Self {
        self.thing = thing.into();
        self
    }

    /// Adds errors with the same cause.
    pub fn with_others(mut self, others: Vec<Error>) -> Self {
        self.others = others;
        self
    }
}

/// Returns a message without the code that Rust appends to a message of the system, which becomes lower case.
fn without_code(message: String) -> String {
    let Some((words, code)) = message.split_once(" (os error ") else { return message };
    let (before, words) = words.rsplit_once(": ").unwrap_or(("", words));
    let (colon, after) =
        (if before.is_empty() { "" } else { ": " }, code.split_once(')').map_or("", |(_, after)| after));
    format!("{before}{colon}{}{after}", words.to_lowercase())
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        if !self.thing.is_empty() {
            write!(f, "{}: ", self.thing)?;
        }
        write!(f, "{}", self.message)?;
        if let Some(place) = self.place.as_ref().filter(|p| !p.text.trim().is_empty()) {
            let text = place.text.replace('\t', " ");
            let column = (place.column.max(1) - 1) as usize;
            // Only a part of a long line (a matrix, a generated file) is shown, around the column.
            let from = column.saturating_sub(60);
            let shown: String = text.chars().skip(from).take(120).collect();
            let shown = shown.trim_end();
            write!(f, "\n  | {shown}\n  | {}^", " ".repeat(column - from))?;
        }
        for other in &self.others {
            write!(f, "\n{other}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many() {
        let text = |n: u64| counted(n, "sample", "samples");
        assert_eq!([text(0), text(1), text(2)], ["0 samples", "1 sample", "2 samples"]);
    }

    #[test]
    fn a_place_prints_file_line_column_and_points_at_the_column() {
        let place = Place {
            file: "scene.xml".into(),
            line: 12,
            column: 5,
            text: "    <float name=\"alpha\" value=\"1,0\"/>".into(),
        };
        let error =
            Error::scene("expected a number, found \"1,0\"").about("<float name=\"alpha\">").at(place);
        assert_eq!(
            error.to_string(),
            "scene.xml:12:5: <float name=\"alpha\">: expected a number, found \"1,0\"\n  |     <float name=\"alpha\" value=\"1,0\"/>\n  |     ^"
        );
    }

    #[test]
    fn a_long_line_is_cut_around_the_column() {
        let place = Place { file: "a".into(), line: 1, column: 5001, text: "x".repeat(10_000) };
        let text = Error::scene("m").at(place).to_string();
        assert!(text.len() < 300, "{text}");
    }
}
