#!/usr/bin/env bash
# Records a synthetic D435i, played by the real librealsense, together with a simulated Vicon; planted faults must be found.
# MODE is the size and rate, 640x480@30 if not set.
# Usage: end_to_end.sh PSLAM MAKE_RECORDING PYTHON SECONDS [DIR]; PYTHON has the packages mcap and mcap-ros2-support.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
mode=${MODE:-640x480@30}
pslam=$1 make_recording=$2 python=$3 seconds=$4
libraries=${5:-${CARGO_TARGET_DIR:-$here/target}/ci/librealsense}
work=$(mktemp -d)
sim=
trap 'if [ -n "$sim" ]; then kill "$sim" 2>/dev/null || true; fi; rm -rf "$work"' EXIT

exits() { # wanted code, command...
    local wanted=$1 code=0
    shift
    "$@" || code=$?
    [ "$code" = "$wanted" ] || { echo "FAILED: exit code $code instead of $wanted: $*" >&2; exit 1; }
}

start_sim() { # faults...
    : >"$work/sim.txt"
    "$pslam" sim vicon synthetic:demo --subject quad --loop --listen 127.0.0.1:0 "$@" >"$work/sim.txt" &
    sim=$!
    until grep -q . "$work/sim.txt"; do sleep 0.1; done
    address=$(awk 'NR == 1 { print $2 }' "$work/sim.txt")
}

stop_sim() {
    kill "$sim"
    wait "$sim" || true
    sim=
}

start_sim --fault drop --fault occlude
exits 1 "$pslam" --no-progress record --source none --vicon "$address" --duration 4 --reserve 100M -o "$work/mocap.mcap" \
    >"$work/told.txt"
stop_sim
"$python" "$here/tests/record/planted_mocap.py" "$work/mocap.mcap"

for pair in 2.56.5.9235:bag 2.59.1.11053:db3; do
    version=${pair%:*}
    library=$("$here/tests/realsense/fetch.sh" "$version" "$libraries") || continue
    export PSLAM_LIBREALSENSE=$library
    file=$work/planted.${pair#*:} log=$work/$version.mcap
    "$make_recording" "$file" seconds "$seconds" mode "$mode" usb 2.1 drift 20 wrap 2 \
        drop color:40-44 drop depth:50-50 >"$work/made.txt"
    start_sim --offset-ms 37.3 --drift-ppm 20

    echo "librealsense $version: a USB 2 link is refused, then allowed"
    camera=(--color "$mode" --depth "$mode" --imu --play "$file" --unpaced)
    exits 2 "$pslam" record "${camera[@]}" -o "$log" 2>"$work/refused.txt"
    grep -q -- "--allow-usb2" "$work/refused.txt"
    # The planted drops are losses: exit code 1.
    exits 1 "$pslam" --no-progress record "${camera[@]}" --allow-usb2 --reserve 100M --vicon "$address" --subject quad \
        --json -o "$log" >"$work/told.txt"
    "$python" "$here/tests/record/planted.py" "$log" "$work/told.txt" "$seconds"
    exits 0 "$pslam" check "$log" >"$work/check.txt"
    grep -q "color 40..=44: 5 lost, by the device" "$work/check.txt"
    exits 0 "$pslam" replay "$log" -o "$work/run-$version" >/dev/null
    exits 0 "$pslam" verify "$work/run-$version"
    stop_sim
done
