"""What must not change unnoticed: observations, digests and the shape of the state space."""

import pytest

from tests.world.regenerate import GOLDEN, golden_files

FILES = sorted(path.name for path in GOLDEN.iterdir())


@pytest.mark.parametrize("file", FILES)
def test_golden_file(file: str) -> None:
    """If the change is meant: python -m tests.world.regenerate"""
    assert (GOLDEN / file).read_bytes() == golden_files()[file]().encode()


def test_every_golden_file_is_there() -> None:
    assert sorted(golden_files()) == FILES
