#!/usr/bin/env python3
"""Reads a log with independent readers and compares every value with the TUM-style folder it was imported from.

Usage: read_log.py LOG FOLDER [PANOPTIC_FOLDER]
Needs: pip install mcap mcap-ros2-support rosbags pillow numpy

Readers: PyPI `mcap` with CRC validation and `mcap-ros2-support` (all messages, all values), and `rosbags` (all
messages decoded, stamps and payload bytes equal to the first reader's). Exits with 0 if everything is equal.
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
from rosbags.highlevel import AnyReader

GROUND_TRUTH, TF = "/ground_truth/pose", "/tf"
COLOR, COLOR_INFO = "/camera/color/image/compressed", "/camera/color/camera_info"
DEPTH, DEPTH_INFO = "/camera/depth/image", "/camera/depth/camera_info"
LAYER = "/segmentation/panoptic/"


def nanoseconds(text):
    """Exact: no float in between."""
    value = Decimal(text) * 10**9
    assert value == int(value), text
    return int(value)


def stamp(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def rows(path):
    lines = (line.strip() for line in path.read_text().splitlines())
    return [line.split() for line in lines if line and not line.startswith("#")]


def listed(folder, name):
    return {nanoseconds(row[0]): folder / row[1] for row in rows(folder / name)}


def read_mcap(log):
    """All messages as {topic: [(log_time, message)]}, checking CRCs, order and header stamps."""
    messages, last = {}, 0
    with open(log, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        header = reader.get_header()
        assert header.profile == "ros2", header
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg"), channel
            assert message.log_time == message.publish_time >= last, (channel.topic, message.log_time)
            last = message.log_time
            topic = messages.setdefault(channel.topic, [])
            assert message.sequence == len(topic), (channel.topic, message.sequence)
            first = decoded.transforms[0] if channel.topic == TF else decoded
            assert stamp(first.header) == message.log_time, (channel.topic, message.log_time)
            topic.append((message.log_time, decoded))
        statistics = reader.get_summary().statistics
        assert statistics.message_count == sum(map(len, messages.values()))
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attachments = {item.name: item.data for item in reader.iter_attachments()}
    return messages, metadata, attachments


def pixels(image):
    kind = {"16UC1": "<u2", "mono16": "<u2", "mono8": "u1"}[image.encoding]
    assert image.is_bigendian == 0
    return np.frombuffer(image.data, kind).reshape(image.height, image.width)


def check_color(messages, folder):
    source = listed(folder, "rgb.txt")
    assert [time for time, _ in messages[COLOR]] == sorted(source), "colour stamps differ"
    for time, message in messages[COLOR]:
        bytes_in, bytes_out = source[time].read_bytes(), bytes(message.data)
        assert message.format == ("jpeg" if bytes_in[:2] == b"\xff\xd8" else "png")
        if bytes_in != bytes_out:
            wanted = np.asarray(Image.open(source[time]).convert("RGB"))
            assert np.array_equal(np.asarray(Image.open(io.BytesIO(bytes_out))), wanted), source[time]
    return len(source)


def check_depth(messages, folder):
    source = listed(folder, "depth.txt")
    assert [time for time, _ in messages[DEPTH]] == sorted(source), "depth stamps differ"
    for time, message in messages[DEPTH]:
        assert message.encoding == "16UC1" and message.step == 2 * message.width
        assert np.array_equal(pixels(message), np.asarray(Image.open(source[time]))), source[time]
    return len(source)


def check_ground_truth(messages, folder):
    source = rows(folder / "groundtruth.txt")
    source = [row for row in source if "nan" not in " ".join(row).lower()]
    assert len(messages[GROUND_TRUTH]) == len(messages[TF]) == len(source), "ground-truth rows differ"
    for row, (time, message), (_, tf) in zip(source, messages[GROUND_TRUTH], messages[TF]):
        (edge,) = tf.transforms
        p, q = message.pose.position, message.pose.orientation
        t, r = edge.transform.translation, edge.transform.rotation
        assert time == nanoseconds(row[0])
        assert [p.x, p.y, p.z, q.x, q.y, q.z, q.w] == [float(value) for value in row[1:]], row
        assert [t.x, t.y, t.z, r.x, r.y, r.z, r.w] == [float(value) for value in row[1:]], row
        assert (message.header.frame_id, edge.header.frame_id) == ("world", "world")
        assert edge.child_frame_id == "camera_color_optical_frame"
    return len(source)


def check_camera(messages, folder):
    camera = json.loads((folder / "camera.json").read_text())
    fx, fy, cx, cy = (camera[name] for name in ("fx", "fy", "cx", "cy"))
    distortion = [camera[name] for name in ("k1", "k2", "p1", "p2", "k3")]
    for image, info in ((COLOR, COLOR_INFO), (DEPTH, DEPTH_INFO)):
        assert [time for time, _ in messages[image]] == [time for time, _ in messages[info]]
        for _, message in messages[info]:
            assert (message.width, message.height) == (camera["width"], camera["height"])
            assert list(message.k) == [fx, 0, cx, 0, fy, cy, 0, 0, 1]
            assert list(message.p) == [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]
            assert message.distortion_model == "plumb_bob" and list(message.d) == distortion


def check_masks(messages, panoptic):
    table = json.loads((panoptic.parent / f"{panoptic.name}.json").read_text())
    ((_, categories),) = messages[LAYER + "categories"]
    ((_, labels),) = messages[LAYER + "label_info"]
    wanted = sorted((item["id"], item["name"], bool(item["isthing"])) for item in table["categories"])
    assert [(item.id, item.name, item.is_thing) for item in categories.categories] == wanted
    assert [(item.class_id, item.class_name) for item in labels.class_map] == [item[:2] for item in wanted]
    by_time = {nanoseconds(Path(item["file_name"]).stem): item for item in table["annotations"]}
    topics = [messages[LAYER + leaf] for leaf in ("class", "instance", "segments")]
    assert all([time for time, _ in topic] == sorted(by_time) for topic in topics), "mask stamps differ"
    for (time, classes), (_, instances), (_, segments) in zip(*topics):
        annotation = by_time[time]
        rgb = np.asarray(Image.open(panoptic / annotation["file_name"])).astype(np.uint32)
        ids = rgb[..., 0] + 256 * rgb[..., 1] + 65536 * rgb[..., 2]
        infos = {item["id"]: item for item in annotation["segments_info"]}
        lookup = np.zeros(65536, np.uint32)
        for key, item in infos.items():
            lookup[key] = item["category_id"]
        listed_ids = np.isin(ids, list(infos))
        assert np.array_equal(pixels(instances), np.where(listed_ids, ids, 0)), time
        assert np.array_equal(pixels(classes), np.where(listed_ids, lookup[ids], 0)), time
        assert [item.id for item in segments.segments] == sorted(infos)
        for item in segments.segments:
            y, x = np.nonzero(ids == item.id)
            assert item.category_id == infos[item.id]["category_id"] and item.area == len(x)
            if len(x):
                box = [x.min(), y.min(), x.max() - x.min() + 1, y.max() - y.min() + 1]
                assert [item.x, item.y, item.width, item.height] == box, (time, item.id)
    return len(by_time)


def check_rosbags(messages, log):
    counts = {topic: 0 for topic in messages}
    with AnyReader([Path(log)]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            expected_time, expected = messages[connection.topic][counts[connection.topic]]
            counts[connection.topic] += 1
            assert time == expected_time, (connection.topic, time)
            if hasattr(expected, "data"):
                assert message.data.tobytes() == bytes(expected.data), (connection.topic, time)
            if connection.topic == GROUND_TRUTH:
                a, b = message.pose.orientation, expected.pose.orientation
                assert (a.x, a.y, a.z, a.w) == (b.x, b.y, b.z, b.w)
            if connection.topic.endswith("/segments"):
                assert [item.id for item in message.segments] == [item.id for item in expected.segments]
    assert counts == {topic: len(items) for topic, items in messages.items()}, counts
    return sum(counts.values())


def main(log, folder, panoptic=None):
    folder = Path(folder)
    messages, metadata, attachments = read_mcap(log)
    scale = json.loads((folder / "camera.json").read_text())["depth_scale"]
    assert Decimal(metadata["pslam/depth"]["units_per_metre"]) == Decimal(str(scale))
    assert attachments["calibration/camera.json"] == (folder / "camera.json").read_bytes()
    print(f"colour pictures equal: {check_color(messages, folder)}")
    print(f"depth images equal:    {check_depth(messages, folder)}")
    print(f"poses equal:           {check_ground_truth(messages, folder)}")
    check_camera(messages, folder)
    if panoptic:
        print(f"masks equal:           {check_masks(messages, Path(panoptic))}")
    print(f"rosbags reads the same {check_rosbags(messages, log)} messages")


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
