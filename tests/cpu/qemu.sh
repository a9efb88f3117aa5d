#!/usr/bin/env bash
# A replay on an older CPU - no AVX, no FMA, no BMI - gives the same bits: qemu hides what the model lacks.
# tests/cpu/qemu.sh PSLAM LOG [FRAMES]
set -euo pipefail
pslam=$1 log=$2 frames=${3:-0..40}
if ! command -v qemu-x86_64 >/dev/null &&
    ! { apt-get update -qq && apt-get install -y -qq --no-install-recommends qemu-user >/dev/null; }; then
    echo "SKIPPED: qemu-user cannot be installed here"
    exit 0
fi
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
fingerprint() { sed -n 's/^ *"fingerprint": "\([0-9a-f]*\)".*/\1/p' "$out/$1/run.json"; }
"$pslam" replay "$log" -o "$out/native" --frames "$frames" >/dev/null
for cpu in Nehalem Haswell; do
    # What the emulator lacks it only warns of; a wrong result would show.
    qemu-x86_64 -cpu "$cpu" "$pslam" replay "$log" -o "$out/$cpu" --frames "$frames" --threads 2 >/dev/null 2>"$out/$cpu.log" ||
        { cat "$out/$cpu.log"; exit 1; }
    echo "$cpu: $(fingerprint "$cpu"), here: $(fingerprint native)"
    [ -n "$(fingerprint native)" ] && [ "$(fingerprint "$cpu")" = "$(fingerprint native)" ]
done
