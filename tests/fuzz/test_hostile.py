"""A small hostile run: a real server process under attack, and the verdict on it."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.programs.hostile.__main__ import run
from tests.programs.hostile.assault import MIX
from tests.support.fuzzing.codes import documented_codes

COUNT = 2000


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
