#!/usr/bin/env python3
"""Compares two logs message by message with the independent reader PyPI `mcap`.

Usage: compare_logs.py A B [--only TOPIC ...] [--missing TOPIC ...]
Needs: pip install mcap

Prints for each topic how many messages are the same bytes at the same log time, and how many each log holds. Exits with 0
if all of them are the same; topics under --missing may lack in B.
"""

import argparse
import sys
from collections import defaultdict

from mcap.reader import make_reader


def messages(path):
    """Stamp and bytes of all messages by topic, in the file's order."""
    topics = defaultdict(list)
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            topics[channel.topic].append((message.log_time, message.data))
    return topics


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("a")
    parser.add_argument("b")
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--missing", nargs="*", default=[])
    options = parser.parse_args()
    a, b = messages(options.a), messages(options.b)
    names = options.only or sorted(set(a) | set(b))
    bad = 0
    for name in names:
        left, right = a.get(name, []), b.get(name, [])
        equal = len(set(left) & set(right))
        lacks = name in options.missing and not right
        good = lacks or (equal == len(left) == len(right) and left == right and left)
        bad += not good
        print(f"{'ok ' if good else 'BAD'} {name}: {equal} equal of {len(left)} and {len(right)}{' (format has no place)' if lacks else ''}")
    print(f"{len(names) - bad} of {len(names)} topics as they should be")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
