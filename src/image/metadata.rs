//! Metadata: named values of an image, as OpenEXR attributes.

/// One metadata value, with the types of OpenEXR.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A 32-bit integer.
    Int(i32),
    /// A 32-bit float.
    Float(f32),
    /// Text.
    Text(String),
    /// A 4x4 matrix in OpenEXR's order: row vectors, with the translation in elements 12 to 14.
    Matrix([f32; 16]),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Int(value) => write!(f, "{value}"),
            Value::Float(value) => write!(f, "{value}"),
            Value::Text(value) => write!(f, "{value}"),
            Value::Matrix(m) => {
                for (i, value) in m.iter().enumerate() {
                    let before = if i == 0 {
                        ""
                    } else if i % 4 == 0 {
                        "; "
                    } else {
                        " "
                    };
                    write!(f, "{before}{value}")?;
                }
                Ok(())
            }
        }
    }
}

/// Metadata in insertion order. Reading a file returns them sorted by name.
///
/// Names are those of OpenEXR: `Software`, `worldToCamera`, `worldToNDC`, `comments`, `owner`. Other names are stored
/// unchanged. PNG, JPEG and PFM files have no metadata.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metadata {
    entries: Vec<(String, Value)>,
}

impl Metadata {
    /// Creates empty metadata.
    pub fn new() -> Self {
        Metadata::default()
    }

    /// Sets a value; an existing one of the same name is replaced in its position.
    pub fn set(&mut self, name: impl Into<String>, value: Value) {
        let name = name.into();
        match self.entries.iter_mut().find(|(n, _)| *n == name) {
            Some(entry) => entry.1 = value,
            None => self.entries.push((name, value)),
        }
    }

    /// Returns the metadata with a value set.
    pub fn with(mut self, name: impl Into<String>, value: Value) -> Self {
        self.set(name, value);
        self
    }

    /// Returns the value of a name.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.entries.iter().find(|(n, _)| n == name).map(|(_, value)| value)
    }

    /// Iterates over names and values in order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.entries.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Returns the number of values.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Returns whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Sorts by name, which is the order in an OpenEXR file.
    pub(super) fn sort(&mut self) {
        self.entries.sort_by(|a, b| a.0.cmp(&b.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_set_twice_keeps_its_place() {
        let mut m = Metadata::new().with("b", Value::Int(1)).with("a", Value::Float(0.5));
        m.set("b", Value::Text("x".into()));
        assert_eq!(m.iter().map(|(n, _)| n).collect::<Vec<_>>(), ["b", "a"]);
        assert_eq!(m.get("b"), Some(&Value::Text("x".into())));
        assert_eq!(m.get("c"), None);
        m.sort();
        assert_eq!(m.iter().next().map(|(n, _)| n), Some("a"));
    }

    #[test]
    fn a_matrix_prints_row_by_row() {
        let m = Value::Matrix(std::array::from_fn(|i| i as f32));
        assert_eq!(m.to_string(), "0 1 2 3; 4 5 6 7; 8 9 10 11; 12 13 14 15");
    }
}
