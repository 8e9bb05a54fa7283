"""Flip every single bit of a recording: `python -m tests.programs.every_bit [FILE.rbt …]`.

Without a file, the program plays a small episode. It tests each recording as an open file and as a
closed one. The reader must notice each flip, unless the content it reads stays the same. It must
still read everything before the flip: in an open file every frame, in a closed file every frame of
the earlier blocks. The exit status is 1 on failure.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Iterable
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from robotouille import RecordingError
from robotouille.replay.compression import compress, unwrap
from robotouille.replay.container import frame_ends
from robotouille.replay.recording import Recording, recording_of

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["flip_all", "flip_some", "main"]

JOBS = os.cpu_count() or 1


def _open_file(stream: bytes, bit: int) -> str:
    """Classify one flip in an open recording."""
    damaged, byte = _flipped(stream, bit), bit // 8
    try:
        found = Recording(damaged)
    except RecordingError:
        ends = [end for end in frame_ends(stream) if end <= byte]
        if len(ends) == 0:
            return "noticed, in the header"
        before = Recording(damaged, damaged=True)
        if before.whole != ends[-1] or damaged[: ends[-1]] != stream[: ends[-1]]:
            return "EARLIER FRAME LOST"
        return "noticed"
    return "nothing changed" if found.stream == stream else "NOT NOTICED"


def _closed_file(stream: bytes, content: bytes, bit: int) -> str:
    """Classify one flip in a closed recording."""
    damaged = _flipped(content, bit)
    try:
        found = recording_of(damaged, "it")
    except RecordingError:
        return _read_before(stream, damaged, _length_before(content, bit // 8))
    return "nothing changed" if found.stream == stream else "NOT NOTICED"


def _read_before(stream: bytes, damaged: bytes, length: int) -> str:
    """Check that all frames that end within the first `length` bytes of a stream are read."""
    ends = [end for end in frame_ends(stream) if end <= length]
    if len(ends) == 0:
        return "noticed, in the header"
    before = recording_of(damaged, "it", damaged=True)
    if before.whole < ends[-1] or before.stream[: ends[-1]] != stream[: ends[-1]]:
        return "EARLIER BLOCK LOST"
    return "noticed"


@cache
def _length_before(content: bytes, byte: int) -> int:
    """Return the stream's length in the blocks that end before a byte of a closed file."""
    return len(zstd.ZstdDecompressor().decompress(content[:byte]))


def _flipped(content: bytes, bit: int) -> bytes:
    damaged = bytearray(content)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def flip_some(stream: bytes, bits: Iterable[int], *, closed: bool) -> Counter[str]:
    """Count the results of these flips in a plain stream."""
    if not closed:
        return Counter(_open_file(stream, bit) for bit in bits)
    content = compress(stream)
    return Counter(_closed_file(stream, content, bit) for bit in bits)


def _some(work: tuple[bool, bytes, range]) -> Counter[str]:
    closed, stream, bits = work
    return flip_some(stream, bits, closed=closed)


def flip_all(stream: bytes, *, closed: bool, jobs: int = JOBS) -> Counter[str]:
    """Count the results of all flips in a stream, as an open or a closed file."""
    bits = 8 * len(compress(stream) if closed else stream)
    parts = [(closed, stream, range(first, bits, 64)) for first in range(64)]
    with get_context("spawn").Pool(jobs) as pool:
        counts = Counter[str]()
        for part in pool.imap_unordered(_some, parts):
            counts += part
    return counts


def main() -> int:
    """Print the table for the given files, or for a small episode."""
    parser = argparse.ArgumentParser(prog="python -m tests.programs.every_bit", description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    given, failed = parser.parse_args(), False
    streams = {str(path): unwrap(path.read_bytes()) for path in given.files}
    if not streams:
        from tests.support.games import recorded_game

        streams = {"a small episode": recorded_game("training/01_synchronous", seed=5, steps=12)}
    for name, stream in streams.items():
        for closed in (False, True):
            counts = flip_all(stream, closed=closed)
            failed = failed or any(what.isupper() for what in counts)
            told = ", ".join(f"{count:,} {what}" for what, count in sorted(counts.items()))
            print(f"{name}, {'closed' if closed else 'open'}: {counts.total():,} flips: {told}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
