#!/usr/bin/env python3
"""Takes pictures of a Rerun file without a display: the whole window and every view, at an exact frame.

    shot.py IN.rrd OUT.png [--frame N] [--timeline NAME]

Writes OUT.png and OUT.<n>-<view name>.png. Fails when a view reports an error or the file has no views.
Needs PyPI rerun-sdk 0.41.0, with its bin/ in PATH, and a Vulkan driver (Debian: mesa-vulkan-drivers libvulkan1).
"""

import argparse
import os
import re
import socket
import sys
import time
from pathlib import Path

os.environ.setdefault("XDG_RUNTIME_DIR", "/tmp")
from rerun.experimental import ViewerClient  # noqa: E402  (reads the variable on import)


def free_port() -> int:
    """A port nobody listens on, so that runs side by side do not meet."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--frame", type=int, help="value on the timeline; default: as the file opens")
    parser.add_argument("--timeline", default="frame")
    parser.add_argument("--settle", type=float, default=3.0, help="seconds for images to decode")
    return parser.parse_args()


def main() -> int:
    args = parse()
    source, target = args.source.resolve(), args.target.resolve()
    if not source.is_file():
        sys.exit(f"{source}: no such file")
    with ViewerClient.spawn(headless=True, port=free_port(), hide_welcome_screen=True) as viewer:
        viewer.open([str(source)])
        if args.frame is not None:
            viewer.set_time(args.timeline, sequence=args.frame, play_state="paused")
        time.sleep(args.settle)
        state = viewer.get_state()
        target.write_bytes(viewer.take_screenshot())
        for number, view in enumerate(state.views):
            name = re.sub(r"[^A-Za-z0-9]+", "-", view.name or view.view_class)
            try:
                picture = viewer.take_screenshot(view_id=view.view_id)
                target.with_suffix(f".{number}-{name}.png").write_bytes(picture)
                status = "shown"
            except ConnectionError as error:  # a view behind another tab
                if "not found" not in str(error):
                    raise
                status = "behind a tab"
            print(f"{number} {view.view_class:<14} {view.name or '':<24} {status}")
            for report in view.reports:
                print(f"  report: {report}")
    if not state.views:
        print("the file opened without any view", file=sys.stderr)
        return 1
    return 1 if any(view.reports for view in state.views) else 0


if __name__ == "__main__":
    sys.exit(main())
