//! Tables: aligned text for a terminal, Markdown for documents, HTML for a page.

use std::fmt::Write as _;

use crate::page::escape;

/// Rows of cells under a head. The first column is text, the others are set to the right.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
    text_columns: usize,
}

impl Table {
    /// An empty table whose first `text_columns` columns hold words.
    #[must_use]
    pub fn new(text_columns: usize, head: &[&str]) -> Self {
        Self {
            head: head.iter().map(ToString::to_string).collect(),
            rows: Vec::new(),
            text_columns,
        }
    }

    /// Adds a row; missing cells stay empty, those beyond the head are dropped.
    pub fn row(&mut self, mut cells: Vec<String>) {
        cells.resize(self.head.len(), String::new());
        self.rows.push(cells);
    }

    /// It has no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Columns two blanks apart.
    #[must_use]
    pub fn to_text(&self) -> String {
        let widths = self.widths();
        let mut out = String::new();
        for row in self.lines() {
            let mut line = String::new();
            for (c, (cell, width)) in row.iter().zip(&widths).enumerate() {
                line += if c == 0 { "" } else { "  " };
                line += &self.padded(c, cell, *width);
            }
            out += line.trim_end();
            out.push('\n');
        }
        out
    }

    /// As Markdown understands it, aligned to be read as it is as well.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let widths = self.widths();
        let mut out = String::new();
        for (r, row) in self.lines().enumerate() {
            for (c, (cell, width)) in row.iter().zip(&widths).enumerate() {
                let _ = write!(out, "| {} ", self.padded(c, cell, *width));
            }
            out += "|\n";
            if r == 0 {
                for (c, width) in widths.iter().enumerate() {
                    let right = c >= self.text_columns;
                    let dashes = "-".repeat(width.saturating_sub(usize::from(right)));
                    let _ = write!(out, "| {dashes}{} ", if right { ":" } else { "" });
                }
                out += "|\n";
            }
        }
        out
    }

    /// An HTML table, in a box of its own that scrolls where the screen is narrow.
    #[must_use]
    pub fn to_html(&self) -> String {
        let mut out = String::from("<div class=\"scroll\"><table>");
        for (r, row) in self.lines().enumerate() {
            out += "<tr>";
            for (c, cell) in row.iter().enumerate() {
                let tag = if r == 0 { "th" } else { "td" };
                let class = if c < self.text_columns {
                    " class=\"text\""
                } else {
                    ""
                };
                let _ = write!(out, "<{tag}{class}>{}</{tag}>", escape(cell));
            }
            out += "</tr>";
        }
        out + "</table></div>"
    }

    fn lines(&self) -> impl Iterator<Item = &Vec<String>> {
        std::iter::once(&self.head).chain(&self.rows)
    }

    fn widths(&self) -> Vec<usize> {
        let width = |c: usize| {
            self.lines()
                .filter_map(|r| r.get(c))
                .map(|s| s.chars().count())
                .max()
        };
        (0..self.head.len())
            .map(|c| width(c).unwrap_or(0))
            .collect()
    }

    fn padded(&self, column: usize, cell: &str, width: usize) -> String {
        if column < self.text_columns {
            format!("{cell:<width$}")
        } else {
            format!("{cell:>width$}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_table_in_three_ways() {
        let mut table = Table::new(1, &["method", "m"]);
        table.row(vec!["a<b".into(), "0.25".into(), "lost".into()]);
        table.row(vec!["é".into()]);
        assert_eq!(table.to_text(), "method     m\na<b     0.25\né\n");
        assert_eq!(
            table.to_markdown(),
            "| method |    m |\n| ------ | ---: |\n| a<b    | 0.25 |\n| é      |      |\n"
        );
        let html = table.to_html();
        assert!(html.contains("<td class=\"text\">a&lt;b</td><td>0.25</td></tr>"));
    }
}
