#!/usr/bin/env bash
# Usage: fetch.sh VERSION DIR. Prints the path of librealsense VERSION, which it takes from the Python wheel
# `pyrealsense2` into DIR unless it is there. Exit code 2: it cannot be had here; a line on standard error says why.
set -euo pipefail
version=$1 dir=$2/$1
library=$dir/pyrealsense2/pyrealsense2.cpython-311-x86_64-linux-gnu.so

give_up() {
    echo "SKIPPED: librealsense $version: $1" >&2
    exit 2
}

[ "$(uname -sm)" = "Linux x86_64" ] || give_up "its wheel is for Linux on x86-64"
# The wheel's library needs these; Debian's names.
missing=()
for pair in libpython3.11.so.1.0:libpython3.11 libusb-1.0.so.0:libusb-1.0-0 libudev.so.1:libudev1; do
    ldconfig -p | grep -q "${pair%%:*} " || missing+=("${pair##*:}")
done
if [ "${#missing[@]}" -gt 0 ]; then
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends "${missing[@]}"; } >&2 ||
        give_up "apt-get install ${missing[*]} fails"
fi
if [ ! -f "$library" ]; then
    mkdir -p "$dir"
    python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: --python-version 311 \
        --platform manylinux1_x86_64 -d "$dir" "pyrealsense2==$version" >&2 || give_up "the wheel cannot be downloaded"
    python3 -m zipfile -e "$dir"/pyrealsense2-"$version"-*.whl "$dir"
fi
realpath "$library"
