//! `pslam`: record, replay and inspect RGB-D datasets with a deterministic panoptic SLAM.
fn main() {}
