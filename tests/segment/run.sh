#!/usr/bin/env bash
# Networks for real: hand-made models and, where the models and a sequence are there, a log annotated by both runtimes.
# Usage: run.sh [DIR], the folder for ONNX Runtime and logs. Needs PyPI for ONNX Runtime.
set -euo pipefail
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}
dir=${1:-$target/ci/segment}
mkdir -p "$dir"

version=1.32.0
library=$dir/libonnxruntime.so.$version
if [ ! -f "$library" ]; then
    if python3 -m pip download --quiet --no-deps --only-binary=:all: -d "$dir" "onnxruntime==$version"; then
        python3 -c "import sys, zipfile; open(sys.argv[2], 'wb').write(zipfile.ZipFile(sys.argv[1]).read(sys.argv[3]))" \
            "$dir"/onnxruntime-$version-*.whl "$library" "onnxruntime/capi/libonnxruntime.so.$version"
    else
        echo "SKIPPED: ONNX Runtime $version cannot be installed here"
    fi
fi
if [ -f "$library" ]; then
    ORT_DYLIB_PATH=$(realpath "$library")
    export ORT_DYLIB_PATH
fi
cargo test --release --package segment --features rten,ort
cargo clippy --release --package panoptic-slam --package segment --features networks,segment/rten,segment/ort -- -D warnings

models=../shared/models data=../shared/data/kitchen_robots_people
if [ ! -d "$models" ] || [ ! -d "$data" ]; then
    echo "SKIPPED: $models or $data is not there"
    exit 0
fi
cargo build --release --package panoptic-slam --features networks
pslam=$target/release/pslam
described=(--models-dir "$models")
for toml in fixtures/models/*.toml; do described+=(--model "$toml"); done
"$pslam" import tum "$data" -o "$dir/log.mcap" --panoptic "$data/panoptic_gt" --force
hash_of() { python3 -c "import json, sys; print(json.load(sys.stdin)['logs'][0]['annotated']['labels_blake3'])"; }
for runtime in rten onnxruntime; do
    if [ "$runtime" = onnxruntime ] && [ -z "${ORT_DYLIB_PATH:-}" ]; then continue; fi
    annotate() { # output, threads
        "$pslam" annotate "$dir/log.mcap" "${described[@]}" --runtime $runtime -o "$1" --threads "$2" --limit 6 --force --json
    }
    one=$(annotate "$dir/$runtime.mcap" 1 | hash_of)
    two=$(annotate "$dir/again.mcap" 2 | hash_of)
    [ "$one" = "$two" ] || { echo "$runtime: $one with one thread, $two with two"; exit 1; }
    "$pslam" check "$dir/$runtime.mcap"
    # The golden frame: the first picture's labels as ONNX Runtime 1.32 gave them on one machine (tests/segment/golden, a folder of
    # ready masks). Every segment is found again, nothing is invented, and all but a few pixels at borders are the same on any
    # CPU and by either runtime.
    "$pslam" annotate "$dir/$runtime.mcap" --masks tests/segment/golden --layer golden --limit 1 -o "$dir/golden.mcap" --force
    "$pslam" eval-masks "$dir/golden.mcap" --layer network --truth golden --json | python3 -c "
import json, sys
quality = json.load(sys.stdin)
found = {c['name']: (c['true_positives'], c['false_positives'], c['false_negatives'], c['sq']) for c in quality['classes']}
worst = min(sq for *_, sq in found.values())
print('$runtime', 'golden frame:', len(found), 'segments, worst overlap', worst, 'agreement', quality['pixel_agreement'])
assert quality['frames'] == 1 and len(found) == 8 and all(counts[:3] == (1, 0, 0) for counts in found.values()), found
assert worst >= 0.97 and quality['pixel_agreement'] >= 0.995"
    "$pslam" eval-masks "$dir/$runtime.mcap" --layer network --truth panoptic --json | python3 -c "
import json, sys
quality = json.load(sys.stdin)
print('$runtime', quality['frames'], 'frames, PQ', quality['all']['pq'], 'person', quality['person']['recall'])
assert quality['frames'] == 6 and quality['all']['pq'] > 0.05"
done
if [ -n "${ORT_DYLIB_PATH:-}" ]; then
    "$pslam" eval-masks "$dir/rten.mcap" --layer network --truth network --truth-log "$dir/onnxruntime.mcap" --json | python3 -c "
import json, sys
agreement = json.load(sys.stdin)['pixel_agreement']
print('the runtimes agree on', agreement)
assert agreement > 0.999"
fi

# Labels made while recording are what a replay sees.
"$pslam" record --source synthetic --duration 6s --reserve 100M --segment "${described[@]}" --segment-lag 30 -o "$dir/live.mcap" --force
"$pslam" check "$dir/live.mcap" | tail -1
fingerprint() { python3 -c "import json, sys; print(json.load(open(sys.argv[1] + '/run.json'))['fingerprint'])" "$1"; }
for threads in 1 2; do
    "$pslam" replay "$dir/live.mcap" -o "$dir/live-$threads" --segmentation network --threads $threads --force >/dev/null
done
[ "$(fingerprint "$dir/live-1")" = "$(fingerprint "$dir/live-2")" ] || { echo "replays of a live log differ"; exit 1; }

# Panoptic quality as COCO's own program gives it.
if [ ! -x "$dir/coco/bin/python" ]; then
    python3 -m venv "$dir/coco" && "$dir/coco/bin/pip" install --quiet --disable-pip-version-check panopticapi-lite==0.2.0 || true
fi
if "$dir/coco/bin/python" -c "import panopticapi.evaluation" 2>/dev/null; then
    piece=../shared/data/kitchen_moving_box
    "$pslam" import tum "$piece" -o "$dir/given.mcap" --panoptic "$piece/panoptic" --force >/dev/null
    "$pslam" import tum "$piece" -o "$dir/truth.mcap" --panoptic "$piece/panoptic_gt" --force >/dev/null
    "$dir/coco/bin/python" tests/segment/pq.py "$pslam" "$dir/given.mcap" panoptic "$piece/panoptic_gt" "$dir/truth.mcap" "$dir/pq"
else
    echo "SKIPPED: panopticapi-lite cannot be installed here"
fi
