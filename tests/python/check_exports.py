#!/usr/bin/env python3
"""Independent readers open what `pslam export` and `pslam card` write.

Usage: check_exports.py PSLAM LOG SCRATCH [FOLDER_OF_CARD]
Needs: pip install mcap rosbags evo pillow numpy pycocotools mlcroissant cffconvert (the last two only with a card)

LOG must have depth, ground truth and a segmentation layer. Exits with 0 if everything is equal to what the log says.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

DEPTH, POSE, COLOR = "/camera/depth/image", "/ground_truth/pose", "/camera/color/image/compressed"


def pslam(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, (arguments, done.stderr)
    return done.stdout


def export(program, kind, log, scratch):
    folder = scratch / kind
    pslam(program, "export", kind, log, "-o", folder, "--force")
    return folder


def times(log):
    """Log times by topic, from the reader `mcap`."""
    topics = {}
    with open(log, "rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            topics.setdefault(channel.topic, []).append(message.log_time)
    return topics


def rosbag2(folder, truth):
    """rosbags' strict reader and its AnyReader."""
    with Reader(folder) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {topic: len(stamps) for topic, stamps in truth.items()}, counts
        assert reader.message_count == sum(counts.values())
        every = [stamp for stamps in truth.values() for stamp in stamps]
        assert (reader.start_time, reader.end_time - 1) == (min(every), max(every)), (reader.start_time, reader.end_time)
    decoded = 0
    with AnyReader([folder]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            decoded += 1
    assert decoded == sum(counts.values())
    print(f"rosbags: {len(counts)} topics, {decoded} messages decoded")


def foreign_bag(program, folder, scratch):
    """A bag that rosbags wrote comes in as pictures and depth."""
    bag = scratch / "foreign"
    subprocess.run(["rm", "-rf", bag], check=True)
    wanted = [COLOR, "/camera/color/camera_info", DEPTH]
    with AnyReader([folder]) as reader, Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for c in reader.connections:
            if c.topic in wanted:
                name = c.topic.replace("/camera", "/robot/front")
                connections[c.topic] = writer.add_connection(name, c.msgtype, typestore=reader.typestore)
        for c, stamp, raw in reader.messages(connections=[c for c in reader.connections if c.topic in wanted]):
            writer.write(connections[c.topic], stamp, raw)
    log = scratch / "foreign.mcap"
    pslam(program, "import", "rosbag2", bag, "-o", log, "--force")
    back, source = times(log), times(next(folder.glob("*.mcap")))
    assert back[COLOR] == source[COLOR] and back[DEPTH] == source[DEPTH]
    print(f"a bag written by rosbags: {len(back[COLOR])} pictures and {len(back[DEPTH])} depth images came in")


def tum(folder, truth):
    """evo reads the trajectory; an associate tool's floats find every pair; PIL reads every picture."""
    from evo.tools import file_interface

    trajectory = file_interface.read_tum_trajectory_file(folder / "groundtruth.txt")
    assert trajectory.check()[0] and trajectory.num_poses == len(truth[POSE])
    lists = {}
    for name in ("rgb.txt", "depth.txt"):
        rows = [line.split() for line in (folder / name).read_text().splitlines() if not line.startswith("#")]
        lists[name] = {float(stamp): file for stamp, file in rows}
        for file in lists[name].values():
            with Image.open(folder / file) as picture:
                picture.load()
                assert name == "rgb.txt" or picture.mode.startswith("I"), picture.mode
    near = [min(abs(a - b) for b in lists["depth.txt"]) for a in lists["rgb.txt"]]
    pairs = [line.split() for line in (folder / "associations.txt").read_text().splitlines()]
    assert sum(gap < 0.02 for gap in near) == len(pairs)
    print(f"evo: {trajectory.num_poses} poses, {trajectory.path_length:.3f} m; PIL: {len(lists['rgb.txt'])} pictures, "
          f"{len(lists['depth.txt'])} depth images, {len(pairs)} pairs")


def coco(folder):
    """panopticapi's formula and pycocotools' masks agree with the JSON on every segment."""
    from pycocotools import mask as masks

    content = json.loads((folder / "panoptic.json").read_text())
    categories = {c["id"]: c for c in content["categories"]}
    images = {image["id"]: image for image in content["images"]}
    segments = 0
    for annotation in content["annotations"]:
        image = images[annotation["image_id"]]
        rgb = np.array(Image.open(folder / "panoptic" / annotation["file_name"]).convert("RGB"), np.uint32)
        ids = rgb[..., 0] + 256 * rgb[..., 1] + 256**2 * rgb[..., 2]
        assert ids.shape == (image["height"], image["width"]) and (folder / "images" / image["file_name"]).is_file()
        assert set(np.unique(ids)) - {0} <= {s["id"] for s in annotation["segments_info"]}
        for s in annotation["segments_info"]:
            encoded = masks.encode(np.asfortranarray(ids == s["id"], np.uint8))
            assert masks.area(encoded) == s["area"] and s["category_id"] in categories and s["iscrowd"] in (0, 1)
            assert not s["area"] or list(masks.toBbox(encoded)) == s["bbox"], s
            segments += 1
    print(f"pycocotools: {len(content['annotations'])} pictures, {segments} segments, areas and boxes equal")


def euroc(folder, truth):
    from evo.tools import file_interface

    trajectory = file_interface.read_euroc_csv_trajectory(folder / "mav0/state_groundtruth_estimate0/data.csv")
    rows = list(csv.reader(line for line in open(folder / "mav0/cam0/data.csv") if not line.startswith("#")))
    assert trajectory.num_poses == len(truth[POSE]) and [int(r[0]) for r in rows] == truth[COLOR]
    print(f"evo: {trajectory.num_poses} poses of the body; {len(rows)} pictures by nanoseconds")


def plain(folder, truth):
    rows = list(csv.DictReader(open(folder / "frames.csv")))
    assert [int(row["stamp_ns"]) for row in rows] == truth[COLOR]
    for row in rows:
        assert (folder / row["color"]).is_file() and (not row["depth"] or (folder / row["depth"]).is_file())
    masks = list(csv.DictReader(open(folder / "masks/panoptic/masks.csv")))
    classes = {int(row["id"]) for row in csv.DictReader(open(folder / "masks/panoptic/categories.csv"))}
    found = set()
    for row in masks:
        found |= set(np.unique(np.array(Image.open(folder / row["class"]))).tolist())
    assert found - {0} <= classes
    print(f"csv: {len(rows)} frames, {len(masks)} masks with {len(found - {0})} classes")


def card(folder):
    subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=folder, check=True)
    import mlcroissant

    dataset = mlcroissant.Dataset(folder / "croissant.json")
    assert not dataset.metadata.ctx.issues.errors, dataset.metadata.ctx.issues.errors
    records = sum(1 for _ in dataset.records("frames"))
    frames = sum(log["frames"] for log in json.loads((folder / "statistics.json").read_text()))
    assert records == frames, (records, frames)
    programs = Path(sys.executable).parent
    validated = subprocess.run([programs / "mlcroissant", "validate", "--jsonld", folder / "croissant.json"], capture_output=True, text=True)
    assert validated.returncode == 0, validated.stderr
    print("mlcroissant validate:", validated.stderr.strip().splitlines()[-1], f"; {records} records read")
    cited = subprocess.run([programs / "cffconvert", "--validate", "-i", folder / "CITATION.cff"], capture_output=True, text=True)
    assert cited.returncode == 0, cited.stdout + cited.stderr
    print("cffconvert:", (cited.stdout + cited.stderr).strip().splitlines()[-1])


def main():
    program, log, scratch = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    scratch.mkdir(parents=True, exist_ok=True)
    truth = times(log)
    bag = export(program, "rosbag2", log, scratch)
    rosbag2(bag, truth)
    foreign_bag(program, bag, scratch)
    tum(export(program, "tum", log, scratch), truth)
    coco(export(program, "coco-panoptic", log, scratch))
    euroc(export(program, "euroc", log, scratch), truth)
    plain(export(program, "png", log, scratch), truth)
    if len(sys.argv) > 4:
        card(Path(sys.argv[4]))


if __name__ == "__main__":
    main()
