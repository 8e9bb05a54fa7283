"""Who may come and act, and how an episode ends."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import ProtocolError, World, load_task
from robotouille.episode import (
    Absence,
    Clock,
    Ended,
    Episode,
    Phase,
    Reason,
    Rejected,
    Rules,
    Said,
    Started,
    Stepped,
)
from robotouille.episode.presence import LOBBY_SECONDS
from tests.support.episodes import ONE, TWO, first, start, steps
from tests.support.games import play_through, random_choice
from tests.support.thorough import thorough

THREE = World("training/03_multi_agent@3")


class TestSeats:
    def test_begins_when_all_seats_are_taken(self) -> None:
        episode = Episode(TWO, Rules())
        assert episode.join(None, "ada", "human", 0.0) == "robot1"
        assert episode.phase is Phase.WAITING
        assert episode.join(None, "bob", "bot", 1.0) == "robot2"
        assert episode.phase is Phase.RUNNING
        assert any(isinstance(e, Started) for e in episode.events())

    def test_a_taken_seat_names_who_has_it(self) -> None:
        episode = Episode(TWO, Rules())
        episode.join("robot2", "ada", "human", 0.0)
        with pytest.raises(ProtocolError, match="robot2 is played by ada") as error:
            episode.join("robot2", "bob", "human", 0.0)
        assert error.value.code == "seat/taken"

    def test_a_full_episode(self) -> None:
        with pytest.raises(ProtocolError) as error:
            start().join(None, "late", "human", 0.0)
        assert error.value.code == "episode/full"
        assert "come back" not in str(error.value)

    def test_a_full_episode_with_somebody_away(self) -> None:
        episode = start()
        episode.set_present("robot2", False, 1.0)
        with pytest.raises(ProtocolError, match="may still come back to theirs"):
            episode.join(None, "late", "human", 2.0)

    def test_several_seats_are_taken_together(self) -> None:
        episode = Episode(TWO, Rules())
        seats = episode.join_several(["robot2", "robot1"], "ada", "model", 0.0, session="s")
        assert seats == ("robot1", "robot2")
        assert episode.phase is Phase.RUNNING
        kinds = [type(event).__name__ for event in episode.events()]
        assert kinds == ["RosterChanged", "RosterChanged", "Started"]
        assert {seat.session for seat in episode.seats.values()} == {"s"}

    @pytest.mark.parametrize(
        ("wanted", "code"),
        [(["robot1", "robot2"], "seat/taken"), (["robot1", "robot7"], "seat/unknown")],
    )
    def test_all_seats_are_taken_or_none(self, wanted: list[str], code: str) -> None:
        episode = Episode(TWO, Rules())
        episode.join("robot2", "bob", "bot", 0.0)
        episode.events()
        with pytest.raises(ProtocolError) as error:
            episode.join_several(wanted, "ada", "model", 0.0)
        assert error.value.code == code
        assert not episode.seats["robot1"].taken
        assert episode.events() == []

    def test_one_who_plays_all_is_missed_once(self) -> None:
        episode = Episode(TWO, Rules(grace=10.0))
        episode.join_several(episode.free_seats(), "ada", "model", 0.0, session="s")
        episode.set_present(TWO.players, False, 1.0)
        with pytest.raises(ProtocolError, match="taken; ada may still come back"):
            episode.join(None, "late", "human", 2.0)
        episode.tick(60.0)
        assert episode.outcome is not None
        assert episode.outcome.detail == "everybody left"

    def test_an_unknown_seat(self) -> None:
        with pytest.raises(ProtocolError, match="there are robot1, robot2") as error:
            Episode(TWO, Rules()).join("robot7", "ada", "human", 0.0)
        assert error.value.code == "seat/unknown"

    def test_acting_before_the_start_says_for_whom_one_waits(self) -> None:
        episode = Episode(TWO, Rules())
        episode.join(None, "ada", "human", 0.0)
        with pytest.raises(ProtocolError, match="waits for 1 more player") as error:
            episode.submit("robot1", 1, None, 0.0)
        assert error.value.code == "episode/waiting"

    def test_somebody_else_can_take_a_seat_that_was_left(self) -> None:
        episode = start()
        episode.leave("robot1", 1.0)
        assert episode.join(None, "carol", "human", 2.0) == "robot1"
        assert episode.seat("robot1").name == "carol"


class TestActions:
    def test_an_invalid_action_is_rejected_at_once_with_reasons_and_may_be_replaced(self) -> None:
        episode = start()
        bad = TWO.action("place-item", "robot1", "patty1", "table1")
        episode.submit("robot1", 1, bad, 1.0)
        rejected = [e for e in episode.events() if isinstance(e, Rejected)][0]
        assert rejected.seq == 1
        assert any("patty1" in reason for reason in rejected.reasons)
        episode.submit("robot1", 2, first(episode, "robot1"), 1.5)
        episode.submit("robot2", 1, None, 1.6)
        assert episode.step == 1

    def test_another_seats_robot_is_not_yours(self) -> None:
        episode = start()
        episode.submit("robot1", 1, first(episode, "robot2"), 1.0)
        rejected = [e for e in episode.events() if isinstance(e, Rejected)][0]
        assert rejected.reasons == ("robot2 is not yours to move: you play robot1",)

    def test_a_conflict_within_a_step_rejects_the_later_one(self) -> None:
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
            episode.submit(player, 1, here, 1.0)
        stepped = steps(episode)[0]
        assert [attempt.applied for attempt in stepped.attempts] == [True, False]
        assert stepped.attempts[1].unmet

    def test_the_last_word_before_a_step_counts_and_the_former_is_answered(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        moves = [a for a in episode.state.actions("robot1") if a.name == "move"]
        episode.submit("robot1", 1, moves[0], 0.01)
        episode.submit("robot1", 2, moves[1], 0.02)
        episode.tick(0.1)
        events = episode.events()
        assert [e.reasons for e in events if isinstance(e, Rejected)] == [
            ("superseded by action 2",)
        ]
        assert [m.action for e in events if isinstance(e, Stepped) for m in e.moves] == [moves[1]]


class TestSequenceNumbers:
    def test_the_same_again_acts_no_second_time(self) -> None:
        episode = start(ONE)
        episode.submit("robot1", 1, first(episode, "robot1"), 1.0)
        state = episode.state
        episode.submit("robot1", 1, first(episode, "robot1"), 2.0)
        assert (episode.step, episode.state) == (1, state)

    def test_a_rejection_is_kept_for_whoever_asks_again(self) -> None:
        episode = start(ONE)
        bad = ONE.action("place-item", "robot1", "cheese1", "table1")
        for _ in range(2):
            episode.submit("robot1", 1, bad, 1.0)
        (rejected,) = [e for e in episode.events() if isinstance(e, Rejected)]
        assert episode.seat("robot1").answer.reasons == rejected.reasons
        assert episode.seat("robot1").tally.rejected == 1

    def test_a_stale_one_is_refused(self) -> None:
        episode = start(ONE)
        episode.submit("robot1", 5, None, 1.0)
        with pytest.raises(ProtocolError) as error:
            episode.submit("robot1", 4, None, 2.0)
        assert error.value.code == "action/stale"


class TestEnds:
    def test_step_limit(self) -> None:
        episode = start(ONE, max_steps=2)
        for seq in (1, 2):
            episode.submit("robot1", seq, None, float(seq))
        assert episode.outcome is not None
        assert (episode.outcome.reason, episode.outcome.steps) == (Reason.STEP_LIMIT, 2)
        with pytest.raises(ProtocolError) as error:
            episode.submit("robot1", 3, None, 3.0)
        assert error.value.code == "episode/over"

    def test_abandoned_after_the_grace_period(self) -> None:
        episode = start(grace=30.0)
        episode.set_present("robot1", False, 10.0)
        episode.leave("robot2", 20.0)
        assert episode.due() == 50.0
        episode.tick(49.0)
        assert episode.outcome is None
        episode.tick(50.0)
        assert episode.outcome is not None
        assert episode.outcome.reason is Reason.ABANDONED

    def test_time_stands_still_while_nobody_is_there(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10, grace=30)
        for player in TWO.players:
            episode.set_present(player, False, 1.0)
        episode.events()
        episode.tick(20.0)
        assert not steps(episode)
        episode.set_present("robot1", True, 21.0)
        episode.tick(21.1)
        assert len(steps(episode)) == 1

    def test_nobody_ever_came(self) -> None:
        episode = Episode(TWO, Rules(grace=1), now=5.0)
        assert episode.due() == 5.0 + LOBBY_SECONDS
        episode.tick(5.0 + LOBBY_SECONDS)
        assert episode.phase is Phase.ENDED
        assert episode.outcome is not None
        assert episode.outcome.seconds == 0.0

    def test_aborted_from_outside(self) -> None:
        episode = start()
        episode.abort(3.0, "closing time")
        ended = [e for e in episode.events() if isinstance(e, Ended)]
        assert (ended[0].outcome.reason, ended[0].outcome.detail) == (
            Reason.ABORTED,
            "closing time",
        )
        episode.abort(4.0, "again")
        assert episode.events() == []

    def test_tallies_add_up(self) -> None:
        episode, _ = play_through("multi_agent/04@3", Rules(max_steps=80), random_choice(4))
        assert episode.outcome is not None
        for tally in episode.outcome.seats:
            assert tally.steps == 80
            assert tally.acted > 0
        assert [t.player for t in episode.outcome.seats] == list(episode.world.players)


def test_chat_reaches_everybody_and_is_counted() -> None:
    episode = start()
    episode.say("ada", "robot1", "I take the patty", 1.0)
    assert [e.text for e in episode.events() if isinstance(e, Said)] == ["I take the patty"]
    assert episode.seat("robot1").tally.said == 1


def test_busy_players_need_not_decide() -> None:
    world = World(load_task("multi_agent/01", timing="people"))
    episode = start(world)
    far = max(
        (a for a in episode.state.actions("robot1") if a.name == "move"), key=lambda a: a.duration
    )
    assert far.duration > 2
    episode.submit("robot1", 1, far, 1.0)
    episode.submit("robot2", 1, None, 1.0)
    assert episode.state.busy_steps("robot1") == far.duration - 1
    episode.submit("robot2", 2, None, 1.0)
    assert episode.step == 2
    episode.submit(
        "robot1", 2, first(episode, "robot1") if episode.state.actions("robot1") else far, 1.0
    )
    reasons = [e.reasons for e in episode.events() if isinstance(e, Rejected)]
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
def test_no_sequence_of_inputs_breaks_an_episode(inputs: list[tuple], clock: Clock) -> None:  # type: ignore[type-arg]
    """Errors are ProtocolErrors, steps have no gaps, and what is over stays over."""
    episode = Episode(TWO, Rules(clock=clock, max_steps=15, move_budget=1.0, grace=2.0))
    now, seen, over = 0.0, 0, False
    for kind, *arguments in inputs:
        try:
            if kind == "submit":
                player, seq, index = arguments
                options = [*episode.state.actions(player), None]
                episode.submit(player, seq, options[index % len(options)], now)
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
            over = over or isinstance(event, Ended)
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
def test_the_seats_of_one_participant_never_come_apart(
    inputs: list[tuple[str, Any, Any]], clock: Clock, absence: Absence
) -> None:
    """Whoever comes gets all seats that are asked for or none, and loses them together."""
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
                episode.submit(who, what, None, now)
        elif kind == "tick":
            now += what
            episode.tick(now)
        for session, players in own.items():
            seats = [episode.seat(player) for player in players]
            held = [seat for seat in seats if seat.session == session]
            assert held in ([], seats)
            told = {(s.name, s.present, s.generation, s.away, s.controller) for s in held}
            assert len(told) <= 1
        own = {who: held for who, held in own.items() if episode.seat(held[0]).session == who}
