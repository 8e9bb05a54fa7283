"""Measure the time from the start of the window's commands to their first frames.

python -m benchmarks.startup

Two frames count: the first one, and the first one with a kitchen. Times are in seconds of wall
time and processor time, and are compared with the import of pygame. Drawing needs no display. Needs
the extra `window`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec

RUNS = 3
COMMANDS = {
    "robotouille-client": ("robotouille_client.window.cli",),
    "robotouille play multi_agent/01": ("robotouille_client.cli.main", "play", "multi_agent/01"),
}
PROGRAM = """
import importlib, json, os, sys, time
import pygame

shown, flip = [], pygame.display.flip

def noted():
    flip()
    kitchen = sys._getframe(2).f_code.co_filename.endswith(os.path.join("window", "window.py"))
    shown.append((kitchen, time.time() - float(os.environ["BEGAN"]), time.process_time()))
    if kitchen or len(sys.argv) < 2:
        print(json.dumps(shown), flush=True)
        os._exit(0)

pygame.display.flip = noted
name, *sys.argv[1:] = sys.argv[1:]
importlib.import_module(name).main()
"""
"""Program that exits after the first frame with a kitchen, or without a task after any frame."""

Taken = tuple[float, float]
"""Seconds of wall time and of processor time."""


def first_pictures(command: tuple[str, ...]) -> tuple[Taken, Taken]:
    """Return the times of the first frame and of the last frame shown.

    The last frame is the first one with a kitchen, if the command opens one.
    """
    with tempfile.TemporaryDirectory() as home:
        environment = {
            **os.environ, "SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy",
            "XDG_CONFIG_HOME": home, "XDG_DATA_HOME": home, "BEGAN": str(time.time()),
        }  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *command],
            env=environment, check=True, text=True, stdout=subprocess.PIPE,
        )  # fmt: skip
    shown = json.loads(done.stdout.splitlines()[-1])
    return (shown[0][1], shown[0][2]), (shown[-1][1], shown[-1][2])


def importing_pygame() -> Taken:
    """Return the time to import pygame."""
    begun = time.perf_counter()
    code = "import time, pygame; print(time.process_time())"
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, text=True, stdout=subprocess.PIPE
    )
    return time.perf_counter() - begun, float(done.stdout.split()[-1])


def main() -> None:
    """Print the fastest of several runs."""
    if not find_spec("pygame"):
        print("window start: skipped; needs the extra `window`")
        return
    alone = min(importing_pygame() for _ in range(RUNS))
    print(f"\nTime from process start; import of pygame {_words(alone, alone)}")
    for name, command in COMMANDS.items():
        runs = [first_pictures(command) for _ in range(RUNS)]
        first, kitchen = (min(run[n] for run in runs) for n in (0, 1))
        print(f"  {name:32} first frame   {_words(first, alone)}")
        if kitchen != first:
            print(f"  {'':32} first kitchen {_words(kitchen, alone)}")


def _words(taken: Taken, alone: Taken) -> str:
    return f"{taken[0]:.2f} s, {taken[1]:.2f} s processor time ({taken[1] / alone[1]:.1f} ×)"


if __name__ == "__main__":
    main()
