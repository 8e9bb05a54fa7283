"""Process that makes the data of a recording's page: `python -m … NAME SIZE TASKS`.

It reads SIZE bytes of the recording from its standard input, and writes the data as compressed
JSON. TASKS is the folder of the operator's own tasks, or empty.
"""

from __future__ import annotations

import gzip
import os
import sys
from contextlib import suppress
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille.replay.file_names import recording_stem
from robotouille.replay.looks import choose_look
from robotouille.replay.recording import recording_of
from robotouille.web.recording_page import page_data
from robotouille.web.single_file import encoded

MAX_MEMORY = 1024 * 1024 * 1024
"""Bytes of memory for the process. A recording expands to 256 MiB, and a page's data to 64 MiB."""


def main() -> None:
    """Run the process. An error is one line on the standard error."""
    name, size, tasks = sys.argv[1:]
    # Games come first.
    os.nice(10)
    _limit_memory()
    try:
        recording = recording_of(sys.stdin.buffer.read(int(size)), name, damaged=True)
        if tasks:
            choose_look(recording, [Path(tasks)])
        data = page_data([(recording_stem(name), recording)])
        content = gzip.compress(encoded(data), 6)
    except RobotouilleError as error:
        sys.exit(str(error))
    except MemoryError:
        sys.exit(f"{name} needs more than {MAX_MEMORY >> 20} MiB of memory")
    sys.stdout.buffer.write(content)


def _limit_memory() -> None:
    # A hostile recording must not use up the memory of the games.
    if sys.platform == "win32":
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    with suppress(OSError, ValueError):  # The system allows less, or does not support the limit.
        resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, hard))


if __name__ == "__main__":
    main()
