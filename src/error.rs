//! The one error type: where, what, which value, and what was expected instead.

use std::fmt;
use std::path::{Path, PathBuf};

/// "1 sample", "2 samples": a number with its noun.
pub fn counted(n: impl Into<u128>, one: &str, many: &str) -> String {
    let n = n.into();
    format!("{n} {}", if n == 1 { one } else { many })
}

/// A position in a text file. Lines and columns count from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file, as the user named it or as it was found.
    pub file: PathBuf,
    /// Line, from 1; 0 when only the file is known.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// The text of that line, shown under the message.
    pub text: String,
}

impl Place {
    /// A place that is a whole file.
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

/// What kind of failure it is; it decides the exit code of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A defect of Buffon itself or of a library under it (exit code 1).
    Internal,
    /// The command line (exit code 2).
    Usage,
    /// The scene or one of its files (exit code 3).
    Scene,
    /// Reading or writing an image, or another output (exit code 4).
    Output,
    /// Invalid samples or warnings under `--strict` (exit code 5).
    Strict,
}

impl Kind {
    /// The exit code of the program for this kind of failure.
    pub fn exit_code(self) -> u8 {
        match self {
            Kind::Internal => 1,
            Kind::Usage => 2,
            Kind::Scene => 3,
            Kind::Output => 4,
            Kind::Strict => 5,
        }
    }
}

/// An error with place, thing, value and expectation, printed as
/// `scene.xml:12:9: <float name="alpha">: expected a number, found "1,0"` with the line shown under it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// Decides the exit code.
    pub kind: Kind,
    /// Where; `None` when there is no file to point at.
    pub place: Option<Place>,
    /// The thing that is wrong, e.g. `<float name="alpha">` or `--crop`; may be empty.
    pub thing: String,
    /// What is wrong with it, e.g. `expected a number, found "1,0"`.
    pub message: String,
    /// More errors of the same cause (all missing files are listed at once).
    pub others: Vec<Error>,
}

/// `std::result::Result` with Buffon's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An error of a kind with only a message.
    pub fn new(kind: Kind, message: impl Into<String>) -> Self {
        Error { kind, place: None, thing: String::new(), message: message.into(), others: Vec::new() }
    }

    /// An internal error.
    pub fn internal(message: impl Into<String>) -> Self {
        Error::new(Kind::Internal, message)
    }

    /// An error of the command line.
    pub fn usage(message: impl Into<String>) -> Self {
        Error::new(Kind::Usage, message)
    }

    /// An error of the scene.
    pub fn scene(message: impl Into<String>) -> Self {
        Error::new(Kind::Scene, message)
    }

    /// An error of an output.
    pub fn output(message: impl Into<String>) -> Self {
        Error::new(Kind::Output, message)
    }

    /// The same error at a place.
    pub fn at(mut self, place: Place) -> Self {
        self.place = Some(place);
        self
    }

    /// The same error in a file, with no line.
    pub fn in_file(self, path: &Path) -> Self {
        self.at(Place::file(path))
    }

    /// The same error about a thing.
    pub fn about(mut self, thing: impl Into<String>) -> Self {
        self.thing = thing.into();
        self
    }

    /// Adds errors of the same cause.
    pub fn with_others(mut self, others: Vec<Error>) -> Self {
        self.others = others;
        self
    }
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
            // A long line (a matrix, a generated file) is shown around the column only.
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
