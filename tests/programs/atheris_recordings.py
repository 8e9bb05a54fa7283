"""Coverage-guided fuzzing of the reader of recordings; see README.md.

Mutated bytes alone would never pass a frame's checksum, so most mutations change the content of
one frame and give it the right length and checksum again.
"""

import random
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["robotouille"]):
    from robotouille.replay.container import MAGIC, VERSIONS, frame_ends, magic
    from tests.support.fuzzing.forgery import framed
    from tests.support.fuzzing.targets import file_targets

read = file_targets(Path(tempfile.mkdtemp(prefix="robotouille-fuzz-")))["recording"]


def one_input(data: bytes) -> None:
    read(data)


def mutate(data: bytes, max_size: int, seed: int) -> bytes:
    """A frame's content changed, a frame doubled or left out; or any bytes."""
    chance = random.Random(seed)
    payloads = _payloads(data)
    if not payloads or chance.random() < 0.1:
        return bytes(atheris.Mutate(data, max_size))
    place = chance.randrange(len(payloads))
    pick = chance.random()
    if pick < 0.8:
        room = max(len(payloads[place]), max_size - len(data))
        payloads[place] = bytes(atheris.Mutate(payloads[place], room))
    elif pick < 0.9:
        payloads.insert(place, chance.choice(payloads))
    else:
        del payloads[place]
    version = chance.choice(VERSIONS) if chance.random() < 0.1 else data[4]
    return (magic(version) + b"".join(framed(payload, version) for payload in payloads))[:max_size]


def _payloads(data: bytes) -> list[bytes]:
    if data[:5] not in map(magic, VERSIONS):
        return []
    found, position, head = [], len(MAGIC), 8 if data[4] == 1 else 12
    for end in frame_ends(data):
        found.append(data[position + head : end])
        position = end
    return found


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input, custom_mutator=mutate)
    atheris.Fuzz()
