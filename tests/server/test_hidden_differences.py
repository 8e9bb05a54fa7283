"""Kitchens that differ in hidden things only: players with limited sight cannot tell them apart."""

from __future__ import annotations

import json
import random
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robotouille import Sight, State, World
from robotouille.domain.loading import load_task
from robotouille.domain.schema import ObjectDef
from robotouille.domain.task import Task
from robotouille.replay.recording import read_recording
from robotouille.world.sight import seen_by
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

ME = "robot1"
STEPS = 12
SIGHTS = (Sight(1), Sight(2), Sight(2, blocked=True))


def changed(task: Task, rng: random.Random) -> Task:
    """Return a task with some things at other places, in another condition, or both."""
    objects = {kind: list(rows) for kind, rows in task.problem.objects.items()}
    world = World(task)
    movable = [kind for kind in ("item", "container", "meal") if len(objects.get(kind, ())) > 1]
    for _ in range(rng.randint(1, 4)):
        rows = objects[rng.choice(movable)]
        i, j = rng.sample(range(len(rows)), 2)
        rows[i], rows[j] = _at_place_of(rows[i], rows[j]), _at_place_of(rows[j], rows[i])
        k = rng.randrange(len(rows))
        if rows is objects.get("item") and rng.random() < 0.3:
            rows[k] = rows[k].model_copy(update={"predicates": (*rows[k].predicates, "iscut")})
    if task.seats > 1 and rng.random() < 0.7:
        station = rng.choice(sorted(world.floor.stations))
        (x, y), beside = world.floor.stations[station], world.floor.beside(station)
        if beside:
            here = rng.choice(beside)
            update = {"x": here[0], "y": here[1], "direction": (x - here[0], y - here[1])}
            objects["player"][1] = objects["player"][1].model_copy(update=update)
    rows = {kind: tuple(each) for kind, each in objects.items()}
    return replace(task, problem=task.problem.model_copy(update={"objects": rows}))


def _at_place_of(thing: ObjectDef, other: ObjectDef) -> ObjectDef:
    place = {name: getattr(other, name) for name in ("x", "y", "stack_level")}
    return thing.model_copy(update=place)


def looks(state: State, sight: Sight) -> tuple[Any, ...]:
    """Return what the player sees of a state, in words that do not depend on the task."""
    seen = seen_by(state, ME, sight)
    return seen.state.digest, frozenset(seen.hidden)


def alike(name: str, sight: Sight, seed: int) -> tuple[Task, Task]:
    """Return two tasks that look the same to the player at the start, and are not."""
    rng, task = random.Random(seed), load_task(name)
    for _ in range(200):
        other = Task.from_json(changed(task, rng).json)
        one, two = World(task).initial, World(other).initial
        if one.digest != two.digest and looks(one, sight) == looks(two, sight):
            return task, other
    pytest.skip("everything is in sight")


async def played(
    folder: Path, task: Task, sight: Sight, seed: int
) -> tuple[list[list[dict[str, Any]]], list[tuple[Any, ...]]]:
    """Play a task on a server.

    Returns:
        The messages of each step to the player, and what it sees before and after each step,
        with the results of its actions.
    """
    tasks = folder / "tasks"
    tasks.mkdir(parents=True)
    problem = {**task.json["problem"], "domain": "own.json"}
    (tasks / "own.json").write_text(json.dumps(task.json["domain"]))
    (tasks / "kitchen.json").write_text(json.dumps(problem))
    rng = random.Random(seed)
    async with serving(folder / "recordings", tasks=tasks) as server, AsyncExitStack() as stack:
        me, other = [await stack.enter_async_context(raw(server, name=n)) for n in ("me", "other")]
        create: dict[str, Any] = {"type": "create", "task": "kitchen", "clock": "lockstep"}
        create |= {"seats": task.seats, "max_steps": STEPS, "move_budget": 0.0}
        create |= {"sight": sight.distance, "sight_blocked": sight.blocked}
        created = await me.ask(create, "created")
        assert created["type"] == "created", created
        join = {"type": "join", "episode": created["code"], "view": "both", "partial": True}
        got = [[await me.ask({**join, "seat": ME}, "joined")]]
        if task.seats > 1:
            await other.ask({**join, "seat": "robot2"}, "joined")
        got.append(await until_observation(me, 0))
        for step in range(1, STEPS + 1):
            await me.send({"type": "resync"})
            got[-1].append(await me.expect("snapshot"))
            got[-1].append(await me.expect("observation"))
            offered = got[-1][-1]["actions"]
            if task.seats > 1:
                await other.send({"type": "act", "seq": step, "action": None})
            await me.send({"type": "act", "seq": step, "action": rng.choice(offered)})
            got.append(await until_observation(me, step))
        for ask in ({"type": "list"}, {"type": "get_rendering"}):
            got[-1].append(await me.ask(ask, "episodes", "rendering"))
    (path,) = (folder / "recordings").glob("*.rbt")
    recording = read_recording(path)
    states = [state for _, state in recording.states()]
    return got, [looks(state, sight) for state in states]


async def until_observation(socket: Raw, step: int) -> list[dict[str, Any]]:
    found = [await socket.receive()]
    while found[-1]["type"] != "observation" or found[-1]["step"] < step:
        found.append(await socket.receive())
    return found


def timeless(message: Any) -> Any:
    """Return a message without times."""
    if isinstance(message, dict):
        return {k: timeless(v) for k, v in message.items() if k not in TIMES}
    return [timeless(each) for each in message] if isinstance(message, list) else message


TIMES = {"left", "latency_ms", "seconds", "resume"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["multi_agent/07@2", "shifts/04", "asynchronous/09"])
@virtual
async def test_kitchens_that_differ_in_hidden_things_send_equal_messages(
    tmp_path: Path, name: str, seed: int
) -> None:
    sight = SIGHTS[seed % 3]
    one, two = alike(name, sight, seed)
    first, states = await played(tmp_path / "one", one, sight, seed)
    second, others = await played(tmp_path / "two", two, sight, seed)
    for step, (mine, theirs) in enumerate(zip(first, second, strict=False)):
        # Group 0 is the answer to `join`, group 1 the state before the first step.
        if step > 1 and states[step - 1] != others[step - 1]:
            break
        assert timeless(mine) == timeless(theirs), step
