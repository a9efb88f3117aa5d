//! `pslam`: record, replay and inspect RGB-D datasets with a deterministic panoptic SLAM.

use std::process::ExitCode;

fn main() -> ExitCode {
    panoptic_slam::run()
}
