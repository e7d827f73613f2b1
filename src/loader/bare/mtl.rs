//! MTL files, which define the materials that an OBJ file names. `tobj` parses them.

use super::Builder;
use crate::error::{Error, Place, Result};
use crate::loader::mesh::Named;
use crate::util::wording::quoted;
use std::collections::BTreeMap;
use std::io::{self, BufRead, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The greatest number of wrong lines that is accepted in a file.
const MOST_WRONG: usize = 20;

/// A material and the file that defines it.
#[derive(Debug)]
pub struct Entry {
    pub material: tobj::Material,
    pub file: PathBuf,
}

/// Materials by name.
pub type Library = BTreeMap<String, Arc<Entry>>;

impl Builder<'_> {
    /// Reads the MTL files. Adds a warning for each file that does not exist and for each wrong line.
    ///
    /// # Errors
    /// If a file exists but cannot be read, or more than `MOST_WRONG` of its lines are wrong.
    pub fn read_libraries(&mut self, libraries: &[Named]) -> Result<()> {
        for library in libraries {
            // The line holds one name, which may contain blanks, or several names.
            let names = match self.find(self.path, &library.name) {
                Some(_) => vec![&library.name[..]],
                None => library.name.split_whitespace().collect(),
            };
            for name in names {
                match self.find(self.path, name) {
                    Some(path) => self.read_library(&path)?,
                    None => {
                        let message = format!("there is no file {}: its materials are grey", quoted(name));
                        self.warn_at(library.line, message);
                    }
                }
            }
        }
        Ok(())
    }

    /// Returns the path of a file that the file `named_in` names. The name may have backslashes between folders.
    pub fn find(&self, named_in: &Path, name: &str) -> Option<PathBuf> {
        let found = self.folders.find(named_in, name);
        found.or_else(|| self.folders.find(named_in, &name.replace('\\', "/"))).filter(|path| path.is_file())
    }

    fn read_library(&mut self, path: &Path) -> Result<()> {
        let (bytes, _reserved) = crate::loader::read_bytes(path, self.memory)?;
        let text = String::from_utf8_lossy(&bytes);
        let mut lines = Lines::new(text.trim_start_matches('\u{feff}'));
        let mut wrong = Vec::new();
        let materials = loop {
            lines.next = 0;
            match tobj::load_mtl_buf(&mut lines) {
                Ok((materials, _)) => break materials,
                Err(error) => {
                    // The wrong line is emptied, and the whole file is parsed again.
                    let i = lines.next.saturating_sub(1);
                    let line = text.lines().nth(i).unwrap_or_default().trim_end().to_owned();
                    let place = Place { line: i as u32 + 1, column: 1, text: line, ..Place::file(path) };
                    let warning = Error::scene(format!("the line is ignored: {error}")).at(place);
                    if wrong.len() == MOST_WRONG {
                        return Err(Error::scene(format!("more than {MOST_WRONG} lines are wrong"))
                            .in_file(path)
                            .with_others(wrong));
                    }
                    wrong.push(warning);
                    lines.lines[i] = "\n".to_owned();
                }
            }
        };
        self.loaded.warnings.append(&mut wrong);
        for material in materials {
            // If several materials have the same name, the first one counts.
            let entry = |material| Arc::new(Entry { material, file: path.to_path_buf() });
            self.library.entry(material.name.clone()).or_insert_with(|| entry(material));
        }
        Ok(())
    }
}

/// A reader that returns one line at a time, in the form that `tobj` expects.
struct Lines {
    lines: Vec<String>,
    /// The index of the line after the current one.
    next: usize,
    /// The number of bytes of the current line that have been read.
    at: usize,
}

impl Lines {
    fn new(text: &str) -> Self {
        Lines { lines: text.lines().map(|line| normalized(line) + "\n").collect(), next: 0, at: 0 }
    }

    /// Returns the bytes of the current line that have not been read.
    fn rest(&self) -> &[u8] {
        let current = self.next.checked_sub(1).and_then(|i| self.lines.get(i));
        current.and_then(|line| line.as_bytes().get(self.at..)).unwrap_or_default()
    }
}

impl Read for Lines {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(into)?;
        self.consume(read);
        Ok(read)
    }
}

impl BufRead for Lines {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.rest().is_empty() && self.next < self.lines.len() {
            self.next += 1;
            self.at = 0;
        }
        Ok(self.rest())
    }

    fn consume(&mut self, bytes: usize) {
        self.at += bytes;
    }
}

/// Returns a line in the form that `tobj` expects: three numbers for a colour, and no option for `d`. Colours as
/// spectra or CIE XYZ are not changed, and `tobj` reports them as errors.
fn normalized(line: &str) -> String {
    let mut words = line.split_whitespace().take_while(|word| !word.starts_with('#'));
    let rest: Vec<&str> = words.clone().skip(1).collect();
    match (words.next(), &rest[..]) {
        // One number stands for all three channels.
        (Some(color @ ("Ka" | "Kd" | "Ks" | "Ke" | "Tf")), [grey]) => format!("{color} {grey} {grey} {grey}"),
        // `tobj` panics if a colour has fewer than three numbers. It reports this line as an error instead.
        (Some(color @ ("Ka" | "Kd" | "Ks" | "Ke")), [] | [_, _]) => {
            format!("{color} {} expected-3-numbers -", rest.join(" "))
        }
        (Some("d"), ["-halo", value]) => format!("d {value}"),
        _ => line.trim().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_brought_into_the_form_that_tobj_reads() {
        for (line, expected) in [
            ("\tKd 0.5", "Kd 0.5 0.5 0.5"),
            ("Kd 1 2 3", "Kd 1 2 3"),
            ("d -halo 0.3 # c", "d 0.3"),
            ("map_Kd a  b.png", "map_Kd a  b.png"),
            ("Ks", "Ks  expected-3-numbers -"),
        ] {
            assert_eq!(normalized(line), expected);
        }
        let mut lines = Lines::new("newmtl a\nKd 1\n\nNs 3\nnewmtl b\nillum 7");
        let (materials, _) = tobj::load_mtl_buf(&mut lines).unwrap();
        assert_eq!(materials.len(), 2);
        assert_eq!((materials[0].diffuse, materials[0].shininess), (Some([1.0; 3]), Some(3.0)));
        for text in
            ["Kd", "Kd 1 2", "Ke 1 x 3", "Ka xyz 1 1", "Kd spectral a.rfl", "map_Kd", "newmtl", "illum x"]
        {
            let mut lines = Lines::new(text);
            assert!(tobj::load_mtl_buf(&mut lines).is_err(), "{text}");
            assert_eq!(lines.next, 1);
        }
    }
}
