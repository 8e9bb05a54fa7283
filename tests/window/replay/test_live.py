"""What somebody keeps of a game that they are in: bounded, and with what was refused to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from robotouille import World
from robotouille.domain.rendering import Language
from robotouille.episode.tallies import Activity
from robotouille.planning.policies.team_talk import announcement
from robotouille.protocol.message_parts import SeatInfo
from robotouille.world.unmet import only_words
from robotouille.world.world import State
from robotouille_client.sansio.game_events import Announced, Changed, Heard, Refused
from robotouille_client.window.replay.history import live
from robotouille_client.window.replay.history.history import EntryKind
from robotouille_client.window.replay.history.live import LiveHistory


@dataclass
class Game:
    """What a history asks a game for."""

    world: World
    seats: tuple[SeatInfo, ...] = ()
    step: int = 0
    turn: str | None = None
    outcome: dict[str, Any] | None = None

    @property
    def state(self) -> State:
        return self.world.initial

    @property
    def clock(self) -> dict[str, Any]:
        return {"clock": "realtime", "step_rate": 4.0, "max_steps": 90}


@pytest.fixture
def history() -> LiveHistory:
    world = World("synchronous/01")
    seat = SeatInfo(player=world.players[0], name="ada", kind="human", controller="human")
    return LiveHistory(Game(world, (seat,)), lambda: 0.0)  # type: ignore[arg-type]


def take(history: LiveHistory, steps: int) -> list[State]:
    """Walk to and fro."""
    states = [history.state(history.length)]
    player = history.world.players[0]
    for _ in range(steps):
        action = next(a for a in states[-1].actions(player) if a.name == "move")
        states.append(states[-1].step(action).state)
        did = ((player, action, True),)
        history.observe(Changed(history.length + 1, states[-1], states[-2], did))
    return states


def test_of_a_long_game_the_beginning_is_forgotten(
    history: LiveHistory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MAX_STATES", 20)
    monkeypatch.setattr(live, "_FORGOTTEN_AT_ONCE", 5)
    states = take(history, 63)
    assert len(history._states) <= 25
    assert history.first > 30
    assert history.length == 63
    for step in range(history.first, 64):
        assert history.state(step) == states[step]
        assert history.entries(step)
    assert history.state(0) == history.state(history.first)
    assert not history.entries(3)


def test_who_said_that_they_wait_does_not_idle(history: LiveHistory) -> None:
    (player,) = history.world.players
    state = history.world.initial
    for waits in ((player,), ()):
        history.observe(Changed(history.length + 1, state, state, (), waits=waits))
    assert [history.activity(player, step) for step in (1, 2)] == [Activity.WAITING, Activity.IDLE]


def test_what_was_refused_to_oneself_is_kept_with_why(history: LiveHistory) -> None:
    world = history.world
    player = world.players[0]
    take(history, 2)
    far = next(a for a in world.initial.actions(player) if a.name == "move")
    unmet = only_words("the table is not free")
    history.observe(Refused(3, 2, str(far), unmet, "action/invalid", player))
    (entry,) = [e for e in history.entries(2) if e.kind is EntryKind.REJECTED]
    assert entry.player == player
    assert entry.reasons == ("the table is not free",)
    assert history.marks[-1].kind is EntryKind.REJECTED


def test_what_bots_only_say_to_one_another_is_not_shown(history: LiveHistory) -> None:
    marks = len(history.marks)
    history.observe(Heard("bob", "robot2", announcement()))
    assert len(history.marks) == marks
    assert history.chat(history.length, 6) == ()


def test_what_the_operator_says_is_told_again(history: LiveHistory) -> None:
    take(history, 4)
    history.observe(Announced("lunch"))
    assert history.interludes == [(4, "The operator: lunch", True)]
    assert history.max_steps == 90


def test_the_log_is_in_the_words_of_the_windows_owner(history: LiveHistory) -> None:
    kind = history.world.thing("table1").kind
    language = Language.model_validate({"kinds": {kind: "Tisch"}})
    own = LiveHistory(history._game, lambda: 0.0, language)
    take(own, 2)
    assert "Tisch" in str(own.entries(2))
