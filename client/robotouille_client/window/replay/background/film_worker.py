"""The process that writes a span of a recording as a video: a line `DONE TOTAL` now and then.

python -m robotouille_client.window.replay.background.film_worker
    FILE OUTPUT FIRST LAST RATE TASKS RENDERING
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille_client.window.replay.film import filming
from robotouille_client.window.replay.history.recorded import RecordedHistory
from robotouille_client.window.replay.history.recorded_look import open_shown

__all__ = ["main"]

SIZE = "1280x720"
EVERY = 12
"""Frames from one line to the next."""


def main(
    file: str, output: str, first: str, last: str, rate: str, tasks: str, rendering: str
) -> int:
    """Write the video; the exit status. What is wrong is told on standard error."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    span = int(first), int(last)
    try:
        recording = open_shown(Path(file), Path(tasks) if tasks else None, damaged=True)
        history = RecordedHistory(recording)
        written = filming(history, Path(output), float(rate), SIZE, span, rendering)
        for done, total in written:
            if done % EVERY == 0:
                print(done, total, flush=True)
    except RobotouilleError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
