"""The hostile run, small: a real server process under attack, and what the verdict is made of."""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.programs.hostile.__main__ import MAX_GROWTH, Verdict, judge, main, run
from tests.programs.hostile.assault import MIX, Report
from tests.support.fuzzing.codes import documented_codes

COUNT = 2000
MIB = 2**20


@pytest.mark.process
@pytest.mark.slow
def test_a_server_under_attack_answers_with_documented_codes_and_stays_whole() -> None:
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
    assert sum(words.values()) > COUNT // 2, "hardly anything was answered"
    assert sum(MIX.values()) == 100


def judged(tmp_path: Path, memory: list[int], log: str = "") -> Counter[str]:
    """The faults that are found after a run with so much memory at its ten marks."""
    path = tmp_path / "server.log"
    path.write_text(log, encoding="utf-8")
    verdict = Verdict(memory=[(mark / (len(memory) - 1), size) for mark, size in enumerate(memory)])
    judge(verdict, path)
    return verdict.faults


def test_a_fault_fails_the_run() -> None:
    verdict = Verdict()
    verdict.take(Report(0, 10, Counter({"socket: episodes": 10}), ["plan: KeyError at x.py:1"]))
    assert verdict.faults == {"plan: KeyError at x.py:1": 1}


@pytest.mark.parametrize(
    "memory",
    [
        [40 * MIB + mark * MAX_GROWTH // 5 for mark in range(11)],
        [100 * MIB] * 10 + [100 * MIB + MAX_GROWTH + 1],
    ],
    ids=["steadily", "at the end"],
)
def test_a_growing_memory_fails_the_run(tmp_path: Path, memory: list[int]) -> None:
    (fault,) = judged(tmp_path, memory)
    assert re.fullmatch(r"the server's memory grew by \d\d\.\d MiB", fault)


@pytest.mark.parametrize(
    "memory",
    [
        [100 * MIB] * 11,
        [40 * MIB, 60 * MIB, 80 * MIB] + [100 * MIB] * 8,
        [100 * MIB + mark % 2 * MAX_GROWTH for mark in range(11)],
        [200 * MIB - mark * MIB for mark in range(11)],
    ],
    ids=["flat", "while it warms up", "to and fro", "shrinking"],
)
def test_a_flat_memory_passes(tmp_path: Path, memory: list[int]) -> None:
    assert not judged(tmp_path, memory)


def test_an_error_in_the_servers_log_fails_the_run(tmp_path: Path) -> None:
    (fault,) = judged(tmp_path, [100 * MIB] * 11, "Traceback (most recent call last): …")
    assert fault.startswith("the server's log has an error: Traceback")


def test_the_program_says_how_to_use_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["hostile", "--help"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    said = capsys.readouterr().out
    assert all(flag in said for flag in ("--count", "--jobs", "--seed", "--keep"))
