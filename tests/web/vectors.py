"""Random games with everything that the browser client computes from them, as JSON lines.

A line is a game (`task`, `snapshot`, `bindings`, `language`), a step of it (`delta`), or an input
of a person (`press`). All have X compares them with those of the browser
client. To write lines for another program: `python -m tests.web.vectors --states 100 --seed 1`.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import random
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from robotouille import Timing, World, load_task
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.loading import task_names
from robotouille.domain.rendering import Language, language_of
from robotouille.domain.task import Task
from robotouille.errors import RobotouilleError, TooManyObjectsError
from robotouille.protocol.states import StateWriter, why_row
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.unserved import Unserved, unserved
from robotouille.world.presentation.work import Occupancy, useful_actions, work_in_progress
from robotouille.world.scene import scene
from robotouille.world.timers import Progress
from robotouille.world.world import State
from robotouille_client.window.input.commands import DIRECTIONS, KeyMap
from robotouille_client.window.input.controls import (
    Controls,
    ResolvedInput,
    ends_work,
    handled,
    possible,
    use,
    walk,
)
from robotouille_client.window.input.input_controller import InputController
from robotouille_client.window.view import Bubble, GameSource, View

__all__ = ["COMPAT", "games", "published_tasks", "shipped_tasks"]

COMPAT = Path(__file__).parents[3] / "shared" / "compat"
WAYS = tuple(DIRECTIONS.values())
KEYS = ("", "e", "space")
STEPS = 40
"""Steps of one game."""
PRESSED = ("click", "click", "walk", "walk", "use", "use", "use", "key", "release", "tick", "pick")
JUMPS = 0.05
"""Share of the changes that lead to an earlier state."""
PRESSES = 60
"""Inputs of the person who goes on with a game at its end."""


def shipped_tasks(rng: random.Random) -> Iterator[Task]:
    """Yield every shipped task with a random timing profile and number of seats."""
    for name in task_names():
        seats = rng.choice(load_task(name).problem.seats or (None,))
        yield load_task(name, seats=seats, timing=rng.choice(list(Timing)), seed=rng.randrange(9))


def published_tasks() -> Iterator[Task]:
    """Yield the tasks of the published dialect; none if the files are missing."""
    for path in sorted((COMPAT / "upstream" / "problems").rglob("*.json")):
        try:
            yield load_task(str(path))
        except RobotouilleError:  # Some files are not problems.
            continue


def games(
    tasks: Iterable[Task], states: int, rng: random.Random, *, presses: int = PRESSES
) -> Iterator[dict[str, Any]]:
    """Yield the lines of games of some tasks.

    Args:
        states: The number of states in all.
        presses: The number of inputs of a person at the end of each game.
    """
    chosen = list(tasks)
    rng.shuffle(chosen)
    steps = max(1, min(STEPS, states // max(1, len(chosen))))
    while chosen and states > 0:
        for task in chosen:
            # Some random domains create objects in every step.
            with contextlib.suppress(TooManyObjectsError):
                for line in _game(task, min(steps, states), presses, rng):
                    states -= "expect" in line and "press" not in line
                    yield line
            if states <= 0:
                return


def _game(task: Task, states: int, presses: int, rng: random.Random) -> Iterator[dict[str, Any]]:
    world = World(task)
    state, writer = world.initial, StateWriter(world)
    language = language_of(task)
    # Games start at different times of their work, so that short samples see all of it.
    for _ in range(rng.choice((0, 10, 60)) if states < STEPS else 0):
        state = _step(state, rng)
    own = rng.random() < 0.8
    view = _Answers(world, language if own else Language(), rng)
    tables, values = writer.tables(state), writer.values(state)
    yield {
        "task": task.json,
        "snapshot": {"step": 0, "task": task.json, **tables, **values},
        "bindings": view.controls.bindings.model_dump(mode="json", by_alias=True),
        "language": view.controls.language.model_dump(mode="json", by_alias=True),
        "expect": view.answers(state),
    }
    earlier = [state]
    for number in range(1, states):
        # A jump makes objects vanish and appear again, as those of a served dish do.
        before, jumps = state, rng.random() < JUMPS
        state = rng.choice(earlier) if jumps else _step(state, rng)
        earlier.append(state)
        delta = {"step": number, **writer.changes(before, state)}
        yield {"delta": delta, "expect": view.answers(state)}
    view.controls.names = {}
    yield from _Person(view.controls, state, rng).lines(presses)


def _step(state: State, rng: random.Random) -> State:
    return state.step(_joint(state, rng)).state


def _joint(state: State, rng: random.Random) -> dict[str, GroundAction]:
    """Return random actions, most of them useful ones."""
    joint = {}
    for player in state.world.players:
        valid = useful_actions(state, player) if rng.random() < 0.9 else state.actions(player)
        work = [action for action in valid if action.destination is None]
        choices = work if work and rng.random() < 0.6 else valid
        served = _for_guests(state, player, valid)
        choices = served if served and rng.random() < 0.6 else choices
        if choices and rng.random() < 0.9:
            joint[player] = rng.choice(choices)
    return joint


def _for_guests(state: State, player: str, valid: Iterable[GroundAction]) -> list[GroundAction]:
    """Return the actions that bring what a player holds to where dishes are served."""
    shift = state.world.shift
    if shift is None or not any(each.host == player for each in scene(state).values()):
        return []
    return [action for action in valid if not shift.serving.keys().isdisjoint(action.arguments)]


class _Answers:
    """Answers of the Python code about the states of one game."""

    def __init__(self, world: World, language: Language, rng: random.Random) -> None:
        self.controls = Controls(world, bindings_of(world.task), language)
        self._input = InputController(KeyMap(), lambda: 0.0)
        self._world = world
        self._rng = rng

    def answers(self, state: State) -> dict[str, Any]:
        """Return all answers about a state, for one of its players."""
        me = self._rng.choice(self._world.players)
        names = {p: f"Ann {p}" for p in self._world.players if self._rng.random() < 0.3}
        controls, wording = self.controls, self.controls.wording(me)
        controls.names = names
        wording = controls.wording(me)
        valid = state.actions(me)
        told = [thing.name for thing in state.objects]
        asked: dict[str, Callable[[], Any]] = {
            "facts": state.fact_names,
            "objects": lambda: told,
            "orders": lambda: None if state.orders is None else state.orders.row,
            "actions": lambda: {p: list(map(str, state.actions(p))) for p in self._world.players},
            "useful": lambda: list(map(str, useful_actions(state, me))),
            "progress": lambda: list(map(_progress, state.progress())),
            "work": lambda: list(map(_progress, work_in_progress(state))),
            "unmet": lambda: [
                self._unmet(state, action, wording) for action in self._attempts(state, me)
            ],
            "clicks": lambda: {name: _row(controls.click(state, me, name)) for name in told},
            "keys": lambda: {key: _row(controls.key(state, me, key)) for key in controls.keys},
            "use": lambda: {key: _row(use(controls, state, me, key)) for key in KEYS},
            "walks": lambda: [
                [list(way), _row(walk(controls, state, me, way))] for way in self._ways()
            ],
            "possible": lambda: list(map(str, possible(state, me))),
            "options": lambda: [
                [each.key, str(each.action)] for each in controls.options(state, me)
            ],
            "hints": lambda: [list(row) for row in self._input.hints(controls, state, me)],
            "help": lambda: [list(row) for row in controls.help()],
            "handled": lambda: [sorted(handled(state, me, action)) for action in valid],
            "ends_work": lambda: [ends_work(state, action) for action in valid],
            "does": lambda: [wording.action(action, state) for action in valid],
            "things": lambda: [wording.thing(name, state) for name in told],
            "places": lambda: wording.places(state),
            "general": lambda: [wording.in_general(schema) for schema in self._world.schemas],
            "purposes": lambda: list(map(list, wording.purposes())),
            "goal": lambda: list(self._world.goal.holding(state.facts)),
            "unserved": lambda: [_unserved(each) for each in unserved(state, wording)],
        }
        found: dict[str, Any] = {"me": me, "names": names}
        for name, ask in asked.items():
            # The Python code does not read all random domains: players can be deleted in them.
            with contextlib.suppress(LookupError):
                found[name] = ask()
        return found

    def _ways(self) -> list[tuple[tuple[int, int], ...]]:
        two = tuple(self._rng.choice(WAYS) for _ in range(2))
        return [*((each,) for each in WAYS), two]

    def _attempts(self, state: State, me: str) -> Iterator[GroundAction]:
        """Yield random actions of a player, valid or not."""
        # The table has objects that do not exist yet, and some that do not exist any more.
        listed = StateWriter(self._world).tables(state)["objects"]
        now = [[thing.name, thing.kind, thing.type] for thing in state.objects]
        by_type: dict[str, list[str]] = {}
        for name, _, kind in listed if listed and self._rng.random() < 0.3 else now:
            by_type.setdefault(kind, []).append(name)
        for schema in self._rng.sample(self._world.schemas, min(6, len(self._world.schemas))):
            pools = [by_type.get(kind, []) for _, kind in schema.parameters]
            if all(pools):
                names = [self._rng.choice(pool) for pool in pools]
                if schema.player:
                    names[0] = me
                yield self._world.action(schema.name, *names)

    def _unmet(self, state: State, action: GroundAction, wording: Any) -> dict[str, Any]:
        unmet = self._world.unmet(state, action)
        occupancy = Occupancy(self._world)
        return {
            "action": [action.name, *action.arguments],
            "unmet": [{**why_row(each), "words": each.words} for each in unmet],
            "reasons": [wording.reason(each, state) for each in unmet],
            "free": [occupancy.needed_free(each) for each in unmet],
        }


class _Person(GameSource):
    """Person at the window of one game, who presses random keys and clicks on random objects.

    Everything the person does is a line with the actions sent, the notice, and the queue after it.
    """

    def __init__(self, controls: Controls, state: State, rng: random.Random) -> None:
        self._controls = controls
        self._rng = rng
        self._state = state
        self._me = rng.choice(state.world.players)
        self._seconds = rng.choice((None, 0.25))
        self._time = 0.0
        self._number = 0
        self._bubbles: tuple[Bubble, ...] = ()
        self._sent: list[GroundAction] = []
        self._pending: GroundAction | None = None
        self._input = InputController(KeyMap(), lambda: self._time, foresees=False)
        self._writer = StateWriter(state.world)

    def act(self, action: GroundAction) -> None:
        """Receive an action from the window."""
        self._sent.append(action)
        self._pending = action

    def lines(self, count: int) -> Iterator[dict[str, Any]]:
        for _ in range(count):
            self._time = round(self._time + self._rng.choice((0.0, 0.05, 0.1, 0.3, 0.5)), 2)
            self._sent = []
            try:
                line = self._step() if self._rng.random() < 0.35 else self._press()
            except LookupError:  # The player has been deleted.
                return
            sent = self._input.queue.sent
            yield {
                **line,
                "view": {"me": self._me, "stepSeconds": self._seconds},
                "time": self._time,
                "expect": {
                    "sent": list(map(str, self._sent)),
                    "labels": list(self._input.queue.labels),
                    "last": None if sent is None else [str(sent.action), sent.fate],
                },
            }

    def _press(self) -> dict[str, Any]:
        rng, window, view = self._rng, self._input, self.view()
        kind = rng.choice(PRESSED)
        value: str | int = ""
        notice = ""
        if kind == "click":
            things = [thing.name for thing in self._state.objects]
            value = rng.choice([*things, *self._state.world.floor.stations])
            notice = window.click(self._controls, value, "left", self, view)
        elif kind == "walk":
            value = command = rng.choice(list(DIRECTIONS))
            notice = window.walk(self._controls, command, self, view)
        elif kind == "use":
            value = rng.choice(KEYS)
            notice = window.use(self._controls, value, self, view)
        elif kind == "key":
            value = rng.choice(self._controls.keys or KEYS[1:])
            notice = window.key(self._controls, value, self, view)
        elif kind == "release":
            window.release()
        elif kind == "tick":
            notice = window.tick(self, view)
        else:
            value = number = rng.randrange(6)
            window.open_list(view)
            notice = window.pick(self._controls, number + 1, self, view)
            window.choices = None
        return {"press": [kind, value], "notice": notice}

    def _step(self) -> dict[str, Any]:
        before, action, self._number = self._state, self._pending, self._number + 1
        others = {p: a for p, a in _joint(before, self._rng).items() if p != self._me}
        # The others act first, so that they get in this person's way.
        step = before.step([*others.values(), action])
        self._state, self._pending = step.state, None
        applied = action is None or step.attempts[-1].applied
        if not applied:
            self._bubbles = (Bubble.rejection(self._me, "no"),)
        changes = self._writer.changes(before, self._state)
        answered = None if action is None else applied
        notice = self._input.tick(self, self.view())
        delta = {"step": self._number, **changes}
        return {"press": ["step", answered], "after": delta, "notice": notice}

    @property
    def finished(self) -> bool:
        return False

    def view(self) -> View:
        return View(
            self._state.world,
            self._state,
            step=self._number,
            me=self._me,
            bubbles=self._bubbles,
            step_seconds=self._seconds,
        )


def _row(resolved: ResolvedInput) -> list[Any]:
    action = None if resolved.action is None else str(resolved.action)
    return [action, resolved.hint, resolved.valid, resolved.advice]


def _unserved(found: Unserved) -> dict[str, Any]:
    return {**dataclasses.asdict(found), "things": sorted(found.things)}


def _progress(row: Progress) -> dict[str, Any]:
    return {**row._asdict(), "arguments": list(row.arguments)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--published", action="store_true")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    tasks = published_tasks() if options.published else shipped_tasks(rng)
    for line in games(tasks, options.states, rng):
        sys.stdout.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
