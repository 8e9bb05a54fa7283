"""Floods of a server and their effect on another game: `python -m tests.programs.floods`.

Each flood comes from a separate process, mostly with 4 or 60 connections that send as fast as the
server reads. At the same time, an ordinary real-time episode runs at 20 steps a second. The program
prints the longest gap between two of its deltas (the median of five runs; 50 ms is normal), the
growth of the server's memory, and whether a new client can still join. The exit status is 0 if all
results are within the limits.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from statistics import median

from tests.programs.floods.measure import Result, attack, measure, possible_floods
from tests.programs.floods.table import FLOODS, Target


def _rows(names: list[str], runs: int, seconds: float) -> Iterator[Result]:
    heads = ("flood", "gap", "of all runs", "memory", "log", "new client")
    print("{:16} {:>8}   {:30} {:>10} {:>9}  {}".format(*heads))
    for name in names:
        result = measure(name, runs, seconds)
        each = " ".join(f"{gap * 1000:.0f}" for gap in result.gaps)
        print(
            f"{name:16} {result.gap * 1000:5.0f} ms   {each:30} {result.growth / 2**20:+6.1f} MiB"
            f" {result.log_bytes / 1024:5.0f} KiB  {'admitted' if result.admitted else 'REFUSED'}"
            f"{f', {median(result.served):.0f} loads a second' if result.served else ''}"
            f"{'' if result.withstood else '   <-- exceeds the limits'}",
            flush=True,
        )
        yield result


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a flood exceeded the limits."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.programs.floods",
        description=__doc__,
        epilog="\n".join(f"{name:18} {flood.description}" for name, flood in FLOODS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("floods", nargs="*", help="some of those below; all by default")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a run")
    parser.add_argument("--attack", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.attack:
        name, port, code = given.attack
        attack(name, Target(int(port), code))
        return 0
    results = list(_rows(given.floods or possible_floods(), given.runs, given.seconds))
    return 0 if all(result.withstood for result in results) else 1


if __name__ == "__main__":
    sys.exit(main())
