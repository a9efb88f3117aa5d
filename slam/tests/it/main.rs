//! The slam seen from outside: the map, the search, the filter on little scenes, the pipeline on synthetic worlds.

#![allow(clippy::unwrap_used, missing_docs)] // a test may panic, and has no readers of its documentation

mod config;
mod consensus;
mod corridor;
mod filter;
mod filter_selection;
mod ground;
mod jobs;
mod joining;
mod judgement;
mod loops;
mod loss;
mod map;
mod map_edits;
mod matching;
mod observation;
mod offline;
mod paper_rule;
mod pipeline;
mod scene;
mod sensors;
mod support;
