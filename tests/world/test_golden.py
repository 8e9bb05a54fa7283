"""Golden files of observations, digests and state counts."""

import json

import pytest

from tests.world.regenerate import GOLDEN, PERFT_FILE, golden_files, perft

FILES = sorted(path.name for path in GOLDEN.iterdir())


@pytest.mark.parametrize(
    "file",
    [pytest.param(file, marks=[pytest.mark.slow] * (file == PERFT_FILE)) for file in FILES],
)
def test_golden_file_is_unchanged(file: str) -> None:
    """After an intended change, run `python -m tests.world.regenerate`."""
    assert (GOLDEN / file).read_bytes() == golden_files()[file]().encode()


@pytest.mark.slow
def test_state_counts_are_unchanged() -> None:
    for name, counts in json.loads((GOLDEN / PERFT_FILE).read_text()).items():
        depth = len(counts) - 2
        assert perft(name, depth) == counts[: depth + 1]


def test_every_golden_file_exists() -> None:
    assert sorted(golden_files()) == FILES
