"""`python -m tests.programs.drill`: kill a real server a hundred times during fifty episodes."""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from tests.programs.drill.drill import Plan, run_drill
from tests.programs.drill.report import table, write_json


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.programs.drill", description=__doc__)
    parser.add_argument(
        "--kills",
        type=int,
        default=100,
        help="number of SIGKILLs; SIGTERMs are sent in addition",
    )
    parser.add_argument("--games", type=int, default=50, help="simultaneous episodes")
    parser.add_argument("--windows", type=int, default=2, help="windows of people (under Xvfb)")
    parser.add_argument("--pages", type=int, default=2, help="people with a browser")
    parser.add_argument("--processes", type=int, default=3, help="processes for the bots")
    parser.add_argument("--seed", type=int, default=None, help="seed of episodes and kills")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--folder", type=Path, help="keep recordings, logs and pictures here")
    options = parser.parse_args()
    missing = [name for name in ("Xvfb", "xdotool") if not shutil.which(name)]
    if options.windows and missing:
        parser.error(f"windows need {' and '.join(missing)}; install them or use --windows 0")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if options.pages and not (chromium and find_spec("playwright")):
        parser.error("pages need chromium and playwright; install them or use --pages 0")
    seed = options.seed if options.seed is not None else time.time_ns() % 1_000_000
    plan = replace(
        Plan(), kills=options.kills, games=options.games, windows=options.windows,
        pages=options.pages, processes=options.processes, seed=seed,
        all_accidents=options.pages > 0,
    )  # fmt: skip
    folder = options.folder or Path(tempfile.mkdtemp(prefix="robotouille-drill-"))
    begun = time.monotonic()

    def say(text: str) -> None:
        print(f"{time.monotonic() - begun:6.1f}  {text}", flush=True)

    say(f"seed {seed}, files in {folder}")
    result = asyncio.run(run_drill(plan, folder, say))
    print(table(result))
    if options.json is not None:
        write_json(result, options.json)
    return 0 if result.ok else 1


if __name__ == "__main__":
    sys.exit(main())
