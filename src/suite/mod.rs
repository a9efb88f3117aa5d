//! Many logs with several configurations, and the tables a paper shows of them.
//!
//! A suite file (TOML, see [`spec::Suite`]) names sequences, configurations, published figures and tables. Sequences that
//! are not on this machine are said to be missing and left out; everything else is run once and tabulated, or, in a suite
//! with `perturbations`, judged under each of them.

mod degrade;
mod kidnap;
pub mod perturbed;
mod perturbed_table;
mod run;
mod source;
pub mod spec;
mod table;

pub use degrade::Degrade;
pub use run::{Cell, Done, SequenceReport, SuiteReport, run};

/// The suites that come with the program: name and text.
pub const BUILT_IN: [(&str, &str); 9] = [
    ("tum", include_str!("../../fixtures/suites/tum.toml")),
    ("bonn", include_str!("../../fixtures/suites/bonn.toml")),
    ("quadruped", include_str!("../../fixtures/suites/quadruped.toml")),
    ("kitchens", include_str!("../../fixtures/suites/kitchens.toml")),
    ("synthetic", include_str!("../../fixtures/suites/synthetic.toml")),
    ("unseen", include_str!("../../fixtures/suites/unseen.toml")),
    ("rooms", include_str!("../../fixtures/suites/rooms.toml")),
    ("robust", include_str!("../../fixtures/suites/robust.toml")),
    ("hard", include_str!("../../fixtures/suites/hard.toml")),
];
