//! The few SVG elements that plots need.

use std::fmt::Write;

use super::theme::{PAGE, PAPER, Theme};

/// SVG text in the making. Coordinates are pixels, x right, y down.
pub struct Svg {
    text: String,
    theme: Theme,
}

/// Where a text is held.
#[derive(Debug, Clone, Copy)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

const FONT: &str = "font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\" font-size=\"13\"";

impl Svg {
    /// A file of its own.
    pub fn file(width: f64, height: f64) -> Self {
        let mut text = String::new();
        let _ = writeln!(
            text,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" {FONT}>\n<rect width=\"100%\" height=\"100%\" fill=\"{}\"/>",
            PAPER.ground
        );
        Self { text, theme: PAPER }
    }

    /// A part of a page; `label` says what it shows to those who do not see it.
    pub fn inline(width: f64, height: f64, label: &str) -> Self {
        let mut text = String::new();
        let label = escape(label);
        let _ = writeln!(text, "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{label}\" {FONT}>");
        Self { text, theme: PAGE }
    }

    pub fn theme(&self) -> Theme {
        self.theme
    }

    pub fn finish(mut self) -> String {
        self.text.push_str("</svg>\n");
        self.text
    }

    fn line_of(&mut self, element: std::fmt::Arguments<'_>) {
        let _ = self.text.write_fmt(element); // writing to a String cannot fail
        self.text.push('\n');
    }

    pub fn rect(&mut self, [x, y, w, h]: [f64; 4], fill: &str, opacity: f64) {
        self.line_of(format_args!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" fill=\"{fill}\" fill-opacity=\"{opacity}\"/>"
        ));
    }

    pub fn line(&mut self, [x1, y1, x2, y2]: [f64; 4], color: &str, width: f64) {
        self.line_of(format_args!(
            "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{color}\" stroke-width=\"{width}\"/>"
        ));
    }

    pub fn polyline(&mut self, points: &[(f64, f64)], color: &str, width: f64) {
        let mut list = String::new();
        for (x, y) in points {
            let _ = write!(list, "{x:.1},{y:.1} ");
        }
        self.line_of(format_args!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" \
             stroke-linejoin=\"round\" stroke-linecap=\"round\"/>",
            list.trim_end()
        ));
    }

    /// A straight line in dashes.
    pub fn dashes(&mut self, [x1, y1, x2, y2]: [f64; 4], color: &str) {
        self.line_of(format_args!(
            "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{color}\" stroke-width=\"2\" \
             stroke-dasharray=\"2 5\" stroke-linecap=\"round\"/>"
        ));
    }

    /// A filled shape.
    pub fn polygon(&mut self, points: &[(f64, f64)], fill: &str) {
        let mut list = String::new();
        for (x, y) in points {
            let _ = write!(list, "{x:.1},{y:.1} ");
        }
        self.line_of(format_args!("<polygon points=\"{}\" fill=\"{fill}\"/>", list.trim_end()));
    }

    /// Text on top of curves: a copy in the ground's colour below keeps it legible.
    pub fn text_on_curves(&mut self, at: (f64, f64), anchor: Anchor, content: &str) {
        let Theme { ground, ink, .. } = self.theme;
        for style in [format!("stroke=\"{ground}\" stroke-width=\"5\""), format!("fill=\"{ink}\"")] {
            self.text(at, anchor, &format!("font-size=\"12\" {style}"), content);
        }
    }

    pub fn circle(&mut self, (x, y): (f64, f64), r: f64, fill: &str, stroke: &str) {
        self.line_of(format_args!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\" fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"2\"/>"
        ));
    }

    pub fn text(&mut self, (x, y): (f64, f64), anchor: Anchor, style: &str, content: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let content = escape(content);
        self.line_of(format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" {style}>{content}</text>"));
    }

    /// Text that runs upwards.
    pub fn text_up(&mut self, (x, y): (f64, f64), style: &str, content: &str) {
        let turn = format!("transform=\"rotate(-90 {x:.1} {y:.1})\" {style}");
        self.text((x, y), Anchor::Middle, &turn, content);
    }

    /// What is drawn until [`clip_end`](Self::clip_end) shows only inside the box.
    pub fn clip_begin(&mut self, id: &str, [x, y, w, h]: [f64; 4]) {
        self.line_of(format_args!(
            "<clipPath id=\"{id}\"><rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"/></clipPath>\n\
             <g clip-path=\"url(#{id})\">"
        ));
    }

    pub fn clip_end(&mut self) {
        self.line_of(format_args!("</g>"));
    }
}

/// Names come from files and users.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_out() {
        assert_eq!(escape("a<b> & \"c\"\u{1}"), "a&lt;b&gt; &amp; &quot;c&quot; ");
    }
}
