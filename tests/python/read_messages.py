#!/usr/bin/env python3
"""Reads every message of a log with independent readers: PyPI `mcap` with CRC validation and `mcap-ros2-support`, and
`rosbags`. Exits with 0 if both decode all of them and agree on topics and stamps.

Usage: read_messages.py LOG
"""

import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


def by_mcap(log):
    with open(log, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [(channel.topic, message.log_time) for _, channel, message, _ in reader.iter_decoded_messages()]


def by_rosbags(log):
    read = []
    with AnyReader([Path(log)]) as reader:
        for connection, stamp, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            read.append((connection.topic, stamp))
    return read


def main(log):
    ours, theirs = sorted(by_mcap(log)), sorted(by_rosbags(log))
    assert ours, "no message"
    assert ours == theirs, f"mcap reads {len(ours)} messages, rosbags {len(theirs)}"
    print(f"{log}: {len(ours)} messages, decoded by mcap with CRC checks and by rosbags")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
