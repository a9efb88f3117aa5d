"""A recording of `pslam sim vicon --fault drop --fault occlude` at 100 Hz: what was planted is told, and nothing else.

Usage: planted_mocap.py LOG. The simulator never sends frames 17, 31, 32, 33 of 50 and hides all bodies for 0.25 s every 2 s
from the first second on; the protocol's numbers begin at 1.
"""

import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

numbers, occluded, lost = [], [], []
with open(sys.argv[1], "rb") as file:
    for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
        if channel.topic == "/mocap/frames":
            numbers.append(message.frame_number)
            occluded += [message.frame_number] * any(body.occluded for body in message.bodies)
        elif channel.topic == "/recording/drops":
            assert (message.stream, message.cause) == ("mocap", "device"), message
            lost += range(message.first_counter, message.last_counter + 1)

every = range(min(numbers), max(numbers) + 1)
dropped = [n for n in every if (n - 1) % 50 in (17, 31, 32, 33)]
assert lost == dropped, (lost, dropped)
assert numbers == [n for n in every if n not in dropped]
hidden = [n for n in numbers if 100 <= (n - 1) % 200 < 125]
assert occluded == hidden, (occluded, hidden)
print(f"{len(numbers)} mocap frames, {len(lost)} lost, {len(occluded)} occluded: as planted")
