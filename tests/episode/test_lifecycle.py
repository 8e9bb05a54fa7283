"""State machines of episodes and seats: complete tables that both obey."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

import pytest

from robotouille import World
from robotouille.episode import (
    Episode,
    EpisodeEnded,
    Outcome,
    Paused,
    PauseReason,
    Phase,
    Reason,
    Resumed,
    Rules,
    Started,
)
from robotouille.episode.lifecycle import (
    PHASES,
    PhaseEvent,
)
from robotouille.errors import IllegalEventError

WORLD = World("multi_agent/01")
EVENTS = {
    PhaseEvent.START: Started,
    PhaseEvent.PAUSE: Paused,
    PhaseEvent.RESUME: Resumed,
    PhaseEvent.END: EpisodeEnded,
}


def rows(table: Mapping[Any, Mapping[Any, Any]]) -> dict[tuple[Enum, Enum], Enum]:
    return {(state, event): then for state, row in table.items() for event, then in row.items()}


def in_phase(phase: Phase) -> Episode:
    """Return an episode in a phase that it reached by requests."""
    episode = Episode(WORLD, Rules(), 0.0)
    if phase is not Phase.WAITING:
        for player in WORLD.players:
            episode.join(player, player, "human", 0.0)
    if phase is Phase.PAUSED:
        episode.pause(PauseReason.OPERATOR, 1.0)
    if phase is Phase.ENDED:
        episode.abort(1.0, "enough")
    episode.events()
    assert episode.phase is phase
    return episode


def start(episode: Episode) -> None:
    for player in WORLD.players:
        episode.join(player, player, "human", 2.0)


ACTIONS: dict[PhaseEvent, Callable[[Episode], object]] = {
    PhaseEvent.START: start,
    PhaseEvent.PAUSE: lambda episode: episode.pause(PauseReason.STORAGE, 2.0),
    PhaseEvent.RESUME: lambda episode: episode.resume(PauseReason.OPERATOR, 2.0),
    PhaseEvent.END: lambda episode: episode.abort(2.0, "enough"),
}


class TestPhases:
    @pytest.mark.parametrize(("phase", "event"), list(rows(PHASES)))
    def test_episode_reports_every_transition(self, phase: Phase, event: PhaseEvent) -> None:
        episode = in_phase(phase)
        ACTIONS[event](episode)
        assert episode.phase is PHASES[phase][event]
        reported = [type(e) for e in episode.events() if type(e) in EVENTS.values()]
        assert reported == [EVENTS[event]]

    @pytest.mark.parametrize("event", [PhaseEvent.PAUSE, PhaseEvent.RESUME, PhaseEvent.END])
    def test_requests_have_no_effect_after_the_end(self, event: PhaseEvent) -> None:
        episode = in_phase(Phase.ENDED)
        ACTIONS[event](episode)
        assert (episode.phase, episode.events()) == (Phase.ENDED, [])
        with pytest.raises(IllegalEventError):
            episode.restore_ended(Outcome(Reason.GOAL, 1, 1.0, ()))
