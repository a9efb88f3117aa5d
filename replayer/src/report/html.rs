//! The page's text.

use std::fmt::{Display, Write as _};

pub(crate) use crate::plot::svg::escape;

/// A page in the making: sections, and the table of contents that they make.
#[derive(Default)]
pub struct Page {
    body: String,
    contents: Vec<(&'static str, String)>,
}

impl Page {
    /// Markup as it stands.
    pub fn raw(&mut self, markup: impl Display) {
        let _ = writeln!(self.body, "{markup}"); // writing to a String cannot fail
    }

    /// Begins a section; the one before ends.
    pub fn section(&mut self, id: &'static str, title: &str) {
        let close = if self.contents.is_empty() { "" } else { "</section>\n" };
        let title = escape(title);
        self.raw(format_args!("{close}<section id=\"{id}\">\n<h2>{title}</h2>"));
        self.contents.push((id, title));
    }

    pub fn paragraph(&mut self, text: &str) {
        self.raw(format_args!("<p>{}</p>", escape(text)));
    }

    /// A table with named columns whose first cells name the rows. Cells that look like numbers stand right.
    pub fn table(&mut self, caption: &str, head: &[&str], rows: &[Vec<String>]) {
        self.raw(format_args!(
            "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\"><table><caption>{0}</caption>\n<thead><tr>",
            escape(caption)
        ));
        for (column, cell) in head.iter().enumerate() {
            let numbers = column > 0 && rows.iter().any(|row| row.get(column).is_some_and(|cell| is_number(cell)));
            let class = if numbers { " class=\"n\"" } else { "" };
            self.raw(format_args!("<th scope=\"col\"{class}>{}</th>", escape(cell)));
        }
        self.raw("</tr></thead><tbody>");
        for row in rows {
            let cells = row.iter().enumerate().map(|(column, cell)| match column {
                0 => format!("<th scope=\"row\">{}</th>", escape(cell)),
                _ if is_number(cell) => format!("<td class=\"n\">{}</td>", escape(cell)),
                _ => format!("<td>{}</td>", escape(cell)),
            });
            self.raw(format_args!("<tr>{}</tr>", cells.collect::<String>()));
        }
        self.raw("</tbody></table></div>");
    }

    /// The whole document; `header` stands above the contents.
    pub fn finish(self, title: &str, header: &str) -> String {
        let items = self.contents.iter().map(|(id, title)| format!("<li><a href=\"#{id}\">{title}</a></li>"));
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
             style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<link rel=\"icon\" href=\"data:,\">\n\
             <title>{}</title>\n<style>\n{}</style>\n</head>\n<body>\n<header>\n{header}</header>\n\
             <nav aria-label=\"Contents\"><ol>{}</ol></nav>\n<main>\n{}</section>\n</main>\n<script>\n{}</script>\n\
             </body>\n</html>\n",
            escape(title),
            include_str!("page.css"),
            items.collect::<String>(),
            self.body,
            include_str!("page.js"),
        )
    }
}

/// Numbers, also with a unit or a share behind.
fn is_number(cell: &str) -> bool {
    cell.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '+') && cell.len() < 16
}

/// One line of a legend.
pub struct Key {
    pub name: String,
    /// A CSS colour.
    pub color: String,
}

/// What the colours of a figure mean.
pub fn legend(keys: &[Key]) -> String {
    let item = |key: &Key| format!("<li><i style=\"background:{}\"></i>{}</li>", key.color, escape(&key.name));
    format!("<ul class=\"legend\">{}</ul>", keys.iter().map(item).collect::<String>())
}
