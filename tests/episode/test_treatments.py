"""Treatments (delays and shown kinds), restricted chat, and reserved episodes."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError, UnknownNameError
from robotouille.episode import (
    ActionRejected,
    ActionRequest,
    Chat,
    Clock,
    Controller,
    Episode,
    Reason,
    Rules,
    SeatTreatment,
)
from robotouille.episode.rules import ShownKind
from robotouille.episode.submissions import MAX_HELD_REQUESTS
from robotouille.world import world
from tests.support.episodes import TWO, outcome, steps

SLOW = {"robot2": SeatTreatment(delay_ms=250, shown_as="human")}


def began(clock: Clock, **rules: object) -> Episode:
    episode = Episode(TWO, Rules(clock=clock, step_rate=10.0, **rules), treatments=SLOW)  # type: ignore[arg-type]
    for player in TWO.players:
        episode.join(player, player, "bot", 0.0, session=player)
    episode.events()
    return episode


def act(episode: Episode, player: str, seq: int, now: float) -> str:
    action = episode.state.actions(player)[0]
    episode.submit(player, ActionRequest(seq, action), now)
    return action.sentence


def test_delayed_action_counts_in_a_later_step_in_real_time() -> None:
    episode = began(Clock.REALTIME)
    episode.submit("robot1", ActionRequest(1), 0.05)
    act(episode, "robot2", 1, 0.05)
    episode.tick(0.5)
    taken = steps(episode)
    assert [step.step for step in taken if step.idle] == [1]
    assert [step.step for step in taken if step.moves] == [3]  # It counts from 0.3 s on.


def test_late_tick_does_not_shorten_the_delay() -> None:
    on_time, late = began(Clock.REALTIME), began(Clock.REALTIME)
    for episode in (on_time, late):
        act(episode, "robot2", 1, 0.0)
    for tenth in range(1, 8):
        on_time.tick(tenth / 10)
    late.tick(0.7)
    assert on_time.state == late.state


def test_lockstep_waits_for_a_delayed_action() -> None:
    episode = began(Clock.LOCKSTEP)
    act(episode, "robot1", 1, 1.0)
    act(episode, "robot2", 1, 1.0)
    assert episode.step == 0
    assert episode.waits_for == ("robot2",)
    assert episode.due() == 1.25
    episode.tick(1.25)
    assert episode.step == 1


def test_delayed_action_is_checked_after_the_delay() -> None:
    episode = began(Clock.LOCKSTEP)
    for _ in range(2):
        episode.submit("robot2", ActionRequest(1, "dance"), 0.0)
    assert not episode.events()
    episode.tick(0.25)
    (rejected,) = (event for event in episode.events() if isinstance(event, ActionRejected))
    assert rejected.code == "action/unknown"
    assert episode.due() is None


def test_wrong_text_of_a_delayed_seat_is_compared_when_it_arrives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All delayed texts may be due at once, and each comparison takes a millisecond."""
    compared: list[str] = []

    def noted(sentence: str, *rest: object) -> UnknownNameError:
        compared.append(sentence)
        return UnknownNameError(f"no valid action {sentence!r}")

    monkeypatch.setattr(world, "no_valid_action", noted)
    episode = began(Clock.LOCKSTEP)
    episode.submit("robot2", ActionRequest(1, "dance"), 0.0)
    assert compared == ["dance"]
    episode.tick(0.25)
    (rejected,) = (event for event in episode.events() if isinstance(event, ActionRejected))
    assert rejected.reasons == ("no valid action 'dance'",)
    assert compared == ["dance"]


def test_delayed_text_is_read_in_the_state_after_the_delay() -> None:
    now_valid, late = began(Clock.REALTIME), began(Clock.REALTIME)
    sentence = now_valid.state.actions("robot2")[0].sentence
    for episode in (now_valid, late):
        episode.submit("robot2", ActionRequest(1, sentence), 0.0)
    now_valid.tick(0.5)
    assert [move.action.sentence for step in steps(now_valid) for move in step.moves] == [sentence]
    late.submit("robot2", ActionRequest(2, sentence), 0.3)
    late.tick(1.0)
    (rejected,) = (event for event in late.events() if isinstance(event, ActionRejected))
    assert (rejected.seq, rejected.code) == (2, "action/invalid")


def test_few_actions_of_a_seat_wait_for_its_delay() -> None:
    episode = began(Clock.LOCKSTEP)
    for seq in range(1, MAX_HELD_REQUESTS + 1):
        episode.submit("robot2", ActionRequest(seq), 0.0)
    with pytest.raises(ProtocolError) as refused:
        episode.submit("robot2", ActionRequest(MAX_HELD_REQUESTS + 1), 0.1)
    assert refused.value.code == "rate/limited"
    episode.submit("robot1", ActionRequest(1), 0.1)
    episode.tick(0.25)
    assert episode.step == 1
    episode.submit("robot2", ActionRequest(MAX_HELD_REQUESTS + 1), 0.3)


def test_departure_drops_delayed_actions() -> None:
    episode = began(Clock.LOCKSTEP)
    act(episode, "robot2", 1, 0.0)
    episode.leave("robot2", 0.1)
    episode.join("robot2", "carol", "human", 0.2, session="carol")
    episode.tick(0.3)
    assert episode.seat("robot2").pending is None


@pytest.mark.parametrize("kind", ["human", "bot", "model"])
@pytest.mark.parametrize(("shown_as", "starts_at"), [("human", 3.0), ("bot", None)])
def test_countdown_does_not_reveal_the_real_kind(
    kind: str, shown_as: ShownKind, starts_at: float | None
) -> None:
    rules = Rules(clock=Clock.REALTIME, step_rate=10.0, countdown=3.0)
    treatments = {"robot2": SeatTreatment(shown_as=shown_as)}
    episode = Episode(TWO, rules, treatments=treatments)
    episode.join("robot1", "ada", "bot", 0.0, session="ada")
    episode.join("robot2", "bob", kind, 0.0, session="bob")
    assert episode.starts_at == starts_at


def test_others_see_the_kind_of_the_treatment() -> None:
    episode = began(Clock.LOCKSTEP)
    one, two = episode.seats.values()
    assert (one.shown_kind, one.shown_controller) == ("bot", Controller.BOT)
    assert (two.kind, two.controller) == ("bot", Controller.BOT)
    assert (two.shown_kind, two.shown_controller) == ("human", Controller.HUMAN)
    episode.set_present("robot2", False, 1.0)
    assert two.shown_controller is Controller.ABSENT
    episode.leave("robot2", 2.0)
    assert (two.shown_kind, two.shown_controller) == ("", Controller.FREE)


@pytest.mark.parametrize(
    ("chat", "phrases", "text", "code"),
    [
        (Chat.OFF, (), "hello", "chat/off"),
        (Chat.PHRASES, ("Yes", "No"), "yes", "chat/phrase"),
        (Chat.PHRASES, ("Yes", "No"), "Yes", ""),
        (Chat.FREE, (), "hello", ""),
    ],
)
def test_permitted_chat(chat: Chat, phrases: tuple[str, ...], text: str, code: str) -> None:
    episode = began(Clock.LOCKSTEP, chat=chat, phrases=phrases)
    for player in ("robot1", ""):
        if code:
            with pytest.raises(ProtocolError) as refused:
                episode.say("ada", player, text, 1.0)
            assert refused.value.code == code
        else:
            episode.say("ada", player, text, 1.0)
    assert episode.record.said == (0 if code else 2)


def test_unused_episode_closes_after_open_for() -> None:
    episode = Episode(TWO, Rules(open_for=90_000.0), 5.0)
    assert episode.due() == 90_005.0
    episode.tick(90_004.9)
    assert not episode.ended
    episode.tick(90_005.0)
    assert outcome(episode) == (Reason.ABANDONED, "nobody came")


def test_used_episode_waits_for_the_usual_time() -> None:
    episode = Episode(TWO, Rules(open_for=60.0))
    episode.join("robot1", "ada", "human", 50.0, session="a")
    episode.tick(70.0)
    episode.leave("robot1", 100.0)
    assert episode.due() == 700.0


def test_default_rules_are_omitted() -> None:
    assert not {"open_for", "chat", "phrases"} & set(Rules().model_dump(mode="json"))
    rules = Rules(open_for=60.0, chat=Chat.PHRASES, phrases=("Yes",))
    assert Rules.model_validate(rules.model_dump(mode="json")) == rules
