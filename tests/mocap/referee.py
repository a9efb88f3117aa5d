#!/usr/bin/env python3
"""The genuine Vicon DataStream SDK client and a genuine VRPN client (PyPI wheel motioncapture 1.1) read what
`pslam sim` serves, pose for pose.

Usage: referee.py PSLAM

Each case starts a simulated system with a trajectory that has one pose a frame, so that every pose a client gives must
be one of the file's, in the file's order. The client runs in a process of its own: it waits for ever where nobody answers.
"""
import bisect
import json
import math
import os
import subprocess
import sys
import tempfile

RATE_HZ = 100
# So long that no client sees the path begin anew.
SECONDS = 20
SUBJECTS = ["quad", "person"]
PATIENCE_S = 60
# Positions pass through 32 bits and millimetres in the SDK, quaternions through 32 bits.
TOLERANCE = 5e-6


def poses(shift):
    """One pose a frame with all six degrees of freedom; x never goes back, so that a pose names its frame."""
    out = []
    for k in range(RATE_HZ * SECONDS + 1):
        t = k / RATE_HZ
        half = 0.5 * (0.3 + 0.9 * math.sin(1.3 * t + shift))
        axis = [math.cos(0.7 * t), math.sin(0.7 * t) * 0.6, math.sin(0.7 * t) * 0.8]
        position = [shift + 0.5 * t, math.sin(2 * t), 1 + 0.2 * math.cos(3 * t)]
        out.append(position + [math.sin(half) * a for a in axis] + [math.cos(half)])
    return out


def write_tum(path, rows):
    with open(path, "w") as file:
        for k, row in enumerate(rows):
            file.write(f"{k / RATE_HZ:.9f} " + " ".join(f"{v:.12f}" for v in row) + "\n")


def read(kind, hostname, count):
    """In a process of its own: prints `count` frames as JSON."""
    import motioncapture

    client = motioncapture.connect(kind, {"hostname": hostname})
    for _ in range(count):
        client.waitForNextFrame()
        bodies = {}
        for name, body in client.rigidBodies.items():
            q = body.rotation
            bodies[name] = [float(v) for v in body.position] + [q.x, q.y, q.z, q.w]
        print(json.dumps(bodies), flush=True)
    # The clients' threads do not end by themselves.
    os._exit(0)


def distance(a, b):
    sign = 1 if sum(x * y for x, y in zip(a[3:], b[3:])) >= 0 else -1
    return max(abs(x - s * y) for x, y, s in zip(a, b, [1] * 3 + [sign] * 4))


def compare(frames, truth):
    """Frames seen of each subject; fails at the first pose that is none of the script's, or out of order."""
    seen = {name: 0 for name in SUBJECTS}
    last = {name: -1 for name in SUBJECTS}
    distinct = {name: set() for name in SUBJECTS}
    for number, bodies in enumerate(frames):
        for name, pose in bodies.items():
            rows = truth[name]
            at = bisect.bisect_left([row[0] for row in rows], pose[0])
            nearest = [k for k in (at - 1, at) if 0 <= k < len(rows)]
            best = min(nearest, key=lambda k: distance(pose, rows[k]))
            error = distance(pose, rows[best])
            assert error < TOLERANCE, f"frame {number} of {name}: {pose} is {error} away from pose {best}: {rows[best]}"
            assert best >= last[name], f"frame {number} of {name}: pose {best} after {last[name]}"
            last[name] = best
            distinct[name].add(best)
            seen[name] += 1
    return seen, {name: len(found) for name, found in distinct.items()}


def case(pslam, folder, protocol, prefix, faults, count, least, more=()):
    server = subprocess.Popen(
        [pslam, "sim", protocol, f"{folder}/quad.txt", "--subject", "quad", "--subject", f"person={folder}/person.txt"]
        + ["--listen", "127.0.0.1:0", "--rate", str(RATE_HZ), "--loop"]
        + [word for fault in faults for word in ("--fault", fault)]
        + list(more),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        address = server.stdout.readline().split()[1]
        command = [sys.executable, __file__, "--read", protocol, prefix + address, str(count)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert done.returncode == 0, f"the client failed: {done.stdout[-500:]}{done.stderr[-2000:]}"
        frames = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        seen, distinct = compare(frames, {name: poses(i) for i, name in enumerate(SUBJECTS)})
        label = " ".join([protocol, prefix, *faults])
        print(f"{label}: {len(frames)} frames, poses {seen}, different ones {distinct}")
        assert len(frames) == count
        assert min(distinct.values()) >= least, f"fewer than {least}"
    finally:
        server.kill()
        server.wait()


def main(pslam):
    with tempfile.TemporaryDirectory() as folder:
        for i, name in enumerate(SUBJECTS):
            write_tum(f"{folder}/{name}.txt", poses(i))
        for faults in [[], ["static-once"], ["split"], ["glue"], ["y-up"], ["drop"], ["occlude", "static-once"]]:
            case(pslam, folder, "vicon", "", faults, 150, 100)
        for prefix in ["tcp://", ""]:
            case(pslam, folder, "vrpn", prefix, [], 150, 60)
        try:
            case(pslam, folder, "vicon", "", [], 20, 10, ["--offset-ms", "3"])
        except AssertionError as error:
            print(f"poses that lag by 3 ms are noticed: {error}"[:120])
        else:
            raise AssertionError("the comparison cannot fail")


if __name__ == "__main__":
    if sys.argv[1] == "--read":
        read(sys.argv[2], sys.argv[3], int(sys.argv[4]))
    else:
        main(sys.argv[1])
