"""When the server is killed, how often, and how: SIGKILLs are counted, SIGTERMs come on top."""

from __future__ import annotations

import signal
import sys
from collections import Counter
from itertools import pairwise

import pytest

from tests.programs.drill.__main__ import main
from tests.programs.drill.drill import Plan, Result
from tests.programs.drill.moments import MAX_IN_ROW, When, draw_kills
from tests.programs.drill.report import table


@pytest.mark.parametrize("count", [1, 5, 100])
@pytest.mark.parametrize("seed", range(5))
def test_so_many_sigkills_are_drawn_and_sigterms_on_top(seed: int, count: int) -> None:
    kills = draw_kills(seed, count)
    signals = Counter(kill.signal for kill in kills)
    assert signals[signal.SIGKILL] == count
    assert signals.keys() <= {signal.SIGKILL, signal.SIGTERM}
    assert kills[-1].signal is signal.SIGKILL
    assert kills == draw_kills(seed, count)


def test_about_one_in_ten_is_a_sigterm() -> None:
    drawn = Counter(kill.signal for seed in range(20) for kill in draw_kills(seed, 100))
    assert 0.05 < drawn[signal.SIGTERM] / drawn.total() < 0.12


def test_the_server_is_let_listen_now_and_then() -> None:
    for seed in range(20):
        row = 0
        for kill in draw_kills(seed, 100):
            row = row + 1 if kill.when is When.STARTING else 0
            assert row <= MAX_IN_ROW
            assert kill.signal is signal.SIGKILL or kill.when is not When.STARTING


def test_more_kills_begin_like_fewer() -> None:
    for fewer, more in pairwise([draw_kills(7, count) for count in (0, 3, 10, 30)]):
        assert more[: len(fewer)] == fewer


def test_the_report_tells_sigkills_from_sigterms() -> None:
    result = Result(Plan(kills=3))
    result.kills.update({"SIGKILL playing": 3, "SIGTERM event": 2})
    result.signals.update({"SIGKILL": 3, "SIGTERM": 2})
    assert "3 SIGKILL (3 asked for), and 2 SIGTERM on top" in table(result)
    assert "2 SIGTERM event" in table(result)


def test_the_program_says_which_signals_it_counts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["drill", "--help"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    assert "SIGTERMs come on top" in " ".join(capsys.readouterr().out.split())
