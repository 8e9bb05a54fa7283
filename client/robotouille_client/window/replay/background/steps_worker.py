"""The process that works out the steps to go of a recording, or of states that were seen: a line of
JSON for each finding.

python -m robotouille_client.window.replay.background.steps_worker FILE EXPANSIONS SECONDS
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from robotouille.certification.certificate import Deadline
from robotouille.errors import RobotouilleError
from robotouille.replay.analysis.distances import estimates
from robotouille.replay.recording import read_recording
from robotouille_client.window.replay.history.seen_states import ENDING, SeenStates

__all__ = ["main"]


def main(file: str, expansions: str, seconds: str) -> int:
    """Print `[step, least, most, dead]` as it is found; the exit status."""
    try:
        seen = SeenStates.read(Path(file)) if file.endswith(ENDING) else None
        source = seen or read_recording(file, damaged=True)
        first = seen.first if seen else 0
        for step, left in estimates(source, int(expansions), Deadline(float(seconds))):
            print(json.dumps([first + step, left.bound, left.steps, left.dead]), flush=True)
    except (RobotouilleError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
