"""Packs without delays."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from robotouille import World
from robotouille.planning import replay
from robotouille_evaluation.packs.delay_free import delay_free
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import read_pack, write_pack
from tests.support.published import CHECKOUT, NEEDED

TASKS = ("asynchronous/01_cheese_chicken_sandwich", "asynchronous/06_potato_soup")


@cache
def packs() -> tuple[Pack, Pack]:
    own = build_own_pack()
    seen: list[tuple[int, int]] = []
    chosen = [i for i in own.instances if i.task in TASKS and i.kind == "default"]
    free = delay_free(own, chosen, lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]
    return own, free


def test_same_kitchens_with_shorter_plans() -> None:
    own, free = packs()
    assert free.digest != own.digest
    assert free.name == "ours-delay-free"
    assert [task.name for task in free.tasks] == list(TASKS)
    for instance in free.instances:
        before, after = World(own.load(instance.id)), World(free.load(instance))
        assert after.initial.fact_names() == before.initial.fact_names()
        assert after.task.goal_description == before.task.goal_description
        best, known = instance.best(), own.instance(instance.id).best()
        assert best is not None and known is not None and best.proven
        assert best.steps < known.steps
        assert replay(free.plan(instance, after), after).ok
        assert free.budget(instance, "own").optimal == best.steps


def test_plans_without_waiting() -> None:
    _, free = packs()
    for instance in free.instances:
        world = World(free.load(instance))
        state = world.initial
        for joint in free.plan(instance, world):
            state = state.step(list(joint)).state
            assert not [row for row in state.progress() if row.timed and row.running]


def test_delay_free_pack_is_stored(tmp_path: Path) -> None:
    _, free = packs()
    write_pack(free, tmp_path / "pack")
    assert read_pack(tmp_path / "pack", digest=free.digest) == free


@NEEDED
def test_published_pack_without_delays() -> None:
    pack = read_checkout(CHECKOUT, seeds=()).pack
    chosen = [i for i in pack.instances if i.task == "asynchronous/0_cheese_chicken_sandwich"]
    (instance,) = delay_free(pack, chosen, lambda *_: None).instances
    best = instance.best()
    assert best is not None and best.proven
    assert any("cook" in line for line in best.plan) and "-" not in best.plan
