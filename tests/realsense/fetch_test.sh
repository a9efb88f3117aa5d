#!/usr/bin/env bash
# What fetch.sh takes for "cannot be had here" and what for a failure, with registries of our own on this computer.
set -euo pipefail
cd "$(dirname "$0")"
[ "$(uname -sm)" = "Linux x86_64" ] || { echo "SKIPPED: the wheel of librealsense is for Linux on x86-64"; exit 0; }
work=$(mktemp -d)
server=
trap 'if [ -n "$server" ]; then kill "$server" 2>/dev/null || true; fi; rm -rf "$work"' EXIT
version=2.59.1.11053 name=pyrealsense2-2.59.1.11053-cp311-cp311-manylinux1_x86_64.whl
export PIP_RETRIES=0 PIP_CONFIG_FILE=/dev/null no_proxy=127.0.0.1
unset PIP_NO_INDEX PIP_FIND_LINKS PIP_EXTRA_INDEX_URL

expect() { # code, words, folder
    local code=0
    ./fetch.sh "$version" "$work/$3" >"$work/out.txt" 2>"$work/err.txt" || code=$?
    { [ "$code" = "$1" ] && grep -q "$2" "$work/err.txt"; } ||
        { echo "FAILED: code $code instead of $1, and: $(cat "$work/err.txt")" >&2; exit 1; }
    echo "code $code: $(grep "$2" "$work/err.txt" | tail -1)"
}

# What stands in for the system's libraries is asked first and is not what is tested here.
for library in libpython3.11.so.1.0 libusb-1.0.so.0 libudev.so.1; do
    ldconfig -p | grep -q "$library " ||
        { echo "SKIPPED: $library is not installed yet: run tests/realsense/run.sh"; exit 0; }
done

PIP_INDEX_URL=http://127.0.0.1:9/simple expect 2 "SKIPPED: .*cannot be reached" unreachable

mkdir -p "$work/registry/simple/pyrealsense2"
python3 -u -m http.server --bind 127.0.0.1 --directory "$work/registry" 0 >"$work/server.txt" 2>/dev/null &
server=$!
until port=$(grep -o 'port [0-9]*' "$work/server.txt"); do sleep 0.05; done
export PIP_INDEX_URL=http://127.0.0.1:${port#port }/simple
echo "<!DOCTYPE html>" >"$work/registry/simple/pyrealsense2/index.html"
expect 1 "FAILED: .*does not give the wheel" absent

python3 - "$work/registry/simple/pyrealsense2/$name" <<'PYTHON'
import sys, zipfile
with zipfile.ZipFile(sys.argv[1], "w") as wheel:
    wheel.writestr("pyrealsense2/__init__.py", "")
    wheel.writestr("pyrealsense2-2.59.1.11053.dist-info/METADATA", "Metadata-Version: 2.1\nName: pyrealsense2\nVersion: 2.59.1.11053\n")
    wheel.writestr("pyrealsense2-2.59.1.11053.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: cp311-cp311-manylinux1_x86_64\n")
    wheel.writestr("pyrealsense2-2.59.1.11053.dist-info/RECORD", "")
PYTHON
echo "<!DOCTYPE html><a href=\"$name\">$name</a>" >"$work/registry/simple/pyrealsense2/index.html"
expect 1 "FAILED: .*wrong checksum" forged
[ ! -e "$work/forged/$version/$name" ] || { echo "FAILED: a forged wheel is kept" >&2; exit 1; }
echo "a registry that cannot be reached is skipped; a missing or forged wheel fails"
