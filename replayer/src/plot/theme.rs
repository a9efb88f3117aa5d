//! What plots are drawn with.

/// Colours of everything but the curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Theme {
    /// Axes.
    pub ink: &'static str,
    /// Lines across the plot.
    pub grid: &'static str,
    /// Titles.
    pub title: &'static str,
    /// Names of axes.
    pub label: &'static str,
    /// Numbers at ticks.
    pub tick: &'static str,
    /// The ground; also the halo of texts.
    pub ground: &'static str,
    /// The true path.
    pub truth: &'static str,
}

/// Black on white, for files that any program shows.
pub const PAPER: Theme = Theme {
    ink: "#333333",
    grid: "#e4e4e4",
    title: "#111111",
    label: "#333333",
    tick: "#666666",
    ground: "#ffffff",
    truth: "#b5b5b5",
};

/// Variables of the page that a plot is part of, so that it follows the page from light to dark.
pub const PAGE: Theme = Theme {
    ink: "var(--ink)",
    grid: "var(--grid)",
    title: "var(--ink)",
    label: "var(--soft)",
    tick: "var(--soft)",
    ground: "var(--ground)",
    truth: "var(--truth)",
};
