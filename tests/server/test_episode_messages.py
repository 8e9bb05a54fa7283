"""Messages about an episode."""

from __future__ import annotations

import pytest

from robotouille import World
from robotouille.episode import (
    ActionRequest,
    Clock,
    Episode,
    PauseReason,
    Phase,
    Rules,
    SeatTreatment,
    Stepped,
)
from robotouille.episode.rules import ShownKind
from robotouille.protocol import messages
from robotouille.protocol.states import StateWriter
from robotouille_server.rooms.episode_messages import EpisodeMessages

WORLD = World("synchronous/01_cheese_sandwich")
(PLAYER,) = WORLD.players


class Played:
    """Episode of one bot at a time that the test sets."""

    def __init__(self, rules: Rules | None = None, treatment: SeatTreatment | None = None) -> None:
        self.now = 0.0
        treatments = {PLAYER: treatment} if treatment is not None else {}
        rules = rules or Rules(clock=Clock.LOCKSTEP)
        self.episode = Episode(WORLD, rules, self.now, treatments=treatments)
        self.made = EpisodeMessages("e-1", self.episode, StateWriter(WORLD), lambda: self.now)

    def step(self, *, waits: bool = False) -> Stepped:
        episode = self.episode
        action = None if waits else episode.state.actions(PLAYER)[0]
        episode.submit(
            PLAYER, ActionRequest(episode.seat(PLAYER).seq + 1, action, waits=waits), self.now
        )
        (stepped,) = [event for event in episode.events() if isinstance(event, Stepped)]
        return stepped


@pytest.mark.parametrize(("shown_as", "told"), [(None, [0]), ("bot", [0]), ("human", None)])
def test_delta_hides_waits_of_disguised_bots(
    shown_as: ShownKind | None, told: list[int] | None
) -> None:
    played = Played(treatment=SeatTreatment(shown_as=shown_as))
    played.episode.join(PLAYER, "Ada", "bot", 0.0)
    assert played.made.delta(played.step(waits=True)).get("waits") == told
    assert "waits" not in played.made.delta(played.step())


def test_delta_is_a_valid_message() -> None:
    played = Played()
    played.episode.join(PLAYER, "Ada", "bot", 0.0)
    stepped = played.step()
    delta = messages.Delta.model_validate(played.made.delta(stepped))
    (move,) = stepped.moves
    assert delta.step == 1
    assert (delta.did, delta.seq) == ([[0, move.action.name, *move.action.arguments]], [1])


def test_pause_has_its_remaining_time() -> None:
    played = Played()
    played.episode.join(PLAYER, "Ada", "bot", 0.0)
    assert played.made.pause is None
    played.episode.pause(PauseReason.OPERATOR, 0.0, until=5.0)
    played.now = 2.0
    assert played.made.pause == messages.Pause(reason="operator", left=3.0)


def test_countdown_has_its_remaining_time() -> None:
    played = Played(Rules(clock=Clock.REALTIME, countdown=3.0))
    assert played.made.starts_in is None
    played.episode.join(PLAYER, "Ada", "human", 0.0)
    played.now = 1.0
    assert played.made.starts_in == 2.0


def test_seats_have_latencies() -> None:
    played = Played()
    (free,) = played.made.seats({})
    assert (free.name, free.present, free.latency_ms) == ("", False, 0)
    played.episode.join(PLAYER, "Ada", "bot", 0.0)
    (taken,) = played.made.seats({PLAYER: 150})
    assert (taken.name, taken.present, taken.latency_ms) == ("Ada", True, 150)


def test_ended_has_outcome_and_hash() -> None:
    played = Played(Rules(clock=Clock.LOCKSTEP, max_steps=1))
    played.episode.join(PLAYER, "Ada", "bot", 0.0)
    played.step()
    assert played.episode.phase is Phase.ENDED
    outcome = played.episode.outcome
    assert outcome is not None
    ended = played.made.ended(outcome)
    assert (ended.step, ended.hash) == (1, played.episode.state.digest)
    assert ended.outcome["reason"] == "step_limit"
