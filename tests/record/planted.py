"""Looks for planted faults in a recording, and for nothing else. Usage: planted.py LOG STATUS_LINES SECONDS."""

import json
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

log, lines, seconds = sys.argv[1], open(sys.argv[2]).read().splitlines(), float(sys.argv[3])
drops, counters, wraps, occluded, frames, stamps = [], {}, {}, [], [], {}
with open(log, "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
    for _, channel, record, message in reader.iter_decoded_messages():
        topic = channel.topic
        if topic == "/recording/drops":
            drops.append((message.stream, message.cause, message.first_counter, message.last_counter, message.count))
        elif topic.endswith("/metadata"):
            counters.setdefault(topic, []).append(message.counter)
            wraps.setdefault(topic, []).append((message.device_time_us, message.device_time_ns))
            stamps.setdefault(topic, []).append(record.log_time)
        elif topic == "/mocap/frames":
            frames.append(message.frame_number)
            occluded += [message.frame_number] * any(body.occluded for body in message.bodies)
            for body in message.bodies:
                assert body.occluded == (body.pose.position.x != body.pose.position.x), "occluded means NaN"

camera_drops = sorted(drop for drop in drops if drop[0] != "mocap")
assert camera_drops == [("color", "device", 40, 44, 5), ("depth", "device", 50, 50, 1)], drops
# `pslam sim --fault drop --fault occlude`, 100 Hz: never sends frames 17, 31, 32, 33 of 50 and hides all bodies for 0.25 s
# every 2 s from the first second on; the protocol's numbers begin at 1.
every = range(min(frames), max(frames) + 1)
never_sent = [n for n in every if (n - 1) % 50 in (17, 31, 32, 33)]
lost = [n for stream, cause, first, last, _ in drops if stream == "mocap" for n in range(first, last + 1)]
assert lost == never_sent, (lost, never_sent)
assert frames == [n for n in every if n not in never_sent]
hidden = [n for n in frames if 100 <= (n - 1) % 200 < 125]
assert occluded == hidden, (occluded, hidden)
color, depth = counters["/camera/color/metadata"], counters["/camera/depth/native/metadata"]
frames_in_all = round(seconds * 30)
for there, missing in [(color, set(range(40, 45))), (depth, {50})]:
    first = min(there)
    wanted = [n for n in range(first, first + frames_in_all) if n not in missing]
    assert sorted(there) == wanted, f"{len(there)} frames, {len(wanted)} were fed"
for topic, told in wraps.items():
    times = [ns for _, ns in told]
    assert times == sorted(times), f"{topic}: the unwrapped clock goes back"
    assert max(b - a for a, b in zip(times, times[1:])) < 300e6, f"{topic}: the wrap left a hole"
    # Stamps are the device's time plus one constant.
    assert len({stamp - ns for stamp, ns in zip(stamps[topic], times)}) == 1, topic
raw = [us for us, _ in wraps["/camera/color/metadata"]]
assert any(b < a for a, b in zip(raw, raw[1:])) or max(raw) > 2**32, "the wrap was not planted"
verdict = json.loads(lines[-1])
assert verdict["kind"] == "verdict" and not verdict["complete"]
told = {stream["stream"]: stream for stream in verdict["streams"]}
assert (told["color"]["dropped_device"], told["depth"]["dropped_device"]) == (5, 1), told
assert all(stream["dropped_host"] == 0 for stream in told.values()), told
assert verdict["mocap"]["occlusions"] == len(occluded), (verdict["mocap"], occluded)
assert told["mocap"]["dropped_device"] == len(lost), told
assert told["mocap"]["written"] == len(frames)
print(
    f"{len(color)} colour and {len(depth)} depth frames, 6 lost; {len(frames)} mocap frames, {len(lost)} lost, "
    f"{len(occluded)} occluded; arrival to file p99 {verdict['latency_p99_ms']:.0f} ms: as planted"
)
