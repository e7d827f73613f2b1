//! HTML: text is escaped when it is added, so that no name can break a page.

use std::fmt::Write;

/// Well-formed HTML.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Html(String);

impl Html {
    /// Escapes text.
    pub fn text(text: &str) -> Self {
        Html(escape(text))
    }

    /// Creates a paragraph of escaped text.
    pub fn paragraph(text: &str) -> Self {
        Html::element("p", "", &Html::text(text))
    }

    /// Creates an element around other mark-up, with a class unless it is empty.
    pub fn element(tag: &str, class: &str, content: &Html) -> Self {
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{}\"", escape(class)) };
        Html(format!("<{tag}{class}>{}</{tag}>\n", content.0))
    }

    /// Creates a list of escaped texts.
    pub fn list<S: AsRef<str>>(items: impl IntoIterator<Item = S>) -> Self {
        let mut content = Html::default();
        for item in items {
            content.push(&Html::element("li", "", &Html::text(item.as_ref())));
        }
        Html::element("ul", "", &content)
    }

    /// Creates HTML from mark-up that is already well-formed and escaped.
    pub(super) fn raw(markup: impl Into<String>) -> Self {
        Html(markup.into())
    }

    /// Appends mark-up.
    pub fn push(&mut self, other: &Html) {
        self.0.push_str(&other.0);
    }

    /// Returns the mark-up.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Escapes all characters that have a meaning in HTML, for content and for quoted attributes. Characters that are not
/// allowed in HTML or XML become U+FFFD.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\n' | '\t' => escaped.push(c),
            c if c.is_control() => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// Appends formatted mark-up to a string.
pub(super) fn add(to: &mut String, markup: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = to.write_fmt(markup);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_out() {
        let hostile = "</script><img src=x onerror='alert(\"1\")'>&\u{0}";
        let text = Html::text(hostile);
        assert!(!text.as_str().contains(['<', '>', '"', '\'', '\u{0}']), "{text:?}");
        assert_eq!(escape("a < b & \"c\""), "a &lt; b &amp; &quot;c&quot;");
        assert_eq!(Html::element("p", "a\"b", &Html::text("x")).as_str(), "<p class=\"a&quot;b\">x</p>\n");
    }

    #[test]
    fn lists_hold_their_items() {
        assert_eq!(Html::list(["a", "<"]).as_str(), "<ul><li>a</li>\n<li>&lt;</li>\n</ul>\n");
    }
}
