#!/usr/bin/env bash
# `pslam record --view` against the real viewer's server: what it shows arrives, and a viewer that stands still or is not
# there costs the recording nothing. Usage: view.sh PSLAM RERUN (the executable of PyPI's rerun-sdk).
set -euo pipefail
pslam=$1 rerun=$2
work=$(mktemp -d)
server=
trap 'if [ -n "$server" ]; then kill -9 "$server" 2>/dev/null || true; fi; rm -rf "$work"' EXIT
port=$((20000 + RANDOM % 20000))
small=(--source synthetic --color 160x120@30 --depth 160x120@30 --imu --reserve 1M)

recorded() { # log: nothing was lost, or all of it is told
    "$pslam" check "$1" | grep -qx sound
}

record() { # log, seconds; exit code 1 is a loaded machine's loss
    "$pslam" --no-progress record "${small[@]}" --duration "$2" --view "rerun+http://127.0.0.1:$port/proxy" -o "$1" \
        >"$work/told.txt" 2>"$work/said.txt" || [ $? = 1 ]
    recorded "$1"
    grep "^preview:" "$work/said.txt"
}

record "$work/alone.mcap" 2s
grep -q "nobody listens" "$work/said.txt"

"$rerun" --save "$work/seen.rrd" --port "$port" >"$work/server.txt" 2>&1 &
server=$!
for _ in $(seq 100); do
    (exec 3<>"/dev/tcp/127.0.0.1/$port") 2>/dev/null && break
    sleep 0.1
done
record "$work/shown.mcap" 4s
grep -q "shown at" "$work/said.txt"

kill -STOP "$server"
record "$work/stopped.mcap" 3s
kill -CONT "$server"
sleep 2
# The shell starts it with SIGINT ignored.
kill -TERM "$server"
wait "$server" || true
server=
"$rerun" rrd print -v "$work/seen.rrd" >"$work/seen.txt" 2>&1
for entity in /camera/color /camera/depth /status/rate /status/lost /log; do
    count=$(grep -c -- "$entity" "$work/seen.txt" || true)
    [ "$count" -gt 0 ] || { echo "FAILED: nothing of $entity arrived" >&2; exit 1; }
    echo "$entity: $count lines in the viewer's file"
done
