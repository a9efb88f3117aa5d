#!/usr/bin/env bash
# The recorder against the real librealsense, without a camera: the version that writes .bag and the one that writes .db3.
# A version is skipped only where it cannot be had (fetch.sh, code 2); what else goes wrong with it is a failure.
# Usage: run.sh [DIR], the folder for the libraries.
set -euo pipefail
cd "$(dirname "$0")/../.."
dir=${1:-${CARGO_TARGET_DIR:-target}/ci/librealsense}

tested=0
for version in 2.56.5.9235 2.59.1.11053; do
    code=0
    library=$(tests/realsense/fetch.sh "$version" "$dir") || code=$?
    # 2: a line says why it cannot be had here.
    [ "$code" = 2 ] && continue
    [ "$code" = 0 ] || exit 1
    echo "librealsense $version"
    PSLAM_LIBREALSENSE=$library cargo test --release --package recorder --test realsense
    tested=$((tested + 1))
done
[ "$tested" -gt 0 ] || echo "SKIPPED: the real librealsense: neither version can be had here"
