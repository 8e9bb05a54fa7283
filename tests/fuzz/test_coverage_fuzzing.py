"""The seeds and mutations of coverage-guided fuzzing, without Atheris."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from robotouille.replay.container import MAGIC, read_frames
from tests.programs.coverage_fuzzing import SEEDS, mutate, payloads_of
from tests.support.fuzzing.specimens import FILE_KINDS, MESSAGE_KINDS, recordings
from tests.support.fuzzing.targets import file_targets, message_targets

LIMIT = 100_000


@pytest.mark.parametrize("kind", SEEDS)
def test_seeds_reach_every_reader(kind: str, tmp_path: Path) -> None:
    readers = message_targets() | file_targets(tmp_path)
    names = {"messages": MESSAGE_KINDS, "files": FILE_KINDS}.get(kind, ("recording",))
    results = Counter[tuple[str, str]]()
    for seed in SEEDS[kind]():
        name = names[0] if kind == "recordings" else names[seed[0]]
        results[name, readers[name](seed if kind == "recordings" else seed[1:])] += 1
    assert {name for name, result in results if result == "read"} == set(names)
    if kind == "messages":
        assert {result for _, result in results} == {"read"}


def test_mutations_change_duplicate_and_drop_frames_with_correct_checksums() -> None:
    whole = next(content for content in recordings() if content.startswith(MAGIC))
    count = len(payloads_of(whole))
    assert count == len(list(read_frames(whole)))
    changes = Counter[int]()
    for number in range(200):
        mutated = mutate(whole, LIMIT, number, lambda data, size: (data + b"\xc1")[:size])
        assert len(mutated) <= LIMIT
        changes[len(payloads_of(mutated)) - count] += 1
        if len(payloads_of(mutated)) < count:
            assert len(list(read_frames(mutated))) == count - 1
    assert changes.keys() == {-1, 0, 1}
    assert changes[0] > changes[-1] + changes[1]
