"""Comparison of the step encoding with the world, fact by fact, in random play."""

from __future__ import annotations

import random
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain
from robotouille.installation import data_folder
from robotouille.planning.pddl import PddlEncoding, encode, read_pddl_plan
from robotouille.planning.pddl.step_encoding import instant_name
from robotouille.planning.plan import Plan, read_plan, replay
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State
from tests.planning.pddl.interpreter import Fact, Interpreter
from tests.support.broken_files import DOMAIN, PROBLEM, changed
from tests.support.samples import quick_sample

TASKS = (
    "asynchronous/06_potato_soup",
    "asynchronous/03_lettuce_tomato_fried_chicken_sandwich",
    "training/03_multi_agent@3",
    "workshop/01_painted_gear",
    "workshop/02_two_workers",
)


class Walk:
    """Random play in a world and in its encoding at the same time."""

    def __init__(self, world: World, seed: int) -> None:
        self.world = world
        self.encoding: PddlEncoding = encode(world, created=6)
        self.pddl = Interpreter(self.encoding.domain, self.encoding.problem)
        self.state: State = world.initial
        self.random = random.Random(seed)
        self.lines: list[str] = []
        self.joints: list[tuple[Any, ...]] = []
        self.said = {self.encoding.names.predicate(p) for p in world.table.types}

    def name(self, term: Fact) -> Fact:
        return tuple(self.encoding.names.term(term).strip("()").split())

    def apply(self, *words: str) -> None:
        self.pddl.apply(*words)
        self.lines.append(f"({' '.join(words)})")

    def step(self, wanted: tuple[GroundAction, ...] | None = None) -> None:
        """Take a step with the given actions, or random ones."""
        names, players = self.encoding.names, self.world.players
        joint: list[Any] = []
        for player, following in zip(players, [*players[1:], "~clock"], strict=True):
            action = self.choose(player, wanted)
            if action is None:
                self.apply("pass", names.symbol(player), names.symbol(following))
            else:
                arguments = [*action.arguments, following]
                self.apply(names.action(action.name), *map(names.symbol, arguments))
                joint.append(action)
            self.carry_out()
        self.apply("tick", names.symbol(players[0]))
        self.state = self.state.step(joint).state
        self.carry_out()
        self.joints.append(tuple(joint))

    def choose(self, player: str, wanted: tuple[GroundAction, ...] | None) -> GroundAction | None:
        """Return a random action, preferably one that starts an effect."""
        if wanted is not None:
            found = next((a for a in wanted if a.player == player), None)
            return found if found and found.schema.definition.precons else None
        state = self.world.restore(self.mask(), self.state.timer_rows())
        valid = [a for a in state.actions(player) if a.schema.definition.precons]
        if not valid or self.random.random() < 0.1:
            return None
        walks = (a.destination is not None for a in valid)
        weights = [
            1 + 20 * bool(a.effects) + 5 * (not w) for a, w in zip(valid, walks, strict=True)
        ]
        return self.random.choices(valid, weights)[0]

    def mask(self) -> int:
        """Return the world's facts in the encoding's present state."""
        table = self.world.table
        there = {name for name in self.world.thing_names if self.name(("~there", name))
                 in self.pddl.facts}  # fmt: skip
        true = [a for a in table.atoms if self.name(a) in self.pddl.facts]
        used = self.state.facts & table.internal
        return table.mask(true) | used | table.mask(("~exists", name) for name in there)

    def carry_out(self) -> None:
        """Apply the due creations and deletions in any order."""
        while self.encoding.lifted.instants and ("quiet",) not in self.pddl.facts:
            choices = []
            for timer, part in self.encoding.lifted.instants:
                name = self.encoding.names.action(instant_name(timer, part))
                due = self.name((timer.due(part)[0],))[0]
                fresh = [f[1:] for f in sorted(self.pddl.facts) if f[0].startswith("next-")]
                for fact in sorted(self.pddl.facts):
                    if fact[0] == due:
                        choices += [(name, *fact[1:], *f) for f in [(), *fresh]]
            arity = {n: len(a[":parameters"]) // 3 for n, a in self.pddl.actions.items()}
            fit = [c for c in choices if len(c) == arity[c[0]] + 1 and self.pddl.applicable(*c)]
            if fit:
                self.apply(*self.random.choice(fit))
            else:
                self.apply("go-on")

    def facts(self) -> set[Fact]:
        """Return the world's facts, and only constant facts of deleted objects."""
        table, names = self.world.table, self.encoding.names
        static = {names.predicate(p) for p in table.static_predicates}
        come_and_go = {names.symbol(n) for k in table.transient for n in table.by_type[k]}
        gone = {n for n in come_and_go if self.name(("~there", n)) not in self.pddl.facts}
        return {
            fact
            for fact in self.pddl.facts
            if fact[0] in self.said and not (fact[0] in static and gone.intersection(fact))
        }

    def running(self) -> set[Fact]:
        active = {self.name(t.active)[0] for t in self.encoding.lifted.timers}
        return {fact for fact in self.pddl.facts if fact[0] in active}

    def agree(self) -> None:
        assert self.facts() == {self.name(atom) for atom in self.state.atoms()}
        rows = self.state.timer_rows()
        assert self.running() == {
            self.name((f"~{action}:{index}:active", *arguments))
            for action, index, arguments, _ in rows
        }


def shipped_plan(world: World) -> Plan:
    task = world.task
    folder = data_folder("problems")
    paths = (folder / f"{task.name}.plan", folder / f"{task.name}@{task.seats}.plan")
    return read_plan(next(p for p in paths if p.is_file()).read_text(), world)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("share", quick_sample([0.4, 0.0, 0.7]))
def test_random_play_matches_the_world(task: str, share: float) -> None:
    world = World(load_task(task))
    walk = Walk(world, seed=5)
    walk.agree()
    for joint in shipped_plan(world).steps[: int(share * len(shipped_plan(world)))]:
        walk.step(joint)
        walk.agree()
    for _ in range(25):
        walk.step()
        walk.agree()
    assert walk.pddl.cost == len(walk.joints)


def test_immediate_creation_matches_the_world() -> None:
    domain = DomainFile.model_validate(DOMAIN)
    problem = ProblemFile.model_validate(changed(PROBLEM, "config", to={"cuts": {"default": 4}}))
    walk = Walk(World(build_task("peels", domain, problem)), seed=0)
    for _ in range(6):
        walk.step()
        walk.agree()


@pytest.mark.parametrize("task", TASKS)
def test_plans_round_trip(task: str) -> None:
    walk = Walk(World(load_task(task)), seed=7)
    for _ in range(25):
        walk.step()
    plan = read_pddl_plan("\n".join(walk.lines), walk.world, created=6)
    assert plan == Plan(tuple(walk.joints))
    assert replay(plan, walk.world).final == walk.state


def test_objects_created_together_get_the_worlds_names() -> None:
    problem = ProblemFile.model_validate({
        "version": "2.0", "width": 4, "height": 2,
        "objects": {
            "station": [{"name": "sink", "x": x, "y": 0} for x in (0, 1)]
            + [{"name": "table", "x": 2, "y": 0}],
            "container": [{"name": "pot", "x": x, "y": 0} for x in (0, 1)]
            + [{"name": "bowl", "x": 2, "y": 0}],
            "player": [{"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in (0, 1)],
        },
        "goal": [{"predicate": "in", "args": ["water", "bowl"], "ids": [1, 2]}],
    })  # fmt: skip
    world = World(build_task("sinks", read_domain("robotouille"), problem, seats=2))
    plan = read_pddl_plan(REVERSED, world)
    assert str(plan.steps[-1]) == "(<fill-bowl(robot1, water1, pot1, bowl1, table1)>,)"
    assert replay(plan, world).ok
    encoding = encode(world)
    pddl = Interpreter(encoding.domain, encoding.problem)
    for line in REVERSED.splitlines():
        pddl.apply(*line.strip("()").split())
    assert pddl.cost == 7
    assert pddl.reached in pddl.facts


REVERSED = "\n".join([
    "(fill-pot robot1 pot1 sink1 robot2)", "(fill-pot robot2 pot2 sink2 clock)", "(tick robot1)",
    *["(pass robot1 robot2)", "(pass robot2 clock)", "(tick robot1)"] * 3,
    "(creation-fill-pot-0-2 pot2 sink2 water1)", "(creation-fill-pot-0-2 pot1 sink1 water2)",
    "(go-on)",
    "(pick-up-container robot1 pot1 sink1 robot2)", "(pass robot2 clock)", "(tick robot1)",
    "(move robot1 sink1 table1 robot2)", "(pass robot2 clock)", "(tick robot1)",
    "(fill-bowl robot1 water2 pot1 bowl1 table1 robot2)", "(pass robot2 clock)", "(tick robot1)",
    "(finish robot1 water2 bowl1)",
])  # fmt: skip
