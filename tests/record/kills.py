"""Kills a recording process again and again at random moments and recovers what it left.

Usage: kills.py PSLAM COUNT [SEED]. Needs the package `mcap`. What the program said to be flushed must be in the recovered
log; how much time was lost is printed (the promise is one flush interval, plus what was on its way to the disk).
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time

from mcap.reader import make_reader

TOPICS = {
    "color": "/camera/color/image/compressed",
    "depth": "/camera/depth/native/image",
    "gyro": "/camera/gyro/sample",
    "accel": "/camera/accel/sample",
}


def record_and_kill(pslam, folder, delay_s):
    log = os.path.join(folder, "a.mcap")
    mode = "160x120@30"
    command = [pslam, "--no-progress", "record", "--source", "synthetic", "--color", mode, "--depth", mode, "--imu"]
    child = subprocess.Popen(
        command + ["--reserve", "1M", "--json", "-o", log], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    first = child.stdout.readline()
    assert first, "the recording ended by itself"
    time.sleep(delay_s)
    killed_ns = time.time_ns()
    child.send_signal(signal.SIGKILL)
    lines = [first] + child.stdout.read().splitlines()
    child.wait()
    status = [json.loads(line) for line in lines if line.strip().endswith(b"}")]
    return log + ".partial", killed_ns, status[-1]


def main():
    pslam, count = sys.argv[1], int(sys.argv[2])
    rng = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    losses_ms = []
    for number in range(count):
        with tempfile.TemporaryDirectory() as folder:
            partial, killed_ns, status = record_and_kill(pslam, folder, rng.uniform(0.0, 2.0))
            saved = os.path.join(folder, "saved.mcap")
            recovered = subprocess.run([pslam, "recover", partial, "-o", saved], capture_output=True, text=True)
            assert recovered.returncode in (0, 1), recovered.stderr
            counts, last_ns = {}, 0
            with open(saved, "rb") as file:
                for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                    counts[channel.topic] = counts.get(channel.topic, 0) + 1
                    last_ns = max(last_ns, message.publish_time)
            for stream in status["streams"]:
                there, said = counts.get(TOPICS[stream["stream"]], 0), stream["flushed"]
                assert there >= said, f"kill {number}: {stream['stream']} {there} in the log, {said} said to be flushed"
            losses_ms.append((killed_ns - last_ns) / 1e6)
            print(f"kill {number + 1}: {sum(counts.values())} messages recovered, {losses_ms[-1]:.0f} ms lost", flush=True)
    losses_ms.sort()
    print(f"{count} kills: lost {losses_ms[len(losses_ms) // 2]:.0f} ms (median), {losses_ms[-1]:.0f} ms (most)")


main()
