"""The process that works out the steps to go of a recording: a line of JSON for each finding.

python -m robotouille_client.window.replay.background.steps_worker FILE EXPANSIONS SECONDS
"""

from __future__ import annotations

import json
import sys

from robotouille.certification.certificate import Deadline
from robotouille.errors import RobotouilleError
from robotouille.replay.analysis.distances import estimates
from robotouille.replay.recording import read_recording

__all__ = ["main"]


def main(file: str, expansions: str, seconds: str) -> int:
    """Print `[step, least, most, dead]` as it is found; the exit status."""
    try:
        recording = read_recording(file, damaged=True)
        for step, left in estimates(recording, int(expansions), Deadline(float(seconds))):
            print(json.dumps([step, left.bound, left.steps, left.dead]), flush=True)
    except (RobotouilleError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
