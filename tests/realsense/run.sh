#!/usr/bin/env bash
# The recorder against the real librealsense, without a camera: the version that writes .bag and the one that writes .db3.
# Usage: run.sh [DIR], the folder for the libraries.
set -euo pipefail
cd "$(dirname "$0")/../.."
dir=${1:-${CARGO_TARGET_DIR:-target}/ci/librealsense}

for version in 2.56.5.9235 2.59.1.11053; do
    if library=$(tests/realsense/fetch.sh "$version" "$dir"); then
        echo "librealsense $version"
        PSLAM_LIBREALSENSE=$library cargo test --release --package recorder --test realsense
    fi
done
