"""Coverage-guided fuzzing with Atheris: `python -m tests.programs.coverage_fuzzing KIND FOLDER`.

The kinds are `messages`, `files` and `recordings`. `FOLDER` is the corpus; the program first writes
real inputs into it. The first byte of a message or file selects its reader. Further arguments go to
Atheris. See tests/fuzz/README.md.
"""

from __future__ import annotations

import hashlib
import json
import random
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import msgpack

from robotouille.replay.container import MAGIC, frame_ends
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.forgery import framed, recording_bytes
from tests.support.fuzzing.specimens import (
    FILE_KINDS,
    MESSAGE_KINDS,
    client_messages,
    files,
    recordings,
    server_messages,
)

__all__ = ["SEEDS", "main", "mutate", "payloads_of"]

FORGED = 30
FRAME_HEAD = 12


def _messages() -> Iterator[bytes]:
    for kind, name in enumerate(MESSAGE_KINDS):
        for message in client_messages() if name.startswith("client") else server_messages():
            text = name.endswith("json")
            yield bytes([kind]) + (json.dumps(message).encode() if text else msgpack.packb(message))


def _files() -> Iterator[bytes]:
    for kind, name in enumerate(FILE_KINDS):
        for content in files(name):
            compact = content if name == "plan" else json.dumps(json.loads(content)).encode()
            yield bytes([kind]) + compact


def _recordings() -> Iterator[bytes]:
    yield from recordings()
    yield from (recording_bytes(Adversary(seed)) for seed in range(FORGED))


SEEDS = {"messages": _messages, "files": _files, "recordings": _recordings}


def mutate(data: bytes, max_size: int, seed: int, change: Callable[[bytes, int], bytes]) -> bytes:
    """Change a frame's content, duplicate or drop a frame, or change any bytes.

    The mutated frames have correct checksums, which arbitrary changes would rarely have.
    """
    chance = random.Random(seed)
    payloads = payloads_of(data)
    if not payloads or chance.random() < 0.1:
        return bytes(change(data, max_size))
    place = chance.randrange(len(payloads))
    pick = chance.random()
    if pick < 0.8:
        room = max(len(payloads[place]), max_size - len(data))
        payloads[place] = bytes(change(payloads[place], room))
    elif pick < 0.9:
        payloads.insert(place, chance.choice(payloads))
    else:
        del payloads[place]
    return (MAGIC + b"".join(map(framed, payloads)))[:max_size]


def payloads_of(data: bytes) -> list[bytes]:
    """Return the contents of a recording's frames."""
    if not data.startswith(MAGIC):
        return []
    ends = list(frame_ends(data))
    starts = [len(MAGIC), *ends[:-1]]
    return [data[start + FRAME_HEAD : end] for start, end in zip(starts, ends, strict=False)]


def main() -> None:
    """Write the corpus and fuzz until a reader fails."""
    import atheris  # type: ignore[import-untyped]

    with atheris.instrument_imports(include=["robotouille"]):
        from tests.support.fuzzing.targets import file_targets, message_targets

    kind, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    for seed in SEEDS[kind]():
        (folder / hashlib.sha256(seed).hexdigest()[:16]).write_bytes(seed)
    readers = message_targets() | file_targets(Path(tempfile.mkdtemp(prefix="robotouille-fuzz-")))
    names = MESSAGE_KINDS if kind == "messages" else FILE_KINDS

    def read(data: bytes) -> None:
        if kind == "recordings":
            readers["recording"](data)
        elif data:
            readers[names[data[0] % len(names)]](data[1:])

    options = {}
    if kind == "recordings":
        options["custom_mutator"] = lambda data, size, seed: mutate(
            data, size, seed, atheris.Mutate
        )
    atheris.Setup([sys.argv[0], *sys.argv[2:]], read, **options)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
