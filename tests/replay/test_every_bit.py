"""A sample of what `python -m tests.programs.every_bit` does for every bit of a file."""

from __future__ import annotations

import pytest

from robotouille.replay import container as frames
from robotouille.replay.container import MAGIC, compress, frame_ends
from tests.programs.every_bit import flip_some
from tests.support.games import recorded_game

STRIDE, SHORT_STRIDE = 399, 9
"""Bits; odd, so that it is another bit of a byte each time."""


@pytest.fixture(scope="module")
def stream() -> bytes:
    return recorded_game("training/01_synchronous", seed=5, steps=3)


def test_a_flipped_bit_of_an_open_file_is_noticed_and_every_frame_before_it_read(
    stream: bytes,
) -> None:
    header = 8 * next(frame_ends(stream))
    begin = 8 * len(MAGIC)
    behind = range(header, 8 * len(stream), SHORT_STRIDE)
    bits = [*range(begin), *range(begin, header, STRIDE), *behind]
    counts = flip_some(stream, bits, closed=False)
    assert set(counts) == {"noticed, in the header", "noticed"}
    assert counts["noticed"] == len(behind)


def test_a_flipped_bit_of_a_closed_file_is_noticed_and_every_block_before_it_read(
    stream: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In small blocks, of which a game this short has many."""
    monkeypatch.setattr(frames, "BLOCK", 256)
    end = 8 * len(compress(stream))
    bits = [*range(0, end - 64, STRIDE), *range(end - 64, end, SHORT_STRIDE)]
    counts = flip_some(stream, bits, closed=True)
    assert set(counts) <= {"noticed, in the header", "noticed", "nothing changed"}
    assert counts["noticed"] > 10, "none behind the header"
