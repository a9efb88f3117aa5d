#!/usr/bin/env python3
"""Counts what is left of people in a redacted log, with independent readers and exact masks.

Usage: redaction.py LOG PANOPTIC_FOLDER
LOG was redacted with `--method fill`; PANOPTIC_FOLDER holds COCO panoptic PNG files, its JSON stands beside it. A pixel of a
person is left if its colour is not the fill's grey or its depth is not 0. Exits with 0 if not one is left.
Needs: pip install mcap mcap-ros2-support pillow numpy
"""

import io
import json
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image

COLOR, DEPTH = "/camera/color/image/compressed", "/camera/depth/image"
GREY = 128


def people(folder):
    """Stamp in nanoseconds -> mask of the pixels of people."""
    table = json.loads((folder.parent / f"{folder.name}.json").read_text())
    (person,) = (item["id"] for item in table["categories"] if item["name"] == "person")
    for item in table["annotations"]:
        rgb = np.asarray(Image.open(folder / item["file_name"])).astype(np.uint32)
        ids = rgb[..., 0] + 256 * rgb[..., 1] + 65536 * rgb[..., 2]
        mine = [segment["id"] for segment in item["segments_info"] if segment["category_id"] == person]
        yield int(Decimal(Path(item["file_name"]).stem) * 10**9), np.isin(ids, mine)


def piece(mask, seed):
    """The pixels of `mask` that are joined (eight neighbours) with those of `seed`."""
    grown = seed
    while True:
        padded = np.pad(grown, 1)
        rows, columns = mask.shape
        parts = [padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)]
        larger = np.logical_or.reduce(parts) & mask
        if larger.sum() == grown.sum():
            return larger
        grown = larger


def pieces(mask, seeds):
    """Every joined piece of `mask` that has pixels of `seeds`."""
    left = seeds.copy()
    while left.any():
        seed = np.zeros_like(left)
        seed[tuple(np.argwhere(left)[0])] = True
        found = piece(mask, seed)
        yield found
        left &= ~found


def main(log, folder):
    truth = dict(people(Path(folder)))
    seen, left, left_depth, bodies, redacted = 0, 0, 0, [], []
    depths = {}
    with open(log, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=[COLOR, DEPTH]):
            stamp = decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec
            if channel.topic == DEPTH:
                depths[stamp] = np.frombuffer(decoded.data, "<u2").reshape(decoded.height, decoded.width)
                continue
            pixels = np.asarray(Image.open(io.BytesIO(bytes(decoded.data))).convert("RGB"))
            is_grey = (pixels == GREY).all(axis=2)
            mask = truth[stamp]
            seen += int(mask.sum())
            survivors = mask & ~is_grey
            left += int(survivors.sum())
            redacted.append(is_grey.mean() if decoded.format == "png" else 0.0)
            for found in pieces(mask, survivors):
                bodies.append((stamp, int(found.sum()), int((found & survivors).sum())))
    # Colour and depth of these sequences have one stamp or nearly so.
    stamps = np.array(sorted(truth))
    for stamp, depth in depths.items():
        nearest = int(stamps[np.abs(stamps - stamp).argmin()])
        mask = truth[nearest]
        survivors = mask & (depth > 0)
        left_depth += int(survivors.sum())
    share = 100 * float(np.mean(redacted))
    area = 100 * seen / len(truth) / next(iter(truth.values())).size
    print(f"{log}: {len(redacted)} frames, people {area:.2f} % of the pictures, redacted {share:.2f} %")
    print(f"  {seen} pixels of people; left: {left} in colour (in {len(bodies)} pieces), {left_depth} in depth")
    for stamp, size, count in bodies:
        print(f"  NOT REDACTED: a piece of {size} pixels at {stamp} ns, {count} of them left")
    assert redacted and left + left_depth == 0, "pixels of people are left"


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
