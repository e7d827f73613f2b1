//! What is wrong with an OBJ file, and in which line.

use crate::error::{Error, Place};
use crate::util::wording::quoted;
use std::path::Path;

/// The error for a text that could not be read: the first malformed line, or else the first that refers to what is not
/// there. `used` says whether texture coordinates and normals are.
pub fn locate(path: &Path, bytes: &[u8], used: [bool; 2]) -> Error {
    let limits = Seen::default().after(bytes);
    let checked = [true, used[0], used[1]];
    for references in [false, true] {
        let mut seen = Seen::default();
        for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
            let text = String::from_utf8_lossy(line);
            let mut words = text.split_ascii_whitespace().take_while(|word| !word.starts_with('#'));
            let first = words.next().unwrap_or_default();
            seen.count(first.as_bytes());
            let fault = match first {
                "v" if !references => coordinates(words, 3, &[3, 4, 6]),
                "vt" if !references => coordinates(words, 2, &[]),
                "vn" if !references => coordinates(words, 3, &[]),
                "f" if !references => words.find_map(malformed_corner),
                "f" => words.find_map(|corner| reference(corner, limits, seen, checked)),
                _ => None,
            };
            if let Some(message) = fault {
                let place = Place {
                    line: i as u32 + 1,
                    column: 1,
                    text: text.trim_end().to_owned(),
                    ..Place::file(path)
                };
                return Error::scene(message).at(place);
            }
        }
    }
    Error::scene("the mesh has too many vertices").in_file(path)
}

/// How many positions, texture coordinates and normals there are so far.
#[derive(Clone, Copy, Debug, Default)]
struct Seen([i64; 3]);

impl Seen {
    fn count(&mut self, word: &[u8]) {
        match word {
            b"v" => self.0[0] += 1,
            b"vt" => self.0[1] += 1,
            b"vn" => self.0[2] += 1,
            _ => {}
        }
    }

    fn after(mut self, bytes: &[u8]) -> Self {
        for line in bytes.split(|b| *b == b'\n') {
            let word = line.split(u8::is_ascii_whitespace).find(|w| !w.is_empty());
            self.count(word.unwrap_or_default());
        }
        self
    }
}

/// What is wrong with the numbers of a vertex: the first `n` must be numbers, and their count one of `counts` if any.
fn coordinates<'a>(words: impl Iterator<Item = &'a str>, n: usize, counts: &[usize]) -> Option<String> {
    let words: Vec<_> = words.collect();
    let is_number = |word: &str| fast_float2::parse::<f32, _>(word).is_ok();
    let numbers = if words.len() == 4 && n == 3 { 4 } else { n };
    if let Some(bad) = words.iter().take(numbers).find(|word| !is_number(word)) {
        return Some(format!("expected a number, found {}", quoted(bad)));
    }
    if words.len() < n || !(counts.is_empty() || counts.contains(&words.len())) {
        return Some(format!("expected {n} numbers, found {}", words.len()));
    }
    let weightless = numbers == 4 && fast_float2::parse::<f32, _>(words[3]) == Ok(0.0);
    weightless.then(|| "the weight of the vertex is 0".to_owned())
}

/// What is wrong with the text of a face's corner.
fn malformed_corner(corner: &str) -> Option<String> {
    let parts: Vec<_> = corner.split('/').collect();
    if parts.len() > 3 || parts[0].is_empty() {
        return Some(format!("expected a corner such as 1, 1/1, 1//1 or 1/1/1, found {}", quoted(corner)));
    }
    let bad = parts.iter().find(|part| !part.is_empty() && part.parse::<i64>().is_err())?;
    Some(format!("expected a whole number, found {}", quoted(bad)))
}

/// What a face's corner refers to although it is not there, given how many entries the file has and how many came
/// before.
fn reference(corner: &str, limits: Seen, seen: Seen, checked: [bool; 3]) -> Option<String> {
    const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];
    for (i, part) in corner.split('/').enumerate() {
        let Ok(index) = part.parse::<i64>() else { continue };
        let found = if index < 0 { seen.0[i].saturating_add(index) } else { index - 1 };
        let readable = index != 0 && found >= 0 && index.unsigned_abs() <= u64::from(u32::MAX);
        if !readable || checked[i] && found >= limits.0[i] {
            return Some(format!("there is no {} {index}; the file has {}", KINDS[i], limits.0[i]));
        }
    }
    None
}
