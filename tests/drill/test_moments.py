"""The drill's kills: SIGKILLs are counted, SIGTERMs are sent in addition."""

from __future__ import annotations

import signal
from collections import Counter

import pytest

from tests.programs.drill.drill import Plan, Result
from tests.programs.drill.moments import MAX_IN_ROW, When, draw_kills
from tests.programs.drill.report import table


@pytest.mark.parametrize("count", [1, 5, 100])
@pytest.mark.parametrize("seed", range(5))
def test_draw_has_the_requested_sigkills_and_additional_sigterms(seed: int, count: int) -> None:
    kills = draw_kills(seed, count)
    signals = Counter(kill.signal for kill in kills)
    assert signals[signal.SIGKILL] == count
    assert signals.keys() <= {signal.SIGKILL, signal.SIGTERM}
    assert kills[-1].signal is signal.SIGKILL
    assert kills == draw_kills(seed, count)


def test_about_a_tenth_of_the_kills_are_sigterms() -> None:
    drawn = Counter(kill.signal for seed in range(20) for kill in draw_kills(seed, 100))
    assert 0.05 < drawn[signal.SIGTERM] / drawn.total() < 0.12


def test_server_can_listen_between_kills() -> None:
    for seed in range(20):
        row = 0
        for kill in draw_kills(seed, 100):
            row = row + 1 if kill.when is When.STARTING else 0
            assert row <= MAX_IN_ROW
            assert kill.signal is signal.SIGKILL or kill.when is not When.STARTING


def test_report_separates_sigkills_and_sigterms() -> None:
    result = Result(Plan(kills=3))
    result.kills.update({"SIGKILL playing": 3, "SIGTERM event": 2})
    result.signals.update({"SIGKILL": 3, "SIGTERM": 2})
    assert "3 SIGKILL (3 requested) and 2 additional SIGTERM" in table(result)
    assert "2 SIGTERM event" in table(result)
