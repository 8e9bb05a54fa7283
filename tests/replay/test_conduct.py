"""Verification notices recordings that re-simulate, but break the rules of play."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.certification.step_limit import plan_beside
from robotouille.episode import Clock, Rules
from robotouille.replay.container import MAGIC, pack_frame, read_frames
from robotouille.replay.recording import Recording
from tests.support.games import play_through, record, recorded_game

Frames = list[dict[str, Any]]
GAME = recorded_game("multi_agent/01@2", seed=3, steps=20)
BY_TURNS = recorded_game("multi_agent/01@2", seed=3, steps=20, clock=Clock.TURN)


def forged(stream: bytes, edit: Callable[[Frames], object]) -> Recording:
    """Return a recording after a change, with the states that follow from it."""
    frames = list(read_frames(stream))
    edit(frames)
    changed = Recording(MAGIC + b"".join(map(pack_frame, frames)))
    return Recording(changed.resimulate())


def goal_game() -> bytes:
    """Return the recording of a game that reaches its goal."""
    plan = [joint[0] for joint in plan_beside(World(load_task("synchronous/01"))) or ()]
    rules = Rules(max_steps=50)
    return record(*play_through("synchronous/01", rules, lambda game, _: plan[game.step]))


def steps(frames: Frames) -> Frames:
    return [frame for frame in frames if frame["kind"] == "step"]


def ended(**values: Any) -> Callable[[Frames], object]:
    return lambda frames: frames[-1]["outcome"].update(values)


def cut_short(frames: Frames) -> None:
    frames[:] = [f for f in frames if f["kind"] != "step" or f["step"] <= 7]
    frames[-1]["outcome"]["steps"] = 7


def first_seat(frames: Frames) -> dict[str, Any]:
    seat: dict[str, Any] = frames[-1]["outcome"]["seats"][0]
    return seat


def reverse_times(frames: Frames) -> None:
    for step, time in zip(steps(frames), range(30_000, 0, -1_000), strict=False):
        step["t"] = time


def undo(frames: Frames) -> None:
    frames[0]["code"] = "ABCDEF"
    tables, (initial, *_) = frames[0]["tables"], frames[1]["facts"]
    predicate, *objects = tables["atoms"][initial]
    names = [tables["objects"][number][0] for number in objects]
    steps(frames)[-1]["undone"] = [[tables["predicates"][predicate], *names]]


def act_twice(frames: Frames) -> None:
    moves = next(step["moves"] for step in steps(frames) if step["moves"])
    moves.append(moves[0])


def reject_stranger(frames: Frames) -> None:
    note = {"note": "rejected", "t": 0, "player": "robot9", "seq": 1, "action": "wait"}
    frames.insert(-1, {"kind": "notes", "notes": [{**note, "reasons": ["no"]}]})


FORGED: dict[str, tuple[Callable[[Frames], object], str]] = {
    "longer than the rules": (
        lambda frames: frames[0]["rules"].update(max_steps=5),
        r"step 6: the rules allow 5 steps",
    ),
    "unknown clock": (
        lambda frames: frames[0]["rules"].update(clock="turnx"),
        r"rules.clock: Input should be 'turn', 'lockstep' or 'realtime'",
    ),
    "shorter than the limit": (cut_short, "'step_limit' after 7 steps, but the rules allow 20"),
    "unknown reason": (ended(reason="goat"), "the outcome has the unknown reason 'goat'"),
    "too few seconds": (ended(seconds=0.01), r"0.01 seconds, but the last step is at \d+ ms"),
    "wrong tally": (
        lambda frames: first_seat(frames).update(acted=999),
        r"the outcome has acted 999 for robot1, but the frames give \d+",
    ),
    "missing seat": (
        lambda frames: frames[-1]["outcome"]["seats"].pop(),
        "the outcome does not list the seats of the task",
    ),
    "later basis": (
        lambda frames: [move.update(basis=30) for step in steps(frames) for move in step["moves"]],
        r"step \d+: the action of robot\d has the basis 30, a later state",
    ),
    "times that go back": (reverse_times, r"step 2: its time 29000 ms is before .* 30000 ms"),
    "chance on a server": (undo, "step 20: facts are undone by chance"),
    "note about another player": (
        reject_stranger,
        "after step 20: a note is about 'robot9', which is not a player of the task",
    ),
    "two actions of a seat": (act_twice, r"step \d+: robot\d acts twice"),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_game_does_not_verify(name: str) -> None:
    edit, fault = FORGED[name]
    result = forged(GAME, edit).verify()
    assert re.search(fault, result.fault)
    assert not result.ok


def test_only_the_player_on_turn_acts() -> None:
    assert Recording(BY_TURNS).verify().ok
    both = forged(GAME, lambda frames: frames[0]["rules"].update(clock="turn"))
    assert re.fullmatch(r"step \d+: robot\d acts, but it is robot\d's turn", both.verify().fault)


def test_no_step_follows_the_goal() -> None:
    stream = goal_game()
    assert Recording(stream).verify().ok

    def go_on(frames: Frames) -> None:
        last = steps(frames)[-1]
        more = {"kind": "step", "step": last["step"] + 1, "t": last["t"], "moves": []}
        frames.insert(-1, more)
        frames[-1]["outcome"]["steps"] += 1

    fault = forged(stream, go_on).verify().fault
    assert re.fullmatch(r"step \d+: the goal was reached in an earlier step", fault)
