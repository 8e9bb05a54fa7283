"""Process that makes the data of a recording's page: `python -m … NAME SIZE TASKS`.

It reads SIZE bytes of the recording from its standard input, and writes the data as compressed
JSON. TASKS is the folder of the operator's own tasks, or empty.
"""

from __future__ import annotations

import gzip
import os
import sys
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille.replay.file_names import recording_stem
from robotouille.replay.looks import choose_look
from robotouille.replay.recording import recording_of
from robotouille.web.recording_page import page_data
from robotouille.web.single_file import encoded


def main() -> None:
    """Run the process. An error is one line on the standard error."""
    name, size, tasks = sys.argv[1:]
    # Games come first.
    os.nice(10)
    try:
        recording = recording_of(sys.stdin.buffer.read(int(size)), name, damaged=True)
        if tasks:
            choose_look(recording, [Path(tasks)])
        data = page_data([(recording_stem(name), recording)])
    except RobotouilleError as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(gzip.compress(encoded(data), 6))


if __name__ == "__main__":
    main()
