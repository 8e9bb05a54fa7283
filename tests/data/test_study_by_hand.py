"""Activities and useful steps in the catalogue, compared with slow independent computations."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille import Task, World, load_task
from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.replay.recorder import Recorder, header
from robotouille_data.recording_rows import Searches, content_digest, episode_id, recorded_rows
from tests.support.random_play import random_stream
from tests.support.samples import quick_sample
from tests.support.study_by_hand import (
    INACTIVE,
    Estimate,
    activities,
    after_walk,
    frames,
    is_walk,
    key,
    useful,
    useful_steps,
)
from tests.world.reference import Reference, ReferenceState

TEAM = "training/03_multi_agent"
Row = dict[str, object]


def rows_of(content: bytes) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {"steps": [], "seats": []}
    searches = Searches(useful=True)
    for part in recorded_rows(content, episode_id(content_digest(content)), searches):
        for table, rows in part.tables:
            names = [column.name for column in table.columns]
            named = [dict(zip(names, row, strict=True)) for row in rows]
            found.setdefault(table.name, []).extend(named)
    return found


def team_stream(kind: str, timing: str) -> bytes:
    """Return a recording of a team that follows the shipped plan and does nothing for every third
    step. Bots declare these waits; people cannot.
    """
    world = World(load_task(f"{TEAM}@2", timing=timing))
    plan = (data_folder("problems") / f"{TEAM}@2.plan").read_text(encoding="utf-8")
    planned = [a for joint in read_plan(plan, World(f"{TEAM}@2"), "plan") for a in joint if a]
    rules = Rules(clock=Clock.LOCKSTEP, max_steps=150)
    episode, recorder = Episode(world, rules), Recorder(world)
    stream = recorder.begin(header(world.task, rules, episode=kind, created="2026-01-01"))
    for player in world.players:
        episode.join(player, player, kind, 0.0)
    todo = {
        player: deque(world.action(a.name, *a.arguments) for a in planned if a.player == player)
        for player in world.players
    }
    seq = 0
    while not episode.ended:
        seq += 1
        for player, left in todo.items():
            if episode.ended or episode.state.busy_steps(player):
                continue
            action = None
            if seq % 3 and left and left[0] in episode.state.actions(player):
                action = left.popleft()
            waits = action is None and kind == "bot"
            episode.submit(player, ActionRequest(seq, action, waits=waits), float(seq))
        episode.tick(float(seq))
        stream += recorder.record(episode.events())
    return stream


def check(content: bytes) -> Counter[bool]:
    """Compare the catalogue with the computation by hand, and return the useful steps."""
    rows, recorded = rows_of(content), frames(content)
    players = [row["player"] for row in rows["seats"]]
    found = {(row["step"], players[row["seat"]]): row for row in rows["steps"]}  # type: ignore[call-overload]
    did = {
        (step, player): what for step, all_ in activities(recorded) for player, what in all_.items()
    }
    assert {place: row["activity"] for place, row in found.items()} == did
    could = {(step, player): true for step, player, true in useful_steps(recorded)}
    assert {place: row["useful"] for place, row in found.items()} == {
        place: could.get(place) for place in did
    }
    assert could.keys() == {place for place, what in did.items() if what in INACTIVE}
    for seat in rows["seats"]:
        own = Counter(true for (_, player), true in could.items() if player == seat["player"])
        assert (seat["unused"], seat["hindered"]) == (own[True], own[False])
    return Counter(could.values())


@pytest.mark.parametrize("seed", quick_sample(range(24), quick=0, nightly=6))
def test_random_play_is_measured_as_by_hand(seed: int) -> None:
    check(random_stream(seed))


@pytest.mark.slow
@pytest.mark.parametrize("timing", ["benchmark", "people"])
def test_people_and_bots_are_measured_alike_and_as_by_hand(timing: str) -> None:
    """The same steps have the same useful steps, whoever took them and declared waits."""
    counted = check(team_stream("human", timing))
    assert counted == check(team_stream("bot", timing))
    assert min(counted[True], counted[False]) >= 5


def small_kitchen() -> Task:
    """Return a task for one player: cook a patty and lay it on a bun."""
    task = load_task("training/02_asynchronous")
    raw = task.json["problem"]
    stations, items = raw["objects"]["station"], raw["objects"]["item"]
    objects = {
        **raw["objects"],
        "station": [stations[0], stations[2], stations[5], stations[7]],
        "item": [items[0], items[2]],
    }
    goal = [*raw["goal"][:3], {"predicate": "clear", "args": ["patty"], "ids": [3]}]
    return Task.from_json({**task.json, "problem": {**raw, "objects": objects, "goal": goal}})


def steps_left(reference: Reference) -> Iterator[tuple[ReferenceState, object, int]]:
    """Yield each reachable state, its key and the fewest steps to the goal, if walks take none."""
    states = {key(reference.initial): reference.initial}
    sources: dict[object, list[tuple[int, object]]] = {}
    queue = deque(states)
    while queue:
        state = states[source := queue.popleft()]
        (player,) = reference.players
        following = [(1, reference.step(state, [])[0])]
        for call in reference.valid(state, player):
            if is_walk(reference, call):
                following.append((0, after_walk(reference, state, call)))
            else:
                following.append((1, reference.step(state, [(player, call)])[0]))
        for cost, after in following:
            target = key(after)
            sources.setdefault(target, []).append((cost, source))
            if target not in states:
                states[target] = after
                queue.append(target)
    left = dict.fromkeys((k for k, state in states.items() if reference.goal_reached(state)), 0)
    queue = deque(left)
    while queue:
        target = queue.popleft()
        for cost, source in sources.get(target, ()):
            if left[target] + cost < left.get(source, len(states)):
                left[source] = left[target] + cost
                (queue.append if cost else queue.appendleft)(source)
    for place, state in states.items():
        yield state, place, left[place]


@pytest.mark.slow
def test_useful_steps_agree_with_exact_distances_in_a_small_kitchen() -> None:
    """data.md states the share and the two ways in which the estimate differs."""
    reference, estimate = Reference(small_kitchen()), Estimate(small_kitchen())
    known = {place: (state, steps) for state, place, steps in steps_left(reference)}
    counted: Counter[tuple[bool, bool]] = Counter()
    for state, _ in known.values():
        exact = useful(reference, state, "robot1", lambda _: lambda after: known[key(after)][1])
        judged = useful(reference, state, "robot1", estimate)
        counted[exact, judged] += 1
        held = {fact[2] for fact in state.facts if fact[0] == "has_item"}
        if exact and not judged:
            assert held == {"patty1"}  # It has to be put down, to clear the stove of the bun.
        elif judged and not exact:
            assert held == {"bottombun1"}  # It can be put down until the patty is done.
    assert len(known) == 872
    assert counted[True, True] + counted[False, False] >= 0.95 * len(known), counted
