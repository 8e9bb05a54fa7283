"""The hostile run, small: a real server process under attack, and what the verdict is made of."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

from tests.fuzz.assault import MIX, Report
from tests.fuzz.codes import documented_codes
from tests.fuzz.hostile import MAX_GROWTH, Verdict, run

COUNT = 2000


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


def test_a_fault_or_a_growing_memory_fails_the_run() -> None:
    verdict = Verdict()
    verdict.take(Report(0, 10, Counter({"socket: episodes": 10}), ["plan: KeyError at x.py:1"]))
    assert verdict.faults == {"plan: KeyError at x.py:1": 1}
    verdict.memory = [(0.0, 10**7), (0.3, 10**8), (1.0, 10**8 + MAX_GROWTH + 1)]
    assert verdict.growth == MAX_GROWTH + 1


def test_the_program_says_how_to_use_it() -> None:
    command = [sys.executable, "-m", "tests.fuzz.hostile", "--help"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0
    assert all(flag in done.stdout for flag in ("--count", "--jobs", "--seed", "--keep"))
