//! XML elements with their positions in the file.

use crate::error::{Error, Place, Result};
use roxmltree::{Document, ParsingOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The greatest depth of nested elements. It bounds the recursion over them, so that the stack is not exhausted.
pub const MAX_DEPTH: usize = 100;

/// The greatest length, in bytes, of a line that is repeated in messages.
const MAX_SHOWN_LINE: usize = 4096;
/// The number of bytes between the counts from which columns are computed.
const BLOCK: usize = 1024;

/// A text file that contains elements.
#[derive(Debug)]
pub struct Source {
    /// The file, as the user named it or as it was found.
    pub path: PathBuf,
    text: String,
    line_starts: Vec<usize>,
    /// The number of characters before each block of [`BLOCK`] bytes, so that a column is found without counting from
    /// the start of the line.
    chars_before: Vec<usize>,
}

/// The position of an element or attribute in a file; cheap to clone.
#[derive(Clone, Debug)]
pub struct Spot {
    source: Arc<Source>,
    offset: usize,
}

/// An attribute of an element.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Attribute {
    /// Its name.
    pub name: String,
    /// Its value, with XML escapes resolved.
    pub value: String,
}

/// An XML element.
#[derive(Clone, Debug)]
pub struct Element {
    /// Its name.
    pub tag: String,
    /// Its attributes in file order.
    pub attributes: Vec<Attribute>,
    /// The elements inside it.
    pub children: Vec<Element>,
    /// The position of its start.
    pub spot: Spot,
}

impl Source {
    fn new(path: &Path, text: String) -> Self {
        let newlines = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1);
        let line_starts = std::iter::once(0).chain(newlines).collect();
        let mut chars_before = vec![0];
        for block in text.as_bytes().chunks(BLOCK) {
            chars_before.push(chars_before[chars_before.len() - 1] + chars_in(block));
        }
        Source { path: path.to_path_buf(), line_starts, chars_before, text }
    }

    /// Returns the number of characters before an offset that is between two characters.
    fn chars_to(&self, offset: usize) -> usize {
        let block = offset / BLOCK;
        self.chars_before[block] + chars_in(&self.text.as_bytes()[block * BLOCK..offset])
    }
}

/// Returns the number of characters that start in these bytes of a text.
fn chars_in(bytes: &[u8]) -> usize {
    bytes.iter().filter(|b| **b & 0xC0 != 0x80).count()
}

impl Spot {
    /// Returns line, column and text of the position.
    pub fn place(&self) -> Place {
        let source = &*self.source;
        let line = source.line_starts.partition_point(|start| *start <= self.offset).max(1);
        let start = source.line_starts[line - 1];
        let end = source.line_starts.get(line).map_or(source.text.len(), |next| next - 1);
        let column = 1 + source.chars_to(self.offset) - source.chars_to(start);
        let text =
            if end - start > MAX_SHOWN_LINE { "" } else { source.text[start..end].trim_end_matches('\r') };
        Place { file: source.path.clone(), line: line as u32, column: column as u32, text: text.to_owned() }
    }

    /// Returns the file of the position.
    pub fn file(&self) -> &Path {
        &self.source.path
    }
}

impl Element {
    /// Returns the value of an attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|a| a.name == name).map(|a| a.value.as_str())
    }

    /// Returns the element's name in messages: `<float name="alpha">`, `<bsdf type="diffuse">` or `<translate>`.
    pub fn thing(&self) -> String {
        let shown = ["name", "type", "id"].iter().find_map(|n| self.attribute(n).map(|v| (n, v)));
        match shown {
            Some((name, value)) => format!("<{} {name}=\"{value}\">", self.tag),
            None => format!("<{}>", self.tag),
        }
    }

    /// Creates an error about the element, at its place.
    pub fn error(&self, message: impl Into<String>) -> Error {
        Error::scene(message).about(self.thing()).at(self.spot.place())
    }
}

/// Parses a file's text. Text between elements is ignored with a warning.
///
/// # Errors
/// If the XML is malformed, at its place; if it defines entities; if elements are nested deeper than [`MAX_DEPTH`].
pub fn parse(path: &Path, text: String, warnings: &mut Vec<Error>) -> Result<Element> {
    let source = Arc::new(Source::new(path, text));
    // A declaration without entities says nothing.
    let options =
        ParsingOptions { allow_dtd: !source.text.contains("<!ENTITY"), ..ParsingOptions::default() };
    let document = Document::parse_with_options(&source.text, options);
    let document = document.map_err(|e| parse_error(&source, &e))?;
    convert(document.root_element(), &source, 1, warnings)
}

/// Converts an error of the library.
fn parse_error(source: &Arc<Source>, error: &roxmltree::Error) -> Error {
    if matches!(error, roxmltree::Error::DtdDetected) {
        let offset = source.text.find("<!DOCTYPE").unwrap_or(0);
        let spot = Spot { source: source.clone(), offset };
        return Error::scene("entities are refused").about("<!DOCTYPE>").at(spot.place());
    }
    let pos = error.pos();
    let text = error.to_string();
    let message = text.split(" at ").next().unwrap_or_default().replace("'", "\"");
    let line = (pos.row as usize).clamp(1, source.line_starts.len());
    let start = source.line_starts[line - 1];
    let rest = &source.text[start..];
    let offset = rest.char_indices().nth(pos.col.max(1) as usize - 1).map_or(rest.len(), |(i, _)| i);
    let spot = Spot { source: source.clone(), offset: start + offset };
    Error::scene(format!("malformed XML: {message}")).at(spot.place())
}

/// Converts an element and its contents.
fn convert(
    node: roxmltree::Node,
    source: &Arc<Source>,
    depth: usize,
    warnings: &mut Vec<Error>,
) -> Result<Element> {
    let spot = |node: roxmltree::Node| Spot { source: source.clone(), offset: node.range().start };
    let attributes = node.attributes().map(|a| Attribute { name: a.name().into(), value: a.value().into() });
    let mut element = Element {
        tag: node.tag_name().name().to_owned(),
        attributes: attributes.collect(),
        children: Vec::new(),
        spot: spot(node),
    };
    if depth > MAX_DEPTH {
        return Err(element.error(format!("nested deeper than {MAX_DEPTH} levels")));
    }
    for child in node.children() {
        if child.is_element() {
            element.children.push(convert(child, source, depth + 1, warnings)?);
        } else if child.is_text() && child.text().is_some_and(|t| !t.trim().is_empty()) {
            let place = spot(child).place();
            let place =
                if place.text.trim().is_empty() { Place { text: String::new(), ..place } } else { place };
            warnings.push(Error::scene("the text inside it is ignored").about(element.thing()).at(place));
        }
    }
    Ok(element)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_text(text: &str) -> Result<Element> {
        parse(Path::new("s.xml"), text.to_owned(), &mut Vec::new())
    }

    #[test]
    fn elements_know_their_place() {
        let root = parse_text("<scene>\n  <bsdf type=\"diffuse\"/>é<float\n   name=\"a&amp;b\"/>\n</scene>")
            .unwrap();
        let [bsdf, float] = &root.children[..] else { panic!() };
        assert_eq!(bsdf.spot.place().to_string(), "s.xml:2:3");
        assert_eq!(float.spot.place().to_string(), "s.xml:2:26");
        assert_eq!(float.attribute("name"), Some("a&b"));
        assert_eq!(bsdf.thing(), "<bsdf type=\"diffuse\">");
    }

    #[test]
    fn columns_of_long_lines_are_counted_in_characters() {
        let root = parse_text(&format!("<s>\n<a b='{}'/>é<c/>\n<d/></s>", "é".repeat(3000))).unwrap();
        let places: Vec<_> = root.children.iter().map(|c| c.spot.place()).collect();
        assert_eq!(
            places.iter().map(ToString::to_string).collect::<Vec<_>>(),
            ["s.xml:2:1", "s.xml:2:3011", "s.xml:3:1"]
        );
        assert_eq!((places[0].text.as_str(), places[2].text.as_str()), ("", "<d/></s>"));
    }

    #[test]
    fn malformed_xml_is_told_with_its_place() {
        let message = |text: &str| parse_text(text).unwrap_err().to_string();
        assert_eq!(
            message("<scene>\n  <bsdf>\n</scene>"),
            "s.xml:3:1: malformed XML: expected \"bsdf\" tag, not \"scene\"\n  | </scene>\n  | ^"
        );
        assert_eq!(message(""), "s.xml:1:1: malformed XML: the document does not have a root node");
    }

    #[test]
    fn entities_and_deep_nesting_are_refused() {
        let bomb = "<!DOCTYPE a [<!ENTITY x \"xxxx\"><!ENTITY y \"&x;&x;\">]>\n<scene a=\"&y;\"/>";
        assert_eq!(
            parse_text(bomb).unwrap_err().to_string().lines().next().unwrap(),
            "s.xml:1:1: <!DOCTYPE>: entities are refused"
        );
        let deep = "<a>".repeat(50_000) + &"</a>".repeat(50_000);
        assert_eq!(
            parse_text(&deep).unwrap_err().to_string(),
            "s.xml:1:301: <a>: nested deeper than 100 levels"
        );
    }
}
