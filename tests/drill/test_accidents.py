"""The accidents and kills of a drill."""

from __future__ import annotations

import signal

from tests.programs.drill.accidents import ALL_ACCIDENTS, PHASES, Fates
from tests.programs.drill.moments import When, draw_kills


def test_five_games_have_all_accidents_in_all_phases() -> None:
    fates, found = Fates(seed=7, person=1), set()
    for _ in range(5):
        fates.begin()
        for phase in PHASES:
            assert fates.wait(phase)
            found.add(f"{fates.take(phase)} {phase}")
            assert not fates.wait(phase)
    assert found == ALL_ACCIDENTS


def test_phase_that_games_lack_loses_no_accident() -> None:
    fates, found = Fates(seed=7, person=0), set()
    for game in range(10):
        fates.begin()
        if game % 2:
            found.add(fates.take("countdown"))
    assert len(found) == 5


def test_people_begin_with_different_accidents() -> None:
    people = [Fates(seed=7, person=number) for number in range(2)]
    for fates in people:
        fates.begin()
    assert len({fates.take("running") for fates in people}) == 2


def test_first_kill_comes_during_play() -> None:
    for seed in range(50):
        kills = draw_kills(seed, 3)
        assert kills[0].when is When.PLAYING
        assert kills[-1].signal is signal.SIGKILL
        assert sum(kill.signal is signal.SIGKILL for kill in kills) == 3
