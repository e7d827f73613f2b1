//! Tables, for a terminal and for a page.

use super::html::{Html, add, escape};

/// The alignment of the cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Left, for names.
    Left,
    /// Right, for numbers.
    Right,
}

/// A row of a [`Table`].
#[derive(Clone, Debug, PartialEq, Eq)]
enum TableRow {
    Cells(Vec<String>),
    /// The first cells, and a sentence in place of the others.
    Remark(Vec<String>, String),
}

/// A table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    columns: Vec<(String, Align)>,
    rows: Vec<TableRow>,
}

impl Table {
    /// Creates an empty table with titled columns.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = (S, Align)>) -> Self {
        Table { columns: columns.into_iter().map(|(t, a)| (t.into(), a)).collect(), rows: Vec::new() }
    }

    /// Adds a row with one cell for each column.
    ///
    /// # Panics
    /// If there are more or fewer cells than columns.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        let cells: Vec<String> = cells.into_iter().map(Into::into).collect();
        assert_eq!(cells.len(), self.columns.len(), "one cell for each column");
        self.rows.push(TableRow::Cells(cells));
    }

    /// Adds a row with fewer cells than columns, and in place of the others a sentence that says why they are missing.
    ///
    /// # Panics
    /// If there are as many cells as columns, or more.
    pub fn remark<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>, remark: impl Into<String>) {
        let cells: Vec<String> = cells.into_iter().map(Into::into).collect();
        assert!(cells.len() < self.columns.len(), "fewer cells than columns");
        self.rows.push(TableRow::Remark(cells, remark.into()));
    }

    /// Returns whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the lines of text, with two spaces between columns.
    pub fn text(&self) -> String {
        let mut widths: Vec<usize> = self.columns.iter().map(|(title, _)| width(title)).collect();
        for row in &self.rows {
            let (TableRow::Cells(cells) | TableRow::Remark(cells, _)) = row;
            for (w, cell) in widths.iter_mut().zip(cells) {
                *w = (*w).max(width(cell));
            }
        }
        let line = |cells: &[String], rest: &str| {
            let mut line = String::new();
            for ((cell, w), (_, align)) in cells.iter().zip(&widths).zip(&self.columns) {
                let gap = " ".repeat(w - width(cell));
                match align {
                    Align::Left => line.extend([cell.as_str(), &gap, "  "]),
                    Align::Right => line.extend([gap.as_str(), cell, "  "]),
                }
            }
            line.push_str(rest);
            line.truncate(line.trim_end().len());
            line + "\n"
        };
        let titles: Vec<String> = self.columns.iter().map(|(title, _)| title.clone()).collect();
        let mut text = line(&titles, "");
        for row in &self.rows {
            text.push_str(&match row {
                TableRow::Cells(cells) => line(cells, ""),
                TableRow::Remark(cells, remark) => line(cells, remark),
            });
        }
        text
    }

    /// Returns the mark-up. The table scrolls sideways on a narrow screen.
    pub fn html(&self) -> Html {
        let class = |i: usize| match self.columns.get(i) {
            Some((_, Align::Right)) => " class=\"number\"",
            _ => "",
        };
        let mut text =
            String::from("<div class=\"table\" tabindex=\"0\" role=\"region\"><table>\n<thead><tr>");
        for (i, (title, _)) in self.columns.iter().enumerate() {
            add(&mut text, format_args!("<th scope=\"col\"{}>{}</th>", class(i), escape(title)));
        }
        text.push_str("</tr></thead>\n<tbody>\n");
        for row in &self.rows {
            text.push_str("<tr>");
            let (TableRow::Cells(cells) | TableRow::Remark(cells, _)) = row;
            for (i, cell) in cells.iter().enumerate() {
                add(&mut text, format_args!("<td{}>{}</td>", class(i), escape(cell)));
            }
            if let TableRow::Remark(_, remark) = row {
                let span = self.columns.len() - cells.len();
                add(
                    &mut text,
                    format_args!("<td class=\"remark\" colspan=\"{span}\">{}</td>", escape(remark)),
                );
            }
            text.push_str("</tr>\n");
        }
        text.push_str("</tbody></table></div>\n");
        Html::raw(text)
    }
}

/// Returns the columns that a text takes in a terminal. Combining and wide characters are counted as one column; they
/// occur only in file names, and misaligned columns are accepted for these.
fn width(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table =
            Table::new([("name", Align::Left), ("seconds", Align::Right), ("relMSE", Align::Right)]);
        table.row(["α<β", "1.25", "1e-3"]);
        table.remark(["long name"], "cannot do it");
        table
    }

    #[test]
    fn columns_are_flush() {
        let expected = "name       seconds  relMSE\n\
                        α<β           1.25    1e-3\n\
                        long name  cannot do it\n";
        assert_eq!(table().text(), expected);
    }

    #[test]
    fn mark_up_is_well_formed_and_escaped() {
        let html = table().html();
        let document = roxmltree::Document::parse(html.as_str()).expect("well-formed");
        let cells: Vec<&str> =
            document.descendants().filter(|n| n.has_tag_name("td")).flat_map(|n| n.text()).collect();
        assert_eq!(cells, ["α<β", "1.25", "1e-3", "long name", "cannot do it"]);
        assert!(html.as_str().contains("colspan=\"2\""));
    }
}
