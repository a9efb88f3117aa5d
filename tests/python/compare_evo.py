"""Compares the program's trajectory errors with those of evo 1.38.1 on the same files, to 1e-6 m (and degrees).

    python3 -m venv venv && venv/bin/pip install evo==1.38.1
    cargo build --release -p replayer --example evaluate
    venv/bin/python tests/python/compare_evo.py target/release/examples/evaluate [GROUNDTRUTH ...] [--golden FOLDER]

Estimates are made from synthetic curves and from the given ground truth files (TUM text): resampled, moved, scaled,
with noise, drift, clock offsets and gaps. With --golden the synthetic files and evo's numbers are written to FOLDER,
where the crate's own test reads them.
"""

import argparse
import copy
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from evo import main_ape, main_rpe
from evo.core import metrics, sync
from evo.tools import file_interface
from scipy.spatial.transform import Rotation, Slerp

TOLERANCE = 1e-6
MAX_DIFFERENCE_S = 0.01
UNITS = {"m": metrics.Unit.meters, "f": metrics.Unit.frames}
DELTAS = [(1, "f"), (7, "f"), (0.1, "m"), (0.37, "m")]
STATISTICS = ["rmse", "mean", "median", "std", "min", "max", "sse"]


def write_tum(path, stamps, positions, rotations, stamp_decimals):
    quaternions = rotations.as_quat()
    with open(path, "w", encoding="ascii") as file:
        file.write("# timestamp tx ty tz qx qy qz qw\n")
        for stamp, p, q in zip(stamps, positions, quaternions):
            numbers = " ".join(f"{v:.9f}" for v in [*p, *q])
            file.write(f"{stamp:.{stamp_decimals}f} {numbers}\n")


def synthetic(rng):
    """A hand-held walk of 20 s, true poses at 100 Hz."""
    t = np.arange(0, 20, 0.01)
    amplitude, rate, phase = rng.uniform(0.1, 0.8, (3, 4)), rng.uniform(0.3, 3, (3, 4)), rng.uniform(0, 6, (3, 4))
    wave = lambda scale: (scale * np.sin(t[:, None, None] * rate + phase)).sum(axis=2)
    return 1.6e9 + t, wave(amplitude), Rotation.from_rotvec(wave(amplitude * 0.4))


def read(path):
    rows = np.loadtxt(path)
    rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0])]
    return rows[:, 0], rows[:, 1:4], Rotation.from_quat(rows[:, 4:8])


def disturbed(rng, truth, case):
    """An estimate: the truth at 30 Hz, in another frame, with the errors that `case` names."""
    stamps, positions, rotations = truth
    at = np.arange(stamps[0] + 0.02, stamps[-1] - 0.02, 1 / 30)
    if case == "ties":  # exactly between two true stamps
        at = (stamps[1:-3:4] + stamps[2:-2:4]) / 2
    if case == "gaps":
        at = at[(at - at[0]) % 3 < 2.2]
    if case == "dense":  # more poses than the truth has
        at = np.linspace(stamps[0], stamps[-1], len(stamps) * 2)
    p = np.stack([np.interp(at, stamps, positions[:, i]) for i in range(3)], axis=1)
    r = Slerp(stamps, rotations)(at)
    if case == "drift":
        p = p + np.linspace(0, 0.3, len(at))[:, None] * [1, 0.5, -0.2]
    noise = 0.3 if case == "wild" else 0.01
    p = p + rng.normal(0, noise, p.shape)
    r = r * Rotation.from_rotvec(rng.normal(0, noise, p.shape))
    turn, scale = Rotation.from_rotvec([0.5, -1.0, 2.0]), 0.7 if case == "scaled" else 1.0
    stamps_out = at + (0.004 if case == "offset" else 0)
    return stamps_out, turn.apply(p) * scale + [1, 2, 3], turn * r


def by_evo(truth_path, estimate_path, alignment):
    truth = file_interface.read_tum_trajectory_file(str(truth_path))
    estimate = file_interface.read_tum_trajectory_file(str(estimate_path))
    truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=MAX_DIFFERENCE_S)
    flags = {"align": alignment != "none", "correct_scale": alignment == "sim3"}
    relations = {"m": metrics.PoseRelation.translation_part, "deg": metrics.PoseRelation.rotation_angle_deg}

    def run(function, **more):
        try:
            return function(copy.deepcopy(truth), copy.deepcopy(estimate), **flags, **more).stats
        except metrics.filters.FilterException:
            return None  # the path is shorter than delta

    out = {"pairs": truth.num_poses}
    for name, relation in relations.items():
        out[f"ape {name}"] = run(main_ape.ape, pose_relation=relation)
        for all_pairs in (False, True):
            for delta, unit in DELTAS:
                key = f"rpe {delta}{unit} {'all ' if all_pairs else ''}{name}"
                out[key] = run(
                    main_rpe.rpe, pose_relation=relation, delta=delta, delta_unit=UNITS[unit], all_pairs=all_pairs
                )
    return out


def by_us(program, truth_path, estimate_path, alignment):
    out = {}
    deltas = [f"{delta}{unit}" for delta, unit in DELTAS]
    for mode in ([], ["all"]):
        command = [program, str(truth_path), str(estimate_path), alignment, str(MAX_DIFFERENCE_S), *mode, *deltas]
        result = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        out["pairs"] = result["pairs"]
        out["ape m"], out["ape deg"] = result["ate_m"], result["ate_rotation_deg"]
        for text, rpe in zip(deltas, result["rpe"]):
            prefix = f"rpe {text} {'all ' if mode else ''}"
            out[prefix + "m"], out[prefix + "deg"] = rpe["translation_m"], rpe["rotation_deg"]
    return out


def largest_difference(evo, ours):
    worst = (0.0, "")
    assert evo["pairs"] == ours["pairs"], f"pairs: evo {evo['pairs']}, ours {ours['pairs']}"
    for key, stats in evo.items():
        if key == "pairs":
            continue
        assert (stats is None) == (ours[key] is None), f"{key}: evo {stats}, ours {ours[key]}"
        for name in STATISTICS if stats else []:
            difference = abs(stats[name] - ours[key][name])
            if name == "sse":  # a sum over all pairs: per pair
                difference /= ours[key]["count"]
            worst = max(worst, (difference, f"{key} {name}"))
    return worst


def write_golden(folder, rng):
    """A short pair of files and evo's numbers for it."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = [part[:400] for part in synthetic(rng)]
    write_tum(folder / "truth.txt", *truth, 6)
    write_tum(folder / "estimate.txt", *disturbed(rng, truth, "gaps"), 9)
    golden = {a: by_evo(folder / "truth.txt", folder / "estimate.txt", a) for a in ("se3", "sim3", "none")}
    (folder / "evo-1.38.1.json").write_text(json.dumps(golden, indent=1) + "\n", encoding="ascii")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("groundtruth", nargs="*")
    parser.add_argument("--golden", type=pathlib.Path)
    args = parser.parse_args()
    rng = np.random.default_rng(7)
    cases = ["plain", "ties", "gaps", "dense", "drift", "wild", "scaled", "offset"]
    sources = [("synthetic", synthetic(rng))] + [(path, read(path)) for path in args.groundtruth]
    worst_of_all = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for source, truth in sources:
            for case in cases:
                truth_path, estimate_path = pathlib.Path(folder, "truth.txt"), pathlib.Path(folder, "estimate.txt")
                write_tum(truth_path, *truth, 6)
                write_tum(estimate_path, *disturbed(rng, truth, case), 9)
                for alignment in ("se3", "sim3", "none"):
                    evo = by_evo(truth_path, estimate_path, alignment)
                    worst, where = largest_difference(evo, by_us(args.program, truth_path, estimate_path, alignment))
                    worst_of_all = max(worst_of_all, worst)
                    print(f"{source:60.60} {case:7} {alignment:5} {evo['pairs']:5} pairs  {worst:.1e}  {where}")
    if args.golden:
        write_golden(args.golden, rng)
    print(f"largest difference: {worst_of_all:.2e} (allowed {TOLERANCE:.0e})")
    return 0 if worst_of_all <= TOLERANCE else 1


if __name__ == "__main__":
    sys.exit(main())
