"""Episodes: seats, actions, sequence numbers and ends."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import ProtocolError, World, load_task
from robotouille.episode import (
    Absence,
    ActionRejected,
    ActionRequest,
    Clock,
    Episode,
    EpisodeEnded,
    Phase,
    Reason,
    Rules,
    Started,
    Stepped,
)
from robotouille.episode.presence import LOBBY_SECONDS
from tests.support.episodes import ONE, TWO, first, start, steps
from tests.support.thorough import thorough

THREE = World("training/03_multi_agent@3")


class TestSeats:
    def test_game_starts_when_all_seats_are_taken(self) -> None:
        episode = Episode(TWO, Rules())
        assert episode.join(None, "ada", "human", 0.0) == "robot1"
        assert episode.phase is Phase.WAITING
        assert episode.join(None, "bob", "bot", 1.0) == "robot2"
        assert episode.phase is Phase.RUNNING
        assert any(isinstance(e, Started) for e in episode.events())

    def test_taken_seat_is_refused_with_the_name_of_its_participant(self) -> None:
        episode = Episode(TWO, Rules())
        episode.join("robot2", "ada", "human", 0.0)
        with pytest.raises(ProtocolError, match="robot2 is played by ada") as error:
            episode.join("robot2", "bob", "human", 0.0)
        assert error.value.code == "seat/taken"

    def test_full_episode(self) -> None:
        with pytest.raises(ProtocolError) as error:
            start().join(None, "late", "human", 0.0)
        assert error.value.code == "episode/full"
        assert "come back" not in str(error.value)

    def test_several_seats_are_taken_together(self) -> None:
        episode = Episode(TWO, Rules())
        seats = episode.join_several(["robot2", "robot1"], "ada", "model", 0.0, session="s")
        assert seats == ("robot1", "robot2")
        assert episode.phase is Phase.RUNNING
        kinds = [type(event).__name__ for event in episode.events()]
        assert kinds == ["SeatChanged", "SeatChanged", "Started"]
        assert {seat.session for seat in episode.seats.values()} == {"s"}

    @pytest.mark.parametrize(
        ("wanted", "code"),
        [(["robot1", "robot2"], "seat/taken"), (["robot1", "robot7"], "seat/unknown")],
    )
    def test_all_requested_seats_are_taken_or_none(self, wanted: list[str], code: str) -> None:
        episode = Episode(TWO, Rules())
        episode.join("robot2", "bob", "bot", 0.0)
        episode.events()
        with pytest.raises(ProtocolError) as error:
            episode.join_several(wanted, "ada", "model", 0.0)
        assert error.value.code == code
        assert not episode.seats["robot1"].taken
        assert episode.events() == []

    def test_absent_participant_with_several_seats_is_named_once(self) -> None:
        episode = Episode(TWO, Rules(grace=10.0))
        episode.join_several(episode.record.free_seats(), "ada", "model", 0.0, session="s")
        episode.set_present(TWO.players, False, 1.0)
        with pytest.raises(ProtocolError, match="taken; ada may still come back"):
            episode.join(None, "late", "human", 2.0)
        episode.tick(60.0)
        assert episode.outcome is not None
        assert episode.outcome.detail == "everybody left"

    def test_unknown_seat(self) -> None:
        with pytest.raises(ProtocolError, match="there are robot1, robot2") as error:
            Episode(TWO, Rules()).join("robot7", "ada", "human", 0.0)
        assert error.value.code == "seat/unknown"

    def test_action_before_the_start_is_refused_with_the_missing_players(self) -> None:
        episode = Episode(TWO, Rules())
        episode.join(None, "ada", "human", 0.0)
        with pytest.raises(ProtocolError, match="waits for 1 more player") as error:
            episode.submit("robot1", ActionRequest(1), 0.0)
        assert error.value.code == "episode/waiting"

    def test_left_seat_can_be_taken(self) -> None:
        episode = start(ONE)
        episode.submit("robot1", ActionRequest(7), 0.5)
        episode.leave("robot1", 1.0)
        assert episode.join(None, "carol", "human", 2.0) == "robot1"
        assert episode.seat("robot1").name == "carol"
        episode.submit("robot1", ActionRequest(1), 3.0)  # Carol counts from 1.
        assert episode.step == 2


class TestActions:
    def test_action_of_another_player_is_rejected(self) -> None:
        episode = start()
        episode.submit("robot1", ActionRequest(1, first(episode, "robot2")), 1.0)
        rejected = [e for e in episode.events() if isinstance(e, ActionRejected)][0]
        assert rejected.reasons == ("robot2 is not yours to move: you play robot1",)

    def test_conflict_in_a_step_rejects_the_later_action(self) -> None:
        episode = start()
        common = set.intersection(
            *(
                {a.arguments[2] for a in episode.state.actions(p) if a.name == "move"}
                for p in TWO.players
            )
        )
        place = sorted(common)[0]
        for player in TWO.players:
            here = next(a for a in episode.state.actions(player) if a.arguments[-1] == place)
            episode.submit(player, ActionRequest(1, here), 1.0)
        stepped = steps(episode)[0]
        assert [attempt.applied for attempt in stepped.attempts] == [True, False]
        assert stepped.attempts[1].unmet

    def test_later_action_supersedes_the_pending_one(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        moves = [a for a in episode.state.actions("robot1") if a.name == "move"]
        episode.submit("robot1", ActionRequest(1, moves[0]), 0.01)
        episode.submit("robot1", ActionRequest(2, moves[1]), 0.02)
        episode.tick(0.1)
        events = episode.events()
        assert [e.reasons for e in events if isinstance(e, ActionRejected)] == [
            ("superseded by action 2",)
        ]
        assert [m.action for e in events if isinstance(e, Stepped) for m in e.moves] == [moves[1]]
        tally = episode.seat("robot1").tally
        assert (tally.rejected, tally.invalid, tally.malformed) == (1, 0, 0)


class TestSequenceNumbers:
    def test_repeated_number_acts_once(self) -> None:
        episode = start(ONE)
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 1.0)
        state = episode.state
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 2.0)
        assert (episode.step, episode.state) == (1, state)


class TestEnds:
    def test_step_limit(self) -> None:
        episode = start(ONE, max_steps=2)
        for seq in (1, 2):
            episode.submit("robot1", ActionRequest(seq), float(seq))
        assert episode.outcome is not None
        assert (episode.outcome.reason, episode.outcome.steps) == (Reason.STEP_LIMIT, 2)
        with pytest.raises(ProtocolError) as error:
            episode.submit("robot1", ActionRequest(3), 3.0)
        assert error.value.code == "episode/ended"

    def test_episode_without_participants_ends(self) -> None:
        episode = Episode(TWO, Rules(grace=1), now=5.0)
        assert episode.due() == 5.0 + LOBBY_SECONDS
        episode.tick(5.0 + LOBBY_SECONDS)
        assert episode.phase is Phase.ENDED
        assert episode.outcome is not None
        assert episode.outcome.seconds == 0.0

    def test_abort(self) -> None:
        episode = start()
        episode.abort(3.0, "closing time")
        ended = [e for e in episode.events() if isinstance(e, EpisodeEnded)]
        assert (ended[0].outcome.reason, ended[0].outcome.detail) == (
            Reason.ABORTED,
            "closing time",
        )
        episode.abort(4.0, "again")
        assert episode.events() == []


def test_busy_players_are_not_awaited() -> None:
    world = World(load_task("multi_agent/01", timing="people"))
    episode = start(world)
    far = max(
        (a for a in episode.state.actions("robot1") if a.name == "move"), key=lambda a: a.duration
    )
    assert far.duration > 2
    episode.submit("robot1", ActionRequest(1, far), 1.0)
    episode.submit("robot2", ActionRequest(1), 1.0)
    assert episode.state.busy_steps("robot1") == far.duration - 1
    episode.submit("robot2", ActionRequest(2), 1.0)
    assert episode.step == 2
    episode.submit(
        "robot1",
        ActionRequest(2, first(episode, "robot1") if episode.state.actions("robot1") else far),
        1.0,
    )
    reasons = [e.reasons for e in episode.events() if isinstance(e, ActionRejected)]
    assert "busy" in reasons[0][0]


@thorough(60)
@given(
    st.lists(
        st.one_of(
            st.tuples(
                st.just("submit"),
                st.sampled_from(TWO.players),
                st.integers(0, 6),
                st.integers(0, 40),
            ),
            st.tuples(st.just("presence"), st.sampled_from(TWO.players), st.booleans()),
            st.tuples(st.just("leave"), st.sampled_from(TWO.players)),
            st.tuples(st.just("join"), st.sampled_from(TWO.players)),
            st.tuples(st.just("tick"), st.floats(0, 3)),
            st.tuples(st.just("say")),
        ),
        max_size=40,
    ),
    st.sampled_from(list(Clock)),
)
def test_random_inputs_keep_the_invariants(inputs: list[tuple], clock: Clock) -> None:  # type: ignore[type-arg]
    """Errors are ProtocolErrors, steps have no gaps, and an ended episode stays ended."""
    episode = Episode(TWO, Rules(clock=clock, max_steps=15, move_budget=1.0, grace=2.0))
    now, seen, over = 0.0, 0, False
    for kind, *arguments in inputs:
        try:
            if kind == "submit":
                player, seq, index = arguments
                options = [*episode.state.actions(player), None]
                episode.submit(player, ActionRequest(seq, options[index % len(options)]), now)
            elif kind == "presence":
                episode.set_present(*arguments, now)
            elif kind == "leave":
                episode.leave(arguments[0], now)
            elif kind == "join":
                episode.join(arguments[0], "x", "bot", now)
            elif kind == "say":
                episode.say("x", "robot1", "hello", now)
            else:
                now += arguments[0]
                episode.tick(now)
        except ProtocolError as error:
            assert "/" in error.code
        for event in episode.events():
            if isinstance(event, Stepped):
                assert not over
                assert event.step == seen + 1
                assert event.before != event.state or event.before == event.state
                seen = event.step
            over = over or isinstance(event, EpisodeEnded)
    assert episode.step == seen <= 15
    due = episode.due()
    assert over == (episode.phase is Phase.ENDED)
    assert due is None or not over


SUBSETS = st.lists(st.sampled_from([*THREE.players, "robot9"]), min_size=1, max_size=4)


@thorough(60)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("join"), st.sampled_from("abc"), SUBSETS),
            st.tuples(st.just("presence"), st.sampled_from("abc"), st.booleans()),
            st.tuples(st.just("leave"), st.sampled_from("abc"), st.none()),
            st.tuples(st.just("submit"), st.sampled_from(THREE.players), st.integers(1, 9)),
            st.tuples(st.just("tick"), st.none(), st.floats(0, 3)),
        ),
        max_size=40,
    ),
    st.sampled_from(list(Clock)),
    st.sampled_from(list(Absence)),
)
def test_seats_of_one_participant_stay_together(
    inputs: list[tuple[str, Any, Any]], clock: Clock, absence: Absence
) -> None:
    """A participant gets all requested seats or none, and loses them together."""
    rules = Rules(clock=clock, absence=absence, max_steps=15, move_budget=1.0, grace=2.0)
    episode = Episode(THREE, rules)
    now, own = 0.0, dict[str, tuple[str, ...]]()
    for kind, who, what in inputs:
        taken = {seat.player for seat in episode.seats.values() if seat.taken}
        if kind == "join" and not own.get(who):
            try:
                own[who] = episode.join_several(what, who, "bot", now, session=who)
                assert taken.isdisjoint(own[who])
                assert own[who] == tuple(p for p in THREE.players if p in what)
            except ProtocolError:
                assert taken == {seat.player for seat in episode.seats.values() if seat.taken}
        elif kind == "presence":
            episode.set_present(own.get(who, ()), what, now, generation=1)
        elif kind == "leave":
            episode.leave(own.get(who, ()), now)
        elif kind == "submit":
            with suppress(ProtocolError):
                episode.submit(who, ActionRequest(what), now)
        elif kind == "tick":
            now += what
            episode.tick(now)
        for session, players in own.items():
            seats = [episode.seat(player) for player in players]
            held = [seat for seat in seats if seat.session == session]
            assert held in ([], seats)
            received = {(s.name, s.present, s.generation, s.away, s.controller) for s in held}
            assert len(received) <= 1
        own = {who: held for who, held in own.items() if episode.seat(held[0]).session == who}
