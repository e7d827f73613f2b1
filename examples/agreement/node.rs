//! Elements of a scene file.

use std::fmt::Write;

/// An element.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    pub tag: &'static str,
    pub attributes: Vec<(&'static str, String)>,
    pub children: Vec<Node>,
}

impl Node {
    pub fn new(tag: &'static str) -> Self {
        Node { tag, attributes: Vec::new(), children: Vec::new() }
    }

    /// Creates an object of a plugin.
    pub fn plugin(tag: &'static str, plugin: impl Into<String>) -> Self {
        Node::new(tag).with("type", plugin)
    }

    /// Creates a named value.
    pub fn value(tag: &'static str, name: &str, value: impl std::fmt::Display) -> Self {
        Node::new(tag).with("name", name).with("value", value.to_string())
    }

    pub fn with(mut self, attribute: &'static str, value: impl Into<String>) -> Self {
        self.attributes.push((attribute, value.into()));
        self
    }

    pub fn named(self, name: &str) -> Self {
        self.with("name", name)
    }

    pub fn add(mut self, child: Node) -> Self {
        self.children.push(child);
        self
    }

    pub fn add_if(self, condition: bool, child: impl FnOnce() -> Node) -> Self {
        if condition { self.add(child()) } else { self }
    }

    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| *key == name).map(|(_, value)| value.as_str())
    }

    /// Returns whether the condition is true for this element or one inside it.
    pub fn any(&self, condition: &impl Fn(&Node) -> bool) -> bool {
        condition(self) || self.children.iter().any(|child| child.any(condition))
    }

    /// Returns the text of a scene file with an integrator.
    pub fn scene(&self, integrator: &Node) -> String {
        let mut text = String::new();
        let mut scene = self.clone();
        scene.children.insert(0, integrator.clone());
        scene.write(0, &mut text);
        text
    }

    fn write(&self, level: usize, text: &mut String) {
        let _ = write!(text, "{:level$}<{}", "", self.tag, level = 2 * level);
        for (name, value) in &self.attributes {
            let _ = write!(text, " {name}=\"{value}\"");
        }
        if self.children.is_empty() {
            text.push_str("/>\n");
            return;
        }
        text.push_str(">\n");
        self.children.iter().for_each(|child| child.write(level + 1, text));
        let _ = writeln!(text, "{:level$}</{}>", "", self.tag, level = 2 * level);
    }

    /// Returns all elements that are simpler by one step, the simplest first: with a child removed, or with a child
    /// replaced by a part of it.
    pub fn simpler(&self) -> Vec<Node> {
        let mut all = Vec::new();
        for i in 0..self.children.len() {
            let mut without = self.clone();
            without.children.remove(i);
            all.push(without);
        }
        for (i, child) in self.children.iter().enumerate() {
            let inside = child.children.iter().filter(|inner| inner.tag == child.tag);
            let names = |inner: &Node| {
                let mut inner = inner.clone();
                inner.attributes.retain(|(key, _)| *key != "name");
                inner.attributes.extend(child.attributes.iter().filter(|(key, _)| *key == "name").cloned());
                inner
            };
            for replacement in inside.map(names).chain(child.simpler()) {
                let mut changed = self.clone();
                changed.children[i] = replacement;
                all.push(changed);
            }
        }
        all
    }
}
