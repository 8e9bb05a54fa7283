"""Activities of seats: the episode, its recording and a plain reference count them alike."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import World, load_task
from robotouille.episode import (
    Absence,
    ActionRequest,
    Clock,
    Controller,
    Episode,
    PauseReason,
    Phase,
    Rules,
    SeatTally,
)
from robotouille.errors import ProtocolError
from robotouille.replay.controllers import json_lines
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from tests.support.thorough import thorough

WORLDS = [World(load_task("multi_agent/02", timing=timing)) for timing in ("benchmark", "people")]
STEPS = ("acted", "busy", "waiting", "idle", "away", "substituted")
STALE = ProtocolError("action/stale", "too late")


def reference(stream: bytes) -> dict[str, Counter[str]]:
    """Count the activities of each seat straight from the frames, by one rule after the other."""
    recording = Recording(stream)
    head, *frames = recording.frames
    players = [row[0] for row in head["tables"]["objects"] if row[2] == "player"]
    counts: dict[str, Counter[str]] = {player: Counter() for player in players}
    moved_by = dict.fromkeys(players, "")
    tried: list[str] = []
    states = [state for _, state in recording.states()]
    for frame in frames:
        for note in frame.get("notes", ()):
            if note["note"] == "roster":
                moved_by[note["player"]] = note["controller"]
            if note["note"] == "roster" and not note["taken"]:
                tried = [player for player in tried if player != note["player"]]
            if note["note"] == "started":
                tried = []
            if note["note"] == "rejected" and "superseded" not in note["reasons"][0]:
                tried.append(note["player"])
        if frame["kind"] != "step":
            continue
        number = frame["step"]
        done = {
            m["player"]
            for i, m in enumerate(frame["moves"])
            if str(i) not in frame.get("unmet", {})
        }
        lost = {m["player"] for m in frame["moves"]} - done
        for seat, player in enumerate(players):
            by_turns = head["rules"]["clock"] == "turn"
            rules = {
                "substituted": moved_by[player] == "substitute",
                "away": moved_by[player] in ("", "absent"),
                "acted": player in done,
                "busy": not states[number - 1].actions(player)
                and states[number - 1].busy_steps(player) > 0,
                "waiting": player in tried
                or player in lost
                or (by_turns and (number - 1) % len(players) != seat),
                "idle": True,
            }
            counts[player][next(what for what, holds in rules.items() if holds)] += 1
        tried = []
    return counts


def counts_of(tallies: dict[str, SeatTally]) -> dict[str, dict[str, int]]:
    return {p: {what: getattr(t, what) for what in STEPS} for p, t in tallies.items()}


class Game:
    """Recorded episode to which any event may happen."""

    def __init__(self, rules: Rules, world: World) -> None:
        self.rules, self.world = rules, world
        self.episode = Episode(world, rules)
        self.recorder = Recorder(world, wall=lambda: 1_700_000_000 + self.now)
        self.stream = self.recorder.begin(header(world.task, rules, episode="e"))
        self.now, self.seq, self.sessions = 0.0, 0, 0

    def flush(self) -> None:
        self.stream += self.recorder.record(self.episode.events())

    def happen(self, what: str, seat: int, choice: int) -> None:
        episode, player = self.episode, self.world.players[seat]
        self.now += choice % 7 / 8
        self.seq += 1
        sat, begun = episode.seat(player), episode.phase is not Phase.WAITING
        actions = episode.state.actions(player)
        match what:
            case "act" | "act again" if sat.present and begun and actions:
                episode.submit(
                    player, ActionRequest(self.seq, actions[choice % len(actions)]), self.now
                )
            case "wait" if sat.present and begun:
                episode.submit(player, ActionRequest(self.seq), self.now)
            case "nonsense" if sat.present and begun:
                episode.submit(player, ActionRequest(self.seq, "juggle"), self.now)
            case "unheard" if sat.taken:
                episode.refuse(player, ActionRequest(1, "walk"), STALE, self.now)
            case "substitute" if sat.controller is Controller.SUBSTITUTE and actions:
                episode.substitute(player, actions[choice % len(actions)], self.now)
            case "lose" if sat.present:
                episode.set_present(player, False, self.now)
            case "return" if sat.taken and not sat.present:
                episode.set_present(player, True, self.now)
            case "leave" if sat.taken and choice % 3 == 0:
                episode.leave(player, self.now)
            case "join" if not sat.taken:
                self.sessions += 1
                session = f"s{self.sessions}"
                episode.join(player, f"name{seat}", "human", self.now, session=session)
            case "pause":
                episode.pause(PauseReason.OPERATOR, self.now)
            case "resume":
                episode.resume(PauseReason.OPERATOR, self.now)
            case "restart" if choice % 4 == 0:
                self.restart()
                return
            case "tick":
                episode.tick(self.now)
        self.flush()

    def restart(self) -> None:
        """Replace the episode by one restored from its recording, some time later."""
        before = {p: seat.tally for p, seat in self.episode.seats.items()}
        self.now += 100.0
        found = restore(Recording(self.stream), self.now, 5.0)
        self.stream = self.stream[: found.kept] + found.missing
        self.episode = found.episode
        self.recorder = Recorder(self.episode.world, wall=self.recorder.wall)
        assert {p: seat.tally for p, seat in self.episode.seats.items()} == before
        self.flush()


HAPPENINGS = ("act", "act again", "tick", "wait", "nonsense", "unheard", "substitute", "lose")
RARE = ("return", "leave", "join", "pause", "resume", "restart")
EVENTS = st.tuples(st.sampled_from(HAPPENINGS * 2 + RARE), st.integers(0, 1), st.integers(0, 1000))


@pytest.mark.slow
@thorough(60)
@given(
    st.sampled_from(list(Clock)),
    st.sampled_from(list(Absence)),
    st.sampled_from(WORLDS),
    st.lists(EVENTS, min_size=20, max_size=120),
)
def test_counts_agree_and_sum_to_the_steps(
    clock: Clock, absence: Absence, world: World, events: list[tuple[str, int, int]]
) -> None:
    rules = Rules(
        clock=clock, absence=absence, step_rate=4.0, max_steps=60, move_budget=3.0, grace=30.0
    )
    game = Game(rules, world)
    game.happen("join", 0, 0)
    game.happen("join", 1, 0)
    for event in events:
        if game.episode.phase is Phase.ENDED:
            break
        game.happen(*event)
    game.episode.abort(game.now, "the end")
    game.flush()
    recording = Recording(game.stream)
    assert recording.verify().ok
    outcome = game.episode.outcome
    assert outcome is not None
    received = {tally.player: tally for tally in outcome.seats}
    assert [tally.steps for tally in received.values()] == [recording.length] * 2
    assert counts_of(received) == {
        player: {what: counted[what] for what in STEPS}
        for player, counted in reference(game.stream).items()
    }
    measured = recording.measures().seats
    assert {player: seat.activities for player, seat in measured.items()} == counts_of(received)
    assert recording.outcome is not None
    assert {row["player"]: SeatTally(**row) for row in recording.outcome["seats"]} == received


def exported(recording: Recording) -> list[dict[str, Any]]:
    return [json.loads(line) for line in json_lines(recording)]


def test_export_has_activities_in_seat_order() -> None:
    game = Game(Rules(clock=Clock.REALTIME, step_rate=2.0), WORLDS[1])
    for seat in (1, 0):
        game.happen("join", seat, 0)
    walk = next(a for a in game.episode.state.actions("robot1") if a.name == "move")
    game.episode.submit("robot1", ActionRequest(1, walk), 0.1)
    game.episode.tick(3.0)
    game.episode.abort(3.1, "the end")
    game.flush()
    head, *rows = exported(Recording(game.stream))
    assert list(head["participants"]) == ["robot1", "robot2"]
    steps = [row for row in rows if row["kind"] == "step"]
    assert [row["activities"]["robot1"] for row in steps[:2]] == ["acted", "busy"]
    assert {row["activities"]["robot2"] for row in steps} == {"idle"}
    assert [row["busy"].get("robot1", 0) > 0 for row in steps[:2]] == [False, True]
    (end,) = [row for row in rows if row["kind"] == "outcome"]
    assert [seat["player"] for seat in end["seats"]] == ["robot1", "robot2"]
    for seat in end["seats"]:
        found = Counter(row["activities"][seat["player"]] for row in steps)
        assert {what: seat[what] for what in STEPS} == {what: found[what] for what in STEPS}
