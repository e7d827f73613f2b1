//! The properties of an element that are attributes of the mesh, by the rules of Mitsuba 3.9.1.
//!
//! * `r g b` or `red green blue`, with `a` or `alpha` if there is one, are the attribute `color`.
//! * Neighbouring properties with the same prefix, whose suffixes count along `_x _y _z`, `_r _g _b`, `_0 _1 _2` or
//!   `_1 _2 _3`, are an attribute named by the prefix, with `_color` appended for the second kind. There must be one or
//!   three of them.
//! * Numbers of type `uchar` keep their values; other integers are divided by the largest of their type and decoded
//!   from sRGB.
//!
//! Properties without such a suffix are ignored.

use super::header::{Element, Kind, Number};
use crate::color::srgb::srgb_to_linear;

/// An attribute of the mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Its name, prefixed by the element's name.
    pub name: String,
    /// Indices of the properties that are its channels.
    pub columns: Vec<usize>,
}

/// The suffixes of each kind of attribute, in order.
const SUFFIXES: [[&str; 4]; 4] =
    [["x", "y", "z", "w"], ["r", "g", "b", "a"], ["0", "1", "2", "3"], ["1", "2", "3", "4"]];
const COLORS: usize = 1;

/// Returns the attributes of an element, and a sentence for each that breaks the rules. The columns in `used` have
/// other meanings.
pub fn groups(element: &Element, used: &[usize]) -> (Vec<Group>, Vec<String>) {
    let (mut groups, mut warnings) = (Vec::new(), Vec::new());
    let scalar = |i: &usize| matches!(element.properties[*i].kind, Kind::Scalar(_));
    let free = |i: &usize| scalar(i) && !used.contains(i);
    let color = color(element).filter(|columns| columns.iter().all(free)).unwrap_or_default();
    if !color.is_empty() {
        groups.push(Group { name: format!("{}_color", element.name), columns: color.clone() });
    }
    let mut columns = (0..element.properties.len()).filter(|i| free(i) && !color.contains(i)).peekable();
    while let Some(first) = columns.next() {
        let Some((prefix, suffix)) = split(&element.properties[first].name) else { continue };
        let mut run = vec![(first, suffix)];
        while let Some(next) = columns.peek() {
            match split(&element.properties[*next].name) {
                Some((same, suffix)) if same == prefix && *next == run[run.len() - 1].0 + 1 => {
                    run.push((*next, suffix));
                    columns.next();
                }
                _ => break,
            }
        }
        let kind = SUFFIXES
            .iter()
            .position(|order| run.iter().map(|(_, s)| *s).eq(order.iter().copied().take(run.len())));
        let name = match kind {
            Some(COLORS) => format!("{}_{prefix}_color", element.name),
            _ => format!("{}_{prefix}", element.name),
        };
        let fault = match (kind, run.len()) {
            (Some(_), 1 | 3) if groups.iter().any(|g| g.name == name) => "there is another of this name",
            (Some(_), 1 | 3) => {
                groups.push(Group { name, columns: run.iter().map(|(i, _)| *i).collect() });
                continue;
            }
            (Some(_), _) => "it must have one or three channels",
            (None, _) => "its channels must be _x _y _z, _r _g _b, _0 _1 _2 or _1 _2 _3",
        };
        warnings.push(format!("the attribute {name} is ignored: {fault}"));
    }
    for group in &groups {
        if group.columns.iter().any(|i| element.properties[*i].kind == Kind::Scalar(Number::U8)) {
            warnings.push(format!(
                "the attribute {} is of type uchar: its values are from 0 to 255, as in Mitsuba",
                group.name
            ));
        }
    }
    (groups, warnings)
}

/// Returns the channels of the colour.
fn color(element: &Element) -> Option<Vec<usize>> {
    let find = |names: [&str; 3], alpha: &str| -> Option<Vec<usize>> {
        let rgb: Option<Vec<usize>> = names.iter().map(|name| element.find(name)).collect();
        Some(rgb?.into_iter().chain(element.find(alpha)).collect())
    };
    find(["r", "g", "b"], "a").or_else(|| find(["red", "green", "blue"], "alpha"))
}

/// Splits a name into a prefix and a one-letter suffix.
fn split(name: &str) -> Option<(&str, &str)> {
    name.rsplit_once('_').filter(|(_, suffix)| suffix.len() == 1)
}

/// Returns the value of an attribute for a number in the file.
pub fn decode(number: Number, value: f64) -> f32 {
    if number == Number::U8 || number.is_float() {
        return value as f32;
    }
    let largest = if number == Number::U64 { u64::MAX as f64 } else { number.range().1 as f64 };
    srgb_to_linear((value / largest) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loader::mesh::ply::header::Property;

    fn element(names: &str) -> Element {
        let property = |name: &str| Property { name: name.to_owned(), kind: Kind::Scalar(Number::F32) };
        Element {
            name: "vertex".to_owned(),
            count: 1,
            properties: names.split_whitespace().map(property).collect(),
        }
    }

    /// Returns the names of the attributes and the indices of their channels.
    fn found(names: &str) -> String {
        let (groups, _) = groups(&element(names), &[]);
        let text: Vec<_> = groups.iter().map(|g| format!("{} {:?}", g.name, g.columns)).collect();
        text.join(" ")
    }

    /// The expected attributes are those of Mitsuba 3.9.1 for the same properties.
    #[test]
    fn attributes_are_those_of_mitsuba() {
        for (names, expected) in [
            ("foo_x", "vertex_foo [0]"),
            ("foo_x foo_y", ""),
            ("foo_x foo_y foo_z", "vertex_foo [0, 1, 2]"),
            ("foo_x foo_y foo_z foo_w", ""),
            ("foo_r foo_g foo_b", "vertex_foo_color [0, 1, 2]"),
            ("foo_r foo_g foo_b foo_a", ""),
            ("w_0 w_1 w_2", "vertex_w [0, 1, 2]"),
            ("w_1 w_2 w_3", "vertex_w [0, 1, 2]"),
            ("w_1", "vertex_w [0]"),
            ("w_x w_z", ""),
            ("w_y", ""),
            ("foo_x foo_r", ""),
            ("foo_x q foo_y", "vertex_foo [0]"),
            ("foo_x q_x foo_y", "vertex_foo [0] vertex_q [1]"),
            ("r g b a", "vertex_color [0, 1, 2, 3]"),
            ("alpha red green blue", "vertex_color [1, 2, 3, 0]"),
            ("r g b alpha", "vertex_color [0, 1, 2]"),
            ("r g", ""),
            ("foo_xx foo", ""),
            ("color_r color_g color_b", "vertex_color_color [0, 1, 2]"),
        ] {
            assert_eq!(found(names), expected, "{names}");
        }
    }

    #[test]
    fn what_breaks_the_rules_is_told() {
        let warnings = |names: &str| groups(&element(names), &[0]).1;
        assert_eq!(
            warnings("x foo_x foo_y w_y"),
            [
                "the attribute vertex_foo is ignored: it must have one or three channels",
                "the attribute vertex_w is ignored: its channels must be _x _y _z, _r _g _b, _0 _1 _2 or _1 _2 _3",
            ]
        );
        assert!(warnings("x quality").is_empty());
    }

    #[test]
    fn integers_are_decoded_as_in_mitsuba() {
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} instead of {b}");
        close(decode(Number::U8, 128.0), 128.0);
        close(decode(Number::I8, -128.0), -0.078009);
        close(decode(Number::I8, 64.0), 0.217703);
        close(decode(Number::U16, 32768.0), 0.214048);
        close(decode(Number::U32, 2147483648.0), 0.214041);
        close(decode(Number::F64, -3.0), -3.0);
    }
}
