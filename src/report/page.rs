//! A page in one file, which contains its style and script and requests nothing else.

use super::html::{Html, add, escape};
use super::machine;
use crate::error::Result;
use crate::util::replace;
use std::path::Path;

/// The style of pages.
pub const STYLE: &str = include_str!("page.css");
/// The script of what shows images: colours, and a canvas with zoom and pan.
pub const STAGE: &str = include_str!("stage.js");
const SCRIPT: &str = include_str!("page.js");

/// The page may load only what it contains. A browser reports any other request as an error.
const POLICY: &str = include_str!("policy.txt");

/// A page.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Page {
    title: String,
    lead: Html,
    sections: Vec<(String, Html)>,
    facts: Vec<(String, String)>,
}

impl Page {
    /// Creates a page with a title and no section.
    pub fn new(title: impl Into<String>) -> Self {
        Page { title: title.into(), ..Page::default() }
    }

    /// Appends to the text under the title: what was done, and its result.
    pub fn lead(&mut self, content: &Html) {
        self.lead.push(content);
    }

    /// Adds a section.
    pub fn section(&mut self, title: impl Into<String>, content: Html) {
        self.sections.push((title.into(), content));
    }

    /// Adds a line to the footer.
    pub fn fact(&mut self, name: impl Into<String>, value: impl Into<String>) {
        self.facts.push((name.into(), value.into()));
    }

    /// Adds machine, versions, command line and date to the footer.
    pub fn circumstances(&mut self) {
        self.facts.extend(machine::facts().into_iter().map(|(name, value)| (name.to_string(), value)));
    }

    /// Returns the page.
    pub fn html(&self) -> String {
        let (title, policy) = (escape(&self.title), POLICY.trim_end());
        let mut text = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header>\n<h1>{title}</h1>\n{}",
            self.lead.as_str()
        );
        if self.sections.len() > 1 {
            text.push_str("<nav aria-label=\"Sections\"><ul>\n");
            for (i, (title, _)) in self.sections.iter().enumerate() {
                add(&mut text, format_args!("<li><a href=\"#section-{i}\">{}</a></li>\n", escape(title)));
            }
            text.push_str("</ul></nav>\n");
        }
        text.push_str("</header>\n<main>\n");
        for (i, (title, content)) in self.sections.iter().enumerate() {
            add(
                &mut text,
                format_args!(
                    "<section id=\"section-{i}\">\n<h2>{}</h2>\n{}</section>\n",
                    escape(title),
                    content.as_str()
                ),
            );
        }
        text.push_str("</main>\n<footer>\n<dl>\n");
        for (name, value) in &self.facts {
            add(&mut text, format_args!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(value)));
        }
        add(
            &mut text,
            format_args!("</dl>\n</footer>\n<script>\n{STAGE}{SCRIPT}</script>\n</body>\n</html>\n"),
        );
        text
    }

    /// Writes the page to a file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        replace(path, self.html().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_asks_nobody_for_anything_and_escapes_names() {
        let mut page = Page::new("<Bench> & \"more\"");
        page.lead(&Html::paragraph("a < b"));
        page.section("one <i>", Html::paragraph("x"));
        page.section("two", Html::paragraph("y"));
        page.fact("command", "buffon bench '<a>.xml'");
        page.circumstances();
        let html = page.html();
        for outside in ["http://", "https://", "src=\"//", "url(", "@import", "<link", "import("] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert!(html.contains("<title>&lt;Bench&gt; &amp; &quot;more&quot;</title>"));
        assert!(html.contains("<a href=\"#section-0\">one &lt;i&gt;</a>"));
        assert!(html.contains("<dd>buffon bench &#39;&lt;a&gt;.xml&#39;</dd>"));
        assert_eq!(html.matches("<script").count(), 1);
        assert_eq!(
            [STAGE, SCRIPT].concat().matches("</script").count() + STYLE.matches("</style").count(),
            0
        );
    }
}
