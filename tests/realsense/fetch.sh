#!/usr/bin/env bash
# Usage: fetch.sh VERSION DIR. Prints the path of librealsense VERSION, which it takes from the Python wheel
# `pyrealsense2` into DIR unless it is there. Exit code 2: it cannot be had here, because this is no Linux on x86-64 or a
# registry cannot be reached; a line on standard error says which. Everything else that goes wrong is a failure, code 1: a
# wheel that the registry does not have, one with a wrong checksum, packages that do not install.
set -euo pipefail
version=$1 dir=$2/$1
wheel=$dir/pyrealsense2-$version-cp311-cp311-manylinux1_x86_64.whl
library=$dir/pyrealsense2/pyrealsense2.cpython-311-x86_64-linux-gnu.so
case $version in
2.56.5.9235) sha256=76d384ea99f257b4697a82cb3581b05cc69fadfd0701021ad76da098a3e240f0 ;;
2.59.1.11053) sha256=04593436a55be82f147a485a261a601e35b49b2a3b25c35e2ad6eb5a775bdde1 ;;
*) sha256= ;;
esac

skip() {
    echo "SKIPPED: librealsense $version: $1" >&2
    exit 2
}

fail() {
    echo "FAILED: librealsense $version: $1" >&2
    exit 1
}

# Any answer at all, a refusal too, comes from a registry that can be reached; a gateway's word for "nobody there" does not.
can_reach() { # URL
    timeout 60 python3 - "$1" <<'PYTHON'
import sys, urllib.error, urllib.request
try:
    urllib.request.urlopen(sys.argv[1], timeout=15).read(1)
except urllib.error.HTTPError as error:
    sys.exit(error.code in (407, 502, 503, 504))
except OSError as error:
    print(error, file=sys.stderr)
    sys.exit(1)
PYTHON
}

[ "$(uname -sm)" = "Linux x86_64" ] || skip "its wheel is for Linux on x86-64"
[ -n "$sha256" ] || fail "no checksum is known for this version"
# The wheel's library needs these; Debian's names.
missing=()
for pair in libpython3.11.so.1.0:libpython3.11 libusb-1.0.so.0:libusb-1.0-0 libudev.so.1:libudev1; do
    ldconfig -p | grep -q "${pair%%:*} " || missing+=("${pair##*:}")
done
if [ "${#missing[@]}" -gt 0 ]; then
    command -v apt-get >/dev/null || fail "install what Debian calls ${missing[*]}"
    # Without this setting a registry that cannot be reached is no error to apt.
    if ! apt-get update -qq -o APT::Update::Error-Mode=any >&2; then
        hosts=$(apt-get indextargets --format '$(SITE)' | sort -u)
        for site in $hosts; do
            can_reach "$site" || skip "Debian's registry $site cannot be reached"
        done
        fail "apt-get update fails, though $(echo $hosts) can be reached"
    fi
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >&2 || fail "apt-get install ${missing[*]} fails"
fi
if [ ! -f "$wheel" ]; then
    mkdir -p "$dir"
    loading=$(mktemp -d "$dir/loading.XXXXXX")
    trap 'rm -rf "$loading"' EXIT
    if ! python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
        --python-version 311 --platform manylinux1_x86_64 -d "$loading" "pyrealsense2==$version" >&2; then
        index=${PIP_INDEX_URL:-$(python3 -m pip config get global.index-url 2>/dev/null || echo https://pypi.org/simple)}
        can_reach "${index%/}/pyrealsense2/" || skip "the registry ${index##*@} cannot be reached"
        fail "the registry can be reached and does not give the wheel"
    fi
    mv "$loading/${wheel##*/}" "$wheel"
fi
if ! echo "$sha256  $wheel" | sha256sum --check --quiet >&2; then
    rm -f "$wheel"
    fail "the wheel has a wrong checksum; it is removed"
fi
if [ ! -f "$library" ]; then
    unpacked=$(mktemp -d "$dir/unpacked.XXXXXX")
    python3 -m zipfile -e "$wheel" "$unpacked" || fail "the wheel does not unpack"
    rm -rf "$dir/pyrealsense2"
    mv "$unpacked/pyrealsense2" "$dir/"
    rm -rf "$unpacked"
fi
realpath "$library"
