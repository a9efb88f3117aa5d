//! Plots of trajectories and their errors as SVG text: same input, same bytes.

pub(crate) mod axis;
pub(crate) mod panel;
pub(crate) mod svg;
pub(crate) mod theme;
pub(crate) mod trajectories;

pub use trajectories::{PlotEstimate, trajectories_svg};
