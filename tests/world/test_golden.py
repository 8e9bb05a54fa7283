"""What must not change unnoticed: observations, digests and the shape of the state space."""

import pytest

from tests.world.regenerate import GOLDEN, golden_files

FILES = sorted(path.name for path in GOLDEN.iterdir())


@pytest.fixture(scope="module")
def produced() -> dict[str, str]:
    return golden_files()


@pytest.mark.parametrize("file", FILES)
def test_golden_file(file: str, produced: dict[str, str]) -> None:
    """If the change is meant: python -m tests.world.regenerate"""
    assert (GOLDEN / file).read_bytes() == produced[file].encode()


def test_every_golden_file_is_there(produced: dict[str, str]) -> None:
    assert sorted(produced) == FILES
