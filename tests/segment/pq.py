#!/usr/bin/env python3
"""Panoptic quality of a layer as `pslam eval-masks` and as COCO's own program give it, side by side.

Usage: pq.py PSLAM LOG LAYER PANOPTIC_FOLDER TRUTH_LOG WORK_FOLDER
The truth stands twice: as COCO panoptic PNG files in PANOPTIC_FOLDER (its JSON beside it), as the layer `panoptic` of TRUTH_LOG.
The layer goes to COCO's program by `pslam export coco-panoptic`. Exits with 0 if all numbers are the same.
Needs: pip install panopticapi-lite==0.2.0 (panopticapi from PyPI)
"""

import json
import os
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

from panopticapi.evaluation import pq_compute


def main(pslam, log, layer, truth_folder, truth_log, work):
    work = Path(work)
    work.mkdir(parents=True, exist_ok=True)
    exported = work / "exported"
    subprocess.run(
        [pslam, "export", "coco-panoptic", log, "--layer", layer, "-o", exported, "--force"],
        check=True, stdout=subprocess.DEVNULL,
    )
    truth_folder = Path(truth_folder)
    truth = json.loads((truth_folder.parent / f"{truth_folder.name}.json").read_text())
    stem = "panoptic" if layer == "panoptic" else f"panoptic_{layer}"
    found = json.loads((exported / f"{stem}.json").read_text())
    names = {category["id"]: category["name"] for category in truth["categories"]}
    assert all(names.get(c["id"]) == c["name"] for c in found["categories"]), "ids mean other things in the two tables"

    def microseconds(annotation):
        return int(Decimal(Path(annotation["file_name"]).stem) * 10**6)

    # The same pictures under the same ids.
    by_time = {microseconds(annotation): annotation for annotation in found["annotations"]}
    for annotation in truth["annotations"]:
        by_time[microseconds(annotation)]["image_id"] = annotation["image_id"]
    files = [work / "truth.json", work / "found.json"]
    for path, table in zip(files, (truth, found)):
        path.write_text(json.dumps(table))
    stdout, sys.stdout = sys.stdout, open(os.devnull, "w")
    theirs = pq_compute(*map(str, files), str(truth_folder), str(exported / stem))
    sys.stdout = stdout
    command = [pslam, "eval-masks", log, "--layer", layer, "--truth", "panoptic", "--truth-log", truth_log, "--json"]
    ours = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    worst = 0.0
    for our_name, their_name in (("all", "All"), ("things", "Things"), ("stuff", "Stuff")):
        a, b = ours[our_name], theirs[their_name]
        print(f"{our_name:<7} PQ {a['pq']:.6f} / {b['pq']:.6f}  SQ {a['sq']:.6f} / {b['sq']:.6f}"
              f"  RQ {a['rq']:.6f} / {b['rq']:.6f}  classes {a['classes']} / {b['n']}")
        assert a["classes"] == b["n"] > 0
        worst = max([worst] + [abs(a[key] - b[key]) for key in ("pq", "sq", "rq")])
    classes = {c["name"]: c for c in ours["classes"]}
    compared = 0
    for number, theirs_of in theirs["per_class"].items():
        if names[number] in classes:
            compared += 1
            worst = max(worst, abs(classes[names[number]]["pq"] - theirs_of["pq"]))
        else:
            assert theirs_of["pq"] == 0.0, names[number]
    print(f"{ours['frames']} pictures, {compared} classes: the numbers differ by at most {worst:.1e}")
    assert ours["frames"] == len(truth["annotations"]) and compared == len(classes) and worst < 1e-9


if __name__ == "__main__":
    main(*sys.argv[1:])
