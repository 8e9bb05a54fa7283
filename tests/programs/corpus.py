"""Seeds for the coverage-guided fuzzers: `python -m tests.programs.corpus FOLDER`.

Real messages, recordings and files, one a file, in a folder for each fuzzer. The first byte of a
message or file says which reader it is for, by its place in `tests.support.fuzzing.targets`.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import msgpack

from tests.support.fuzzing.forgery import recording_bytes
from tests.support.fuzzing.hostility import Adversary
from tests.support.fuzzing.specimens import (
    FILE_KINDS,
    MESSAGE_KINDS,
    client_messages,
    files,
    recordings,
    server_messages,
)

__all__ = ["main"]

FORGED = 30


def _messages() -> Iterator[bytes]:
    for kind, name in enumerate(MESSAGE_KINDS):
        side = client_messages() if name.startswith("client") else server_messages()
        for message in side:
            text = name.endswith("json")
            yield bytes([kind]) + (json.dumps(message).encode() if text else msgpack.packb(message))


def _files() -> Iterator[bytes]:
    for kind, name in enumerate(FILE_KINDS):
        for content in files(name):
            compact = content if name == "plan" else json.dumps(json.loads(content)).encode()
            yield bytes([kind]) + compact


def _recordings() -> Iterator[bytes]:
    yield from recordings()
    for seed in range(FORGED):
        yield recording_bytes(Adversary(seed))


def main(folder: Path) -> None:
    """Write all seeds under `folder`."""
    kinds = {"messages": _messages(), "files": _files(), "recordings": _recordings()}
    for name, seeds in kinds.items():
        target = folder / name
        target.mkdir(parents=True, exist_ok=True)
        for seed in seeds:
            (target / hashlib.sha256(seed).hexdigest()[:16]).write_bytes(seed)
        print(f"{len(list(target.iterdir())):4} seeds  {target}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/corpus"))
