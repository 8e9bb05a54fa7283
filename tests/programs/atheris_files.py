"""Coverage-guided fuzzing of the readers of domains, problems, inputs, renderings, plans and
certificates; see README.md."""

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["robotouille"]):
    from tests.support.fuzzing.specimens import FILE_KINDS
    from tests.support.fuzzing.targets import file_targets

READERS = file_targets(Path(tempfile.mkdtemp(prefix="robotouille-fuzz-")))
TARGETS = [READERS[name] for name in FILE_KINDS]


def one_input(data: bytes) -> None:
    """The first byte chooses the reader."""
    if data:
        TARGETS[data[0] % len(TARGETS)](data[1:])


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
