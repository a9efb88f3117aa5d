#!/usr/bin/env bash
# A synthetic D435i inside the real librealsense and a simulated Vicon, recorded together: from librealsense's software
# device, and from recordings by librealsense (.bag, .db3) that are played as cameras. Planted faults must be found, every
# pixel and metadata value must be what was fed, offset, drift and hand-eye transform what was planted; the log replays.
# MODE is the size and rate, 640x480@30 if not set; WAYS which of `live` and `play`; LENS bends the colour pictures, as
# 0.12,-0.05,0.001,-0.001,0; VERSIONS which of `2.56.5.9235:bag` and `2.59.1.11053:db3`.
# Usage: end_to_end.sh PSLAM SYNTHETIC_D435I PYTHON SECONDS [DIR]; PYTHON has the packages mcap and mcap-ros2-support.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
mode=${MODE:-640x480@30} ways=${WAYS:-live play}
pslam=$1 d435i=$2 python=$3 seconds=$4
libraries=${5:-${CARGO_TARGET_DIR:-$here/target}/ci/librealsense}
versions=${VERSIONS:-2.56.5.9235:bag 2.59.1.11053:db3}
work=$(mktemp -d)
sim=
trap 'if [ -n "$sim" ]; then kill "$sim" 2>/dev/null || true; fi; rm -rf "$work"' EXIT

offset_ms=37.3 drift_ppm=20 marker=0.05,-0.03,0.02,0.1,-0.2,0.05,0.9733
plan=(pictures "$work/pictures" seconds "$seconds" mode "$mode" usb 2.1 drift "$drift_ppm" wrap 2 drop color:40-44 drop depth:50-50)
[ -z "${LENS:-}" ] || plan+=(lens "$LENS")

exits() { # wanted code, command...
    local wanted=$1 code=0
    shift
    "$@" || code=$?
    [ "$code" = "$wanted" ] || { echo "FAILED: exit code $code instead of $wanted: $*" >&2; exit 1; }
}

start_sim() {
    : >"$work/sim.txt"
    epoch=$("$python" -c "import time; print(time.monotonic_ns())")
    "$pslam" sim vicon "$work/truth.txt" --subject quad --listen 127.0.0.1:0 --epoch-monotonic-ns "$epoch" \
        --offset-ms "$offset_ms" --marker-from-camera="$marker" --fault drop --fault occlude >"$work/sim.txt" &
    sim=$!
    until grep -q . "$work/sim.txt"; do
        kill -0 "$sim" || { echo "FAILED: the simulator did not start" >&2; exit 1; }
        sleep 0.05
    done
    address=$(awk 'NR == 1 { print $2 }' "$work/sim.txt")
}

stop_sim() {
    kill "$sim" 2>/dev/null || true
    wait "$sim" || true
    sim=
}

inspect() { # log, what the recorder told
    local log=$1 told=$2
    "$python" "$here/tests/record/planted.py" "$log" "$told" "$seconds"
    "$d435i" compare "$log" "${plan[@]}" 2>/dev/null
    exits 0 "$pslam" check "$log" >"$work/check.txt"
    grep -q "color: 5 lost by the device: 40..=44" "$work/check.txt"
    rm -rf "$work/run"
    exits 0 "$pslam" --no-progress replay "$log" -o "$work/run" >/dev/null
    exits 0 "$pslam" --no-progress verify "$work/run" --threads 1
    exits 0 "$pslam" --no-progress sync "$log" --poses "$work/run" --max-offset-ms 20000 --json >"$work/sync.json"
    "$python" "$here/tests/record/planted_sync.py" "$log" "$work/sync.json" "$epoch" "$offset_ms" "$drift_ppm" "$marker"
}

echo "rendering"
"$d435i" truth "$work/truth.txt" "${plan[@]}" 2>/dev/null
for pair in $versions; do
    version=${pair%:*}
    code=0
    library=$("$here/tests/realsense/fetch.sh" "$version" "$libraries") || code=$?
    # 2: it cannot be had here, and a line says why.
    [ "$code" = 2 ] && continue
    [ "$code" = 0 ]
    export PSLAM_LIBREALSENSE=$library
    for way in $ways; do
        file=$work/planted.${pair#*:} log=$work/$way.mcap told=$work/told.txt
        rm -f "$log"
        if [ "$way" = live ]; then
            echo "librealsense $version: its software device"
            start_sim
            exits 0 "$d435i" live "$log" "${plan[@]}" vicon "quad@$address" >"$told" 2>"$work/findings.txt"
            grep -q "finding: the camera is on a USB 2.1 link" "$work/findings.txt"
        else
            echo "librealsense $version: a ${pair#*:} recording; its USB 2 link is refused, then allowed"
            "$d435i" file "$file" "${plan[@]}" 2>/dev/null
            camera=(--color "$mode" --depth "$mode" --imu --play "$file")
            exits 2 "$pslam" record "${camera[@]}" -o "$log" 2>"$work/refused.txt"
            grep -q -- "--allow-usb2" "$work/refused.txt"
            start_sim
            # The planted drops are losses: exit code 1.
            exits 1 "$pslam" --no-progress record "${camera[@]}" --allow-usb2 --reserve 100M --vicon "$address" \
                --subject quad --json -o "$log" >"$told"
            rm "$file"
        fi
        inspect "$log" "$told"
        stop_sim
    done
done
