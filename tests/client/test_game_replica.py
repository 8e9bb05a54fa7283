"""Replica of a game: snapshots, deltas, actions, rosters and several seats."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille import GroundAction, ProtocolError, World
from robotouille.episode.lifecycle import Controller
from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille.world.unmet import Unmet, UnmetKind, only_words
from robotouille_client.sansio import event_queue
from robotouille_client.sansio.game_events import (
    ActRejected,
    ActResult,
    Announced,
    ChatReceived,
    GameEnded,
    GameEvent,
    ObservationReceived,
    RosterChanged,
    StateChanged,
    TakenStep,
)
from robotouille_client.sansio.game_replica import GameReplica
from tests.support.scripted_server import ScriptedServer


@pytest.fixture
def server() -> ScriptedServer:
    return ScriptedServer()


@pytest.fixture
def game(server: ScriptedServer) -> GameReplica:
    """Return a game with its first snapshot."""
    game = GameReplica(server.joined())
    game.receive(server.snapshot(), 0.0)
    game.poll()
    return game


def first_action(game: GameReplica) -> GroundAction:
    return game.actions[0]


def rejected(step: int, reason: str, code: str) -> ActResult:
    return ActResult(False, step, only_words(reason), code)


def test_no_state_before_the_first_snapshot(server: ScriptedServer) -> None:
    game = GameReplica(server.joined())
    assert (game.has_state, game.synced, game.seen) == (False, False, None)
    with pytest.raises(RuntimeError, match="no state"):
        _ = game.state
    game.receive(server.delta(), 0.0)
    assert game.step == 0


def test_delta_lists_waiting_players(server: ScriptedServer, game: GameReplica) -> None:
    one, other = game.world.players
    game.receive(server.delta().model_copy(update={"waits": [1]}), 1.0)
    (changed,) = game.poll()
    assert isinstance(changed, StateChanged)
    assert changed.waits == (other,)
    with pytest.raises(ProtocolError, match="unknown player"):
        game.receive(server.delta().model_copy(update={"waits": [7]}), 1.0)
    assert one not in changed.waits


def test_missing_delta_triggers_a_resync(server: ScriptedServer, game: GameReplica) -> None:
    server.delta([first_action(game)])
    game.receive(server.delta(), 0.0)
    assert game.messages_to_send() == [messages.Resync()]
    for _ in range(19):
        game.receive(server.delta(), 0.0)
    assert game.messages_to_send() == []
    game.receive(server.delta(), 0.0)
    assert game.messages_to_send() == [messages.Resync()], "the request may have been lost"
    assert game.seen == messages.Seen(episode="e1", step=0, stale=True)
    game.receive(server.snapshot(), 0.0)
    assert (game.step, game.state) == (server.step, server.state)


def test_wrong_hash_triggers_a_resync(server: ScriptedServer, game: GameReplica) -> None:
    wrong = server.delta([first_action(game)]).model_copy(update={"hash": "0" * 16})
    game.receive(wrong, 0.0)
    assert game.messages_to_send() == [messages.Resync()]


def test_action_is_answered_by_its_step(server: ScriptedServer, game: GameReplica) -> None:
    seq = game.propose(first_action(game), 0.0, think_ms=5)
    (act,) = game.messages_to_send()
    assert isinstance(act, messages.Act)
    assert (act.seq, act.basis, act.think_ms) == (seq, 0, 5)
    assert game.unanswered == (act,)
    game.receive(server.delta([first_action(game)], seq=[seq]), 0.0)
    assert game.results() == [(seq, ActResult(True, 1, age=0))]
    assert (game.unanswered, game.get_timer()) == ((), None)


def test_idle_decision_is_answered_by_the_next_step(
    server: ScriptedServer, game: GameReplica
) -> None:
    seq = game.propose(None, 0.0)
    game.receive(server.delta(), 0.0)
    assert game.results() == [(seq, ActResult(True, 1, age=0))]


def test_rejection_has_reasons(game: GameReplica) -> None:
    seq = game.propose("Boil the sea", 0.0)
    game.receive(
        messages.Rejected(seq=seq, step=0, action="?", reasons=["no"], code="action/unknown"), 0.0
    )
    unknown = only_words("no", kind=UnmetKind.UNKNOWN)
    assert game.results() == [(seq, ActResult(False, 0, unknown, "action/unknown", age=0))]


def test_age_is_counted_from_the_basis(server: ScriptedServer, game: GameReplica) -> None:
    game.receive(server.delta(), 0.0)
    game.receive(server.delta(), 0.0)
    seq = game.propose(first_action(game), 0.0, basis=1, max_age=1)
    (act,) = game.messages_to_send()
    assert isinstance(act, messages.Act)
    assert (act.basis, act.max_age) == (1, 1)
    game.receive(server.delta([first_action(game)], seq=[seq]), 0.0)
    assert game.results() == [(seq, ActResult(True, 3, age=1))]


def test_stale_action_has_a_kind_and_an_age(server: ScriptedServer, game: GameReplica) -> None:
    game.receive(server.delta(), 0.0)
    game.receive(server.delta(), 0.0)
    seq = game.propose(None, 0.0, basis=0, max_age=1)
    stale = messages.Rejected(seq=seq, step=2, action="x", reasons=["old"], code="action/stale")
    game.receive(stale, 0.0)
    ((_, result),) = game.results()
    assert (result.applied, result.age, result.code) == (False, 2, "action/stale")
    assert [unmet.kind for unmet in result.unmet] == [UnmetKind.STALE]


def test_later_action_supersedes_earlier_ones(server: ScriptedServer, game: GameReplica) -> None:
    first, second = game.propose(None, 0.0), game.propose(first_action(game), 0.0)
    reason = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {second}")
    superseded = ActResult(False, 1, (reason,), "action/invalid")
    game.receive(server.delta([first_action(game)], seq=[second]), 0.0)
    assert game.results() == [(first, superseded), (second, ActResult(True, 1, age=0))]


def test_snapshot_answers_the_last_action(server: ScriptedServer, game: GameReplica) -> None:
    seq = game.propose(first_action(game), 0.0)
    server.delta()
    game.receive(server.snapshot(last_seq=seq, last_step=1, last_reasons=["too late"]), 0.0)
    assert game.results() == [(seq, rejected(1, "too late", "action/invalid"))]


def test_unanswered_action_is_sent_again(game: GameReplica) -> None:
    game.propose(None, 1.0)
    (act,) = game.messages_to_send()
    assert game.get_timer() == 6.0
    game.handle_timer(5.9)
    assert game.messages_to_send() == []
    game.handle_timer(6.0)
    assert (game.messages_to_send(), game.get_timer()) == ([act], 11.0)


def test_rate_limited_action_is_repeated_after_a_moment(game: GameReplica) -> None:
    seq = game.propose(None, 1.0)
    (act,) = game.messages_to_send()
    limited = messages.Rejected(seq=seq, step=0, action="", reasons=[], code="rate/limited")
    game.receive(limited, 2.0)
    assert (game.results(), game.get_timer()) == ([], 2.25)
    game.handle_timer(2.25)
    assert game.messages_to_send() == [act]


def test_retaken_seat_loses_its_pending_action(server: ScriptedServer, game: GameReplica) -> None:
    seq = game.propose(None, 0.0)
    game.messages_to_send()
    game.rejoined(server.joined(1, seq=40), 1.0, new_session=True)
    ((lost, result),) = game.results()
    assert (lost, result.code) == (seq, "seat/lost")
    assert game.messages_to_send() == []
    assert game.propose(None, 1.0) == 41


def test_spectators_cannot_act(server: ScriptedServer) -> None:
    game = GameReplica(server.joined(seat=None, role="spectator"))
    with pytest.raises(ProtocolError, match="spectators cannot act"):
        game.propose(None, 0.0)


def test_end_of_the_episode_decides_pending_actions(game: GameReplica) -> None:
    seq = game.propose(None, 0.0)
    outcome = {"reason": "goal", "steps": 3}
    game.receive(messages.Ended(step=3, outcome=outcome, hash="x"), 0.0)
    assert (game.finished, game.ended, game.my_move) == (True, True, False)
    assert [(s, r.code) for s, r in game.results()] == [(seq, "episode/ended")]
    assert game.poll() == [GameEnded(outcome, "goal")]
    later = game.propose(None, 0.0)
    assert [(s, r.code) for s, r in game.results()] == [(later, "episode/ended")]
    game.receive(messages.Left(episode="e1", reason="late"), 0.0)
    assert game.poll() == []


def test_repeated_chat_message_is_one_event(game: GameReplica) -> None:
    said = messages.Said(step=0, number=1, name="bob", seat="robot2", text="hi")
    game.receive(said, 0.0)
    game.receive(said, 0.0)
    game.receive(messages.Notice(text="dinner"), 0.0)
    assert game.poll() == [ChatReceived("bob", "robot2", "hi"), Announced("dinner")]
    game.say("hello")
    assert game.messages_to_send() == [messages.Say(text="hello")]


def test_roster_updates_the_spectators(game: GameReplica) -> None:
    roster = messages.Roster(phase="running", seats=[], spectators=9, spectator_names=["eva"])
    game.receive(roster, 0.0)
    assert (game.spectators, game.spectator_names) == (9, ("eva",))
    game.receive(messages.Roster(phase="running", seats=[], spectators=1), 0.0)
    assert (game.spectators, game.spectator_names) == (1, ()), "an older server names nobody"


def test_only_the_first_spectator_names_are_kept(server: ScriptedServer) -> None:
    names = [f"eva {number}" for number in range(1000)]
    game = GameReplica(server.joined())
    game.receive(server.snapshot().model_copy(update={"spectator_names": names}), 0.0)
    assert game.spectator_names == tuple(names[:8])
    game.receive(messages.Roster(phase="running", seats=[], spectator_names=names[9:]), 0.0)
    assert game.spectator_names == tuple(names[9:17])


# Several seats


@pytest.fixture
def team(server: ScriptedServer) -> GameReplica:
    """Return a game in which the client has both seats."""
    game = GameReplica(server.joined(seats=["robot1", "robot2"], seq=3))
    game.receive(server.snapshot(), 0.0)
    game.poll()
    return game


def test_single_seat_is_not_named_in_messages(game: GameReplica) -> None:
    """Servers before this field would reject it."""
    game.propose(None, 0.0, seat="robot1")
    game.note("x", "y", seat="robot1")
    assert [getattr(message, "seat", "") for message in game.messages_to_send()] == [None, None]


def test_action_of_a_foreign_seat_is_refused_locally(game: GameReplica, team: GameReplica) -> None:
    for replica, seat in ((game, "robot2"), (team, "robot3")):
        with pytest.raises(ProtocolError, match=f"{seat} is not yours") as caught:
            replica.propose(None, 0.0, seat=seat)
        assert caught.value.code == "seat/unknown"
        with pytest.raises(ProtocolError, match=f"{seat} is not yours"):
            replica.note("x", "y", seat)
    assert team.messages_to_send() == game.messages_to_send() == []


def test_note_names_its_seat(team: GameReplica) -> None:
    team.note("plan", "I cut", "robot2")
    team.note("plan", "I cook")
    assert [message.seat for message in team.messages_to_send()] == ["robot2", "robot1"]  # type: ignore[attr-defined]


def test_any_own_seat_may_have_the_turn(server: ScriptedServer, team: GameReplica) -> None:
    team.receive(server.snapshot(turn="robot2"), 0.0)
    assert team.my_move
    assert [team.may_act(seat) for seat in ("robot1", "robot2", "robot3")] == [False, True, False]


def test_idle_decision_is_answered_in_its_own_turn(
    server: ScriptedServer, team: GameReplica
) -> None:
    team.receive(server.snapshot(turn="robot1"), 0.0)
    first, second = (team.propose(None, 0.0, seat=seat) for seat in team.own_seats)
    team.receive(server.delta().model_copy(update={"turn": "robot2"}), 0.0)
    assert team.results() == [(first, ActResult(True, 1, age=0))]
    team.receive(server.delta().model_copy(update={"turn": "robot1"}), 0.0)
    assert team.results() == [(second, ActResult(True, 2, age=1))]


def test_snapshot_answers_the_last_action_of_each_seat(
    server: ScriptedServer, team: GameReplica
) -> None:
    first, second = (team.propose("Wait", 0.0, seat=seat) for seat in team.own_seats)
    server.delta()
    answer = messages.SeatAnswer(seat="robot2", seq=second, step=1, reasons=["too late"])
    team.receive(server.snapshot(last_seq=first, last_step=1, answers=[answer], seq=9), 0.0)
    assert team.results() == [
        (first, ActResult(True, 1, age=0)),
        (second, rejected(1, "too late", "action/invalid")),
    ]
    assert team.propose(None, 0.0) == 10


def test_answer_of_another_seat_with_the_same_number_is_ignored(
    server: ScriptedServer, team: GameReplica
) -> None:
    """Another process that plays the same seats numbers its actions on its own."""
    first = team.propose("Wait", 0.0, seat="robot1")
    server.delta()
    theirs = messages.SeatAnswer(seat="robot2", seq=first, step=1)
    team.receive(server.snapshot(answers=[theirs], seq=first), 0.0)
    assert team.results() == []
    assert [act.seat for act in team.unanswered] == ["robot1"]


def test_rejection_names_its_seat(team: GameReplica) -> None:
    team.propose("x", 0.0, seat="robot1")
    seq = team.propose("Boil the sea", 0.0, seat="robot2")
    message = messages.Rejected(seq=seq, step=0, action="x", reasons=["no"], seat="robot2")
    team.receive(message, 0.0)
    assert [number for number, _ in team.results()] == [seq]
    (refused,) = team.poll()
    assert isinstance(refused, ActRejected)
    assert refused.seat == "robot2"
    assert [act.seat for act in team.unanswered] == ["robot1"]


def test_actions_of_all_seats_are_repeated_after_a_reconnect(
    server: ScriptedServer, team: GameReplica
) -> None:
    for seat in team.own_seats:
        team.propose(None, 0.0, seat=seat)
    acts = team.messages_to_send()
    team.rejoined(server.joined(seats=["robot1", "robot2"]), 1.0)
    assert team.messages_to_send() == acts
    team.rejoined(server.joined(seats=["robot1", "robot2"]), 1.0, new_session=True)
    assert [result.code for _, result in team.results()] == ["seat/lost"] * 2


@pytest.mark.parametrize("step", [-1, 10**7, 10**400])
def test_invalid_step_number_is_rejected(server: ScriptedServer, step: int) -> None:
    """A client that keeps a row for each step must not run out of memory."""
    with pytest.raises(ProtocolError, match="invalid step"):
        GameReplica(server.joined()).receive(server.snapshot(step=step), 0.0)


def test_unread_events_are_bounded(game: GameReplica) -> None:
    for number in range(20):
        game.receive(messages.Notice(text=f"large {number}"), 0.0, size=2 * 2**20)
    assert 1 <= len(game.poll()) <= 4
    for number in range(20_000):
        game.receive(messages.Notice(text=f"small {number}"), 0.0, size=50)
    kept = game.poll()
    assert 10_000 <= len(kept) < 20_000
    assert kept[-1] == Announced("small 19999")
    game.receive(messages.Notice(text="huge"), 0.0, size=2**40)
    assert game.poll() == [Announced("huge")]


@pytest.fixture
def small_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bound queues to a sixteenth of their usual size."""
    monkeypatch.setattr(event_queue, "MAX_EVENT_BYTES", event_queue.MAX_EVENT_BYTES // 16)


@pytest.mark.usefixtures("small_queue")
def test_unread_steps_of_a_usual_game_are_kept(server: ScriptedServer, game: GameReplica) -> None:
    for _ in range(10_000 // 16):
        game.receive(server.delta(), 0.0, size=100)
    assert len(game.poll()) == 10_000 // 16


@pytest.mark.usefixtures("small_queue")
def test_unread_states_count_by_their_size() -> None:
    """Each state has all timers of the one before, and a delta that changes one takes 60 bytes."""
    server = ScriptedServer("asynchronous/05")
    game = GameReplica(server.joined())
    game.receive(server.snapshot(), 0.0)
    things = game.world.placed
    items = [thing.name for thing in things if thing.type == "item"]
    stations = [thing.name for thing in things if thing.type == "station"]
    labels = [f"{verb}.0({i},{s})" for verb in ("cook", "fry") for i in items for s in stations]
    game.receive(messages.Delta(step=1, timers={label: [0, 1] for label in labels}), 0.0)
    game.poll()
    for step in range(2, 300):
        counters = [0, 1 + step % 2]
        game.receive(messages.Delta(step=step, timers={labels[0]: counters}), 0.0, size=60)
    states = [event.state for event in game.poll() if isinstance(event, StateChanged)]
    assert states
    assert sum(len(state.timers.entries) for state in states) <= 6_000


@pytest.mark.usefixtures("small_queue")
def test_unread_rosters_count_by_their_seats(server: ScriptedServer, game: GameReplica) -> None:
    seats = server.snapshot().seats
    for _ in range(1_000):
        game.receive(messages.Roster(phase="running", seats=seats), 0.0, size=60)
    assert len(game.poll()) * len(seats) <= 1_000


@pytest.mark.usefixtures("small_queue")
def test_unread_observations_count_by_their_actions(
    server: ScriptedServer, game: GameReplica
) -> None:
    """In MessagePack, an action of two letters takes 3 bytes, and about 60 in memory."""
    seat = server.joined().seat
    for step in range(20):
        actions = [f"{number % 90 + 10}" for number in range(5_000)]
        observation = messages.Observation(
            episode="e", step=step, seat=seat, text="", actions=actions
        )
        game.receive(observation, 0.0, size=15_000)
    kept = [event for event in game.poll() if isinstance(event, ObservationReceived)]
    assert kept
    assert sum(len(event.actions) for event in kept) <= 10_000


@pytest.mark.parametrize(
    "event",
    [
        ActRejected(1, 1, "a", only_words(*["no"] * 1_000), "action/invalid"),
        ActRejected(
            1, 1, "a", (Unmet(UnmetKind.OTHER, "", "", ("it",) * 3_000),), "action/invalid"
        ),
        RosterChanged("running", (), waits_for=("me",) * 3_000),
    ],
    ids=["reasons", "objects", "awaited seats"],
)
@pytest.mark.usefixtures("small_queue")
def test_unread_lists_count_by_their_texts(event: GameEvent) -> None:
    queue = event_queue.EventQueue()
    for _ in range(30):
        queue.append(event, 9_000)
    assert 1 <= len(queue) <= 3


def test_more_seats_than_players_are_rejected(server: ScriptedServer, game: GameReplica) -> None:
    seats = [messages.SeatInfo(player=f"robot{number}") for number in range(1000)]
    with pytest.raises(ProtocolError, match="more seats than players"):
        game.receive(messages.Roster(phase="running", seats=seats), 0.0)
    snapshot = server.snapshot().model_copy(update={"seats": seats})
    with pytest.raises(ProtocolError, match="more seats than players"):
        game.receive(snapshot, 0.0)


WORLD = World("multi_agent/02")
ONE, OTHER = WORLD.players
MOVE, *_ = [action for action in WORLD.initial.actions(ONE) if action.name == "move"]
OTHER_MOVE, *_ = [action for action in WORLD.initial.actions(OTHER) if action.name == "move"]


def taken(**expected: Any) -> TakenStep:
    return TakenStep.of(messages.Delta(step=1, **expected), WORLD)


def both(**expected: Any) -> TakenStep:
    rows = [[1, OTHER_MOVE.name, *OTHER_MOVE.arguments], [0, MOVE.name, *MOVE.arguments]]
    return taken(did=rows, seq=[7, 3], **expected)


@pytest.mark.parametrize(
    "expected",
    [
        {"did": [[9, MOVE.name, *MOVE.arguments]], "seq": [1]},
        {"did": [[-1, MOVE.name, *MOVE.arguments]], "seq": [1]},
        {"did": [[0, MOVE.name, *MOVE.arguments]] * 3, "seq": [1, 2, 3]},
        {"waits": [-1]},
        {"waits": [0] * 3},
        {"did": [["robot1", MOVE.name]], "seq": [1]},
        {"did": [[0, "fly", "robot1"]], "seq": [1]},
        {"did": [[0, MOVE.name, *MOVE.arguments]], "seq": []},
        {"waits": [2]},
    ],
)
def test_inconsistent_delta_is_an_error(expected: dict[str, Any]) -> None:
    with pytest.raises(RobotouilleError):
        taken(**expected)


def test_step_is_added_to_the_roster_unless_a_substitute_acted() -> None:
    def seats(controller: Controller) -> tuple[messages.SeatInfo, ...]:
        here = {"name": "ada", "acted": 4, "rejected": 2}
        return (
            messages.SeatInfo(player=ONE, controller=Controller.HUMAN, **here),
            messages.SeatInfo(player=OTHER, controller=controller, **here),
        )

    step = both(unmet={"1": ["no"]})
    one, other = step.tallied(seats(Controller.BOT))
    assert [(seat.acted, seat.rejected) for seat in (one, other)] == [(4, 3), (5, 2)]
    for controller in (Controller.ABSENT, Controller.SUBSTITUTE):
        assert step.tallied(seats(controller))[1].acted == 4


def test_rules_and_outcomes_have_their_usual_fields(server: ScriptedServer) -> None:
    """A hostile server may leave them out, and bots and tools read them."""
    game = GameReplica(server.joined())
    game.receive(server.snapshot(clock={}), 0.0)
    assert {"clock", "step_rate", "max_steps", "thinking"} <= game.clock.keys()
    game.receive(messages.Ended(step=0, hash="x", outcome={}), 1.0)
    assert game.outcome == {"reason": "", "steps": 0}


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e-300])
def test_step_rate_too_low_to_compute_with_is_refused(server: ScriptedServer, rate: float) -> None:
    game = GameReplica(server.joined())
    with pytest.raises(ProtocolError, match="invalid step rate"):
        game.receive(server.snapshot(clock={"step_rate": rate}), 0.0)


@pytest.mark.parametrize("role", ["player", "spectator"])
def test_observations_of_other_seats_are_ignored(server: ScriptedServer, role: str) -> None:
    seat = server.world.players[0] if role == "player" else None
    game = GameReplica(server.joined(role=role, seat=seat))
    for number in range(3):
        game.receive(server.observation(seat=f"chef{number}"), 0.0)
    assert (game.poll(), game.synced) == ([], False)
    assert game.observations == {}
    game.receive(server.observation(seat=seat), 0.0)
    assert game.synced


@pytest.mark.parametrize(
    "message",
    [
        messages.Told(seat="chef1", text="planner 1"),
        messages.Said(step=0, name="ada", seat="chef1", text="hello"),
        messages.Roster(phase="running", seats=[messages.SeatInfo(player="chef1")]),
    ],
)
def test_invented_seats_are_refused(game: GameReplica, message: messages.ServerMessage) -> None:
    with pytest.raises(ProtocolError, match="there is no seat 'chef1'"):
        game.receive(message, 0.0)
    assert game.poll() == []
