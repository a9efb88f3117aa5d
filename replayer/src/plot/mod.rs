//! Plots of trajectories and their errors as SVG text: same input, same bytes.

mod axis;
mod panel;
mod svg;
mod trajectories;

pub use trajectories::{PlotEstimate, trajectories_svg};
