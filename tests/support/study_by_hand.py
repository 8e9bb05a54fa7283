"""Measures of a study, computed slowly from a file's bytes and the documentation alone.

The container, the frames and the activities follow docs/recording_format.md, and states follow
docs/episodes.md in the tests' reference world. Useful steps follow docs/data.md. Only the
estimate of the work that is left comes from the product, because data.md defines it as the beam
planner's; `tests/data/test_study_by_hand.py` compares it with exact distances.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import msgpack
import zstandard

from robotouille import Task, World
from robotouille.planning.beam.goal_ordering import Ordering
from robotouille.planning.beam.planner import goal_assignments
from robotouille.planning.beam.remaining_work_heuristic import HeuristicContext, RemainingWork
from robotouille.world.grounding.atoms import EXISTS, USED
from robotouille.world.world import State
from tests.world.reference import Call, Reference, ReferenceState

__all__ = [
    "INACTIVE",
    "Estimate",
    "Work",
    "activities",
    "after_walk",
    "frames",
    "is_walk",
    "key",
    "useful",
    "useful_steps",
]

Frame = dict[str, Any]
Work = Callable[[ReferenceState], float]
"""Work left in a state, as seen from one state: the choice of objects is that state's."""

INACTIVE = ("waiting", "idle")
LARGEST = 256 * 1024 * 1024


def frames(content: bytes) -> list[Frame]:
    """Return the frames of a recording, closed or not."""
    if content.startswith(b"\x28\xb5\x2f\xfd"):
        content = zstandard.ZstdDecompressor().decompress(content, max_output_size=LARGEST)
    assert content[:5] == b"RBTL\x03"
    found, place = [], 5
    while place < len(content):
        size, checksum, head = struct.unpack_from("<III", content, place)
        payload = content[place + 12 : place + 12 + size]
        assert zlib.crc32(content[place : place + 8]) == head
        assert zlib.crc32(payload) == checksum
        found.append(msgpack.unpackb(payload))
        place += 12 + size
    return found


def activities(recorded: list[Frame]) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield each step's number and the activity of each seat in it."""
    head = recorded[0]
    players = Reference(Task.from_json(head["task"])).players
    controllers = dict.fromkeys(players, "")
    refused: set[str] = set()
    busy: Mapping[str, int] = {}
    for frame in recorded:
        if frame["kind"] == "state" and frame["step"] == 0:
            busy = dict(frame["busy"])
        for note in frame.get("notes", ()):
            if note["note"] == "started":
                refused.clear()  # Requests before the first step belong to no step.
            elif note["note"] == "roster":
                controllers[note["player"]] = note["controller"]
                if not note["taken"]:
                    refused.discard(note["player"])  # They were another participant's.
            elif note["note"] == "rejected" and not _is_superseded(note):
                refused.add(note["player"])
        if frame["kind"] == "step":
            turn = players[(frame["step"] - 1) % len(players)]
            by_turns = head["rules"]["clock"] == "turn"
            yield (
                frame["step"],
                {
                    player: _activity(
                        frame,
                        player,
                        controllers[player],
                        busy=player in busy,
                        hindered=player in refused or (by_turns and player != turn),
                    )
                    for player in players
                },
            )
            refused.clear()
            if "busy" in frame:
                busy = dict(frame["busy"])


def _is_superseded(note: Mapping[str, Any]) -> bool:
    code = note.get("code", "")
    malformed = code == "action/unknown" or code.startswith("message/")
    replaced = any(reason["kind"] == "superseded" for reason in note.get("why", ()))
    return replaced and not malformed and note.get("heard", True) is True


def _activity(frame: Frame, player: str, controller: str, *, busy: bool, hindered: bool) -> str:
    lost = [int(place) for place in frame.get("unmet", {})]
    moves = [place for place, move in enumerate(frame["moves"]) if move["player"] == player]
    if controller == "substitute":
        return "substituted"
    if controller in ("absent", ""):
        return "away"
    if any(place not in lost for place in moves):
        return "acted"
    if busy:
        return "busy"
    return "waiting" if moves or hindered or player in frame.get("waits", ()) else "idle"


def states(recorded: list[Frame], reference: Reference) -> Iterator[ReferenceState]:
    """Yield the state before each step, and the last one."""
    state = reference.initial
    yield state
    for frame in recorded:
        if frame["kind"] == "step":
            joint = [
                (move["player"], (move["action"][0], tuple(move["action"][1:])))
                for move in frame["moves"]
            ]
            state, applied = reference.step(state, joint)
            assert [place for place, did in enumerate(applied) if not did] == sorted(
                int(place) for place in frame.get("unmet", {})
            )
            yield state


def useful_steps(recorded: list[Frame]) -> Iterator[tuple[int, str, bool]]:
    """Yield step, player and whether it could act usefully, for each inactive seat."""
    task = Task.from_json(recorded[0]["task"])
    reference, work_from = Reference(task), Estimate(task)
    players, by_turns = reference.players, recorded[0]["rules"]["clock"] == "turn"
    known: dict[object, bool] = {}
    for (step, did), state in zip(activities(recorded), states(recorded, reference), strict=False):
        for player in players:
            if did[player] not in INACTIVE:
                continue
            if by_turns and player != players[(step - 1) % len(players)]:
                yield step, player, False
                continue
            about = (key(state), player)
            if about not in known:
                known[about] = useful(reference, state, player, work_from)
            yield step, player, known[about]


def useful(
    reference: Reference,
    state: ReferenceState,
    player: str,
    work_from: Callable[[ReferenceState], Work | None],
) -> bool:
    """Return whether an action leaves less work than a step in which nobody acts."""
    if player in state.busy:
        return False
    calm = state.copy()
    calm.busy.clear()
    work = work_from(calm)
    if work is None:
        return False
    most = work(reference.step(calm, [])[0])
    starts = [calm]
    for call in reference.valid(calm, player):
        if is_walk(reference, call):
            starts.append(after_walk(reference, calm, call))
    return any(
        work(reference.step(there, [(player, call)])[0]) < most - 1e-6
        for there in starts
        for call in reference.valid(there, player)
        if not is_walk(reference, call)
    )


def after_walk(reference: Reference, state: ReferenceState, call: Call) -> ReferenceState:
    """Return the state after a walk that takes no time."""
    there = state.copy()
    reference.make(there, reference.actions[call[0]].immediate_fx, reference.binding(call))
    return there


def is_walk(reference: Reference, call: Call) -> bool:
    """Return whether an action moves its player to another station."""
    return reference.actions[call[0]].travel is not None


def key(state: ReferenceState) -> object:
    """Return a value that is equal for equal states, except for how long players are busy."""
    made = tuple(sorted(state.created.items()))
    return frozenset(state.facts), tuple(state.timer_rows()), frozenset(state.busy), made


class Estimate:
    """The beam planner's estimate of the work left, with the objects that it would choose."""

    def __init__(self, task: Task) -> None:
        self._world = World(task)
        self._context = HeuristicContext(self._world)
        reference = Reference(task)
        self._numbers, self._placed = reference.numbers, [*reference.initial.objects]
        self._ordering: Ordering | None = None

    def __call__(self, state: ReferenceState) -> Work | None:
        """Return the work for the choice of objects in a state, or None without such a choice."""
        self._twin(state, state.facts)  # Makes room for the objects.
        self._context.refresh()
        if self._ordering is None:
            first = goal_assignments(self._context, self._world.initial)
            if not first:
                return None
            self._ordering = Ordering(self._context, first[0])
        twin = self._twin(state, state.facts)
        choices = goal_assignments(self._context, twin, self._ordering)
        if not choices:
            return None
        forecast = self._context.forecast(twin.facts, twin.timers)
        facts = (twin.facts | forecast.touched) ^ forecast.removed
        rules = self._ordering.rules(choices[0])
        remaining = RemainingWork(self._context, choices[0], facts, rules)
        return lambda after: self._left(remaining, after)

    def _left(self, remaining: RemainingWork, state: ReferenceState) -> float:
        # Where players stand does not count, nor do the steps for which they are busy.
        twin = self._twin(state, {fact for fact in state.facts if not self._is_place(state, fact)})
        return remaining(twin.facts, twin.timers)

    def _is_place(self, state: ReferenceState, fact: tuple[str, ...]) -> bool:
        types = {state.objects[name][1] for name in fact[1:]}
        domain = self._world.task.domain
        return (
            len(fact) == 3
            and bool(types & {*domain.player_types})
            and bool(types & {*domain.station_types})
        )

    def _twin(self, state: ReferenceState, facts: set[tuple[str, ...]]) -> State:
        """Return the product's state with these facts and the reference's timers."""
        born = [
            f"{kind}{self._numbers[kind] + number}"
            for kind, count in state.created.items()
            for number in range(1, count + 1)
        ]
        self._world.admit(born)
        there = [(EXISTS, name) for name in state.objects]
        used = [(USED, name) for name in (*born, *self._placed)]
        mask = self._world.table.mask([*facts, *there, *used])
        return self._world.restore(mask, state.timer_rows())
