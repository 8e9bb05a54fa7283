"""Processes of the viewer, which keep slow work out of the window's process.

- `python -m robotouille_client.window.replay.workers film FILE OUTPUT FIRST LAST RATE TASKS
  RENDERING` writes part of a recording as a video and prints lines `DONE TOTAL`.
- `python -m robotouille_client.window.replay.workers steps FILE EXPANSIONS SECONDS` computes the
  steps to go of a recording, or of saved states, and prints lines of JSON.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

from robotouille.errors import RobotouilleError

SIZE = "1280x720"
# Frames between two lines about the progress.
EVERY = 12


def film(
    file: str,
    output: str,
    draft: str,
    first: str,
    last: str,
    rate: str,
    tasks: str,
    rendering: str,
) -> None:
    """Write the steps from `first` to `last` as a video."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    # Imported after the driver is set, and not at all by the search.
    from robotouille_client.window.replay.film import filming
    from robotouille_client.window.replay.histories.recorded_history import (
        RecordedHistory,
        open_shown,
    )

    span = int(first), int(last)
    recording = open_shown(Path(file), Path(tasks) if tasks else None, damaged=True)
    history = RecordedHistory(recording)
    written = filming(history, Path(output), float(rate), SIZE, span, rendering, draft=Path(draft))
    for done, total in written:
        if done % EVERY == 0:
            print(done, total, flush=True)


def steps(file: str, expansions: str, seconds: str) -> None:
    """Print `[step, least, most, dead]` for each finding."""
    from robotouille.certification.certificate import Deadline
    from robotouille.replay.distances import estimates
    from robotouille.replay.recording import read_recording
    from robotouille_client.window.replay.histories.recorded_states import ENDING, SavedStates

    saved = SavedStates.read(Path(file)) if file.endswith(ENDING) else None
    source = saved or read_recording(file, damaged=True)
    first = saved.first if saved else 0
    for step, left in estimates(source, int(expansions), Deadline(float(seconds))):
        print(json.dumps([first + step, left.bound, left.steps, left.dead]), flush=True)


def main(job: str, *arguments: str) -> int:
    """Run a job. Return the exit status; errors go to standard error."""
    jobs: dict[str, Callable[..., None]] = {"film": film, "steps": steps}
    try:
        jobs[job](*arguments)
    except (RobotouilleError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
