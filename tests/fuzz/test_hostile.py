"""A small hostile run: a real server process under attack, and the verdict on it."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from tests.programs.hostile.__main__ import MAX_GROWTH, Verdict, judge, run
from tests.programs.hostile.assault import MIX, Report
from tests.support.fuzzing.codes import documented_codes

COUNT = 2000
MIB = 2**20


@pytest.mark.process
@pytest.mark.slow
def test_attacked_server_replies_with_documented_codes_and_stays_intact() -> None:
    verdict = run(COUNT, jobs=1, seed=5)
    assert not verdict.faults, verdict.faults
    assert verdict.done == COUNT
    assert verdict.memory[-1][0] == 1.0
    words = verdict.outcomes
    kinds = Counter(word.partition(":")[0] for word in words)
    assert kinds.keys() >= {"socket", "recording", "client-json", "client-msgpack", "problem"}
    codes = {word.split()[-1] for word in words if word.startswith("socket: error")}
    assert {"message/malformed", "message/invalid-field", "episode/none"} <= codes
    assert codes <= documented_codes()
    assert sum(words.values()) > COUNT // 2, "too few replies"
    assert sum(MIX.values()) == 100


def judged(tmp_path: Path, memory: list[int], log: str = "") -> Counter[str]:
    """Return the faults of a run with these memory sizes at regular intervals."""
    path = tmp_path / "server.log"
    path.write_text(log, encoding="utf-8")
    verdict = Verdict(memory=[(mark / (len(memory) - 1), size) for mark, size in enumerate(memory)])
    judge(verdict, path)
    return verdict.faults


def test_fault_fails_the_run() -> None:
    verdict = Verdict()
    verdict.take(Report(0, 10, Counter({"socket: episodes": 10}), ["plan: KeyError at x.py:1"]))
    assert verdict.faults == {"plan: KeyError at x.py:1": 1}


def test_growing_memory_and_logged_errors_fail_the_run(tmp_path: Path) -> None:
    for growing in (
        [40 * MIB + mark * MAX_GROWTH // 5 for mark in range(11)],
        [100 * MIB] * 10 + [100 * MIB + MAX_GROWTH + 1],
    ):
        (fault,) = judged(tmp_path, growing)
        assert re.fullmatch(r"the server's memory grew by \d\d\.\d MiB", fault)
    for flat in (
        [100 * MIB] * 11,
        [40 * MIB, 60 * MIB, 80 * MIB] + [100 * MIB] * 8,  # Growth during the warm-up.
        [100 * MIB + mark % 2 * MAX_GROWTH for mark in range(11)],
        [200 * MIB - mark * MIB for mark in range(11)],
    ):
        assert not judged(tmp_path, flat)
    (fault,) = judged(tmp_path, [100 * MIB] * 11, "Traceback (most recent call last): …")
    assert fault.startswith("the server's log has an error: Traceback")
