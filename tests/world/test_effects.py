"""Nested effects, creation and deletion, in a small domain for each test."""

from typing import Any

from robotouille import State, World
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task
from tests.world.kitchens import act, waiting

Json = dict[str, Any]


def fact(predicate: str, *params: str, is_true: bool = True) -> Json:
    return {"predicate": predicate, "params": list(params), "is_true": is_true}


def lab(
    *sfx: Json, more: tuple[Json, ...] = (), precons: tuple[Json, ...] = (), **fields: Any
) -> World:
    """Return a world with two cubes and an action `tap` with these effects on a cube `t`."""
    tap = {
        "name": "tap",
        "precons": [fact("iscube", "t"), *precons],
        "sfx": list(sfx),
        "language_description": "Tap {t}",
        **fields,
    }
    toggles = [
        {
            "name": f"{name}-{on}",
            "precons": [fact("iscube", "t")],
            "immediate_fx": [fact(name, "t", is_true=on == "on")],
            "language_description": f"{name} {on} {{t}}",
        }
        for name in ("red", "big")
        for on in ("on", "off")
    ]
    domain = {
        "name": "lab",
        "version": "2.0",
        "object_types": ["agent", "thing"],
        "player_types": ["agent"],
        "station_types": [],
        "predicate_defs": [
            {"name": "isbot", "param_types": ["agent"]},
            *(
                {"name": n, "param_types": ["thing"]}
                for n in ("iscube", "ischip", "red", "big", "hot")
            ),
            {"name": "near", "param_types": ["thing", "thing"]},
            {"name": "alarm", "param_types": []},
        ],
        "layout": [],
        "action_defs": [tap, *toggles, *more],
    }
    problem = {
        "width": 3,
        "height": 1,
        "objects": {
            "agent": [{"name": "bot", "x": 0, "y": 0}],
            "thing": [{"name": "cube", "x": x, "y": 0} for x in (1, 2)],
        },
        "goal": [{"predicate": "alarm", "args": [], "ids": []}],
    }
    return World(
        build_task("lab", DomainFile.model_validate(domain), ProblemFile.model_validate(problem))
    )


def delayed(default: int, *fx: Json, sfx: tuple[Json, ...] = ()) -> Json:
    return {"type": "delayed", "param": "t", "default": default, "fx": list(fx), "sfx": list(sfx)}


def conditional(*conditions: Json, fx: tuple[Json, ...] = (), sfx: tuple[Json, ...] = ()) -> Json:
    return {
        "type": "conditional",
        "param": "t",
        "conditions": list(conditions),
        "fx": list(fx),
        "sfx": list(sfx),
    }


def creation(*fx: Json, sfx: tuple[Json, ...] = ()) -> Json:
    made = {"name": "chip", "type": "thing", "param": "new"}
    return {"type": "creation", "param": "t", "created_obj": made, "fx": list(fx), "sfx": list(sfx)}


DELETION = {"type": "deletion", "param": "t"}


def names(state: State) -> list[str]:
    return [thing.name for thing in state.objects if thing.type == "thing"]


def first_step(state: State, predicate: str, *arguments: str) -> int:
    return next(n for n in range(20) if waiting(state, n).holds(predicate, *arguments))


def test_nested_delay_begins_after_the_outer_delay() -> None:
    world = lab(delayed(2, fact("red", "t"), sfx=(delayed(3, fact("big", "t")),)))
    state = act(world.initial, "tap", "cube1")
    assert first_step(state, "red", "cube1") == 2
    assert first_step(state, "big", "cube1") == 2 + 3
    assert not waiting(state, 6).timers


def test_nested_repetitions_count_after_the_delay() -> None:
    cuts = {"type": "repetitive", "param": "t", "default": 2, "fx": [fact("big", "t")]}
    world = lab(delayed(1, sfx=(cuts,)))
    state = world.initial
    for _ in range(3):
        state = act(state, "tap", "cube1")
        assert not state.holds("big", "cube1")
    assert act(state, "tap", "cube1").holds("big", "cube1")


def test_paused_conditional_pauses_nested_effects() -> None:
    inner = conditional(fact("big", "t"), sfx=(delayed(2, fact("hot", "t")),))
    world = lab(conditional(fact("red", "t"), fx=(fact("near", "t", "t"),), sfx=(inner,)))
    state = act(act(world.initial, "tap", "cube1"), "big-on", "cube1")
    assert not waiting(state, 9).holds("hot", "cube1")
    state = act(state, "red-on", "cube1")
    assert state.holds("near", "cube1", "cube1")
    state = act(state, "red-off", "cube1")
    assert not state.holds("near", "cube1", "cube1")
    assert not waiting(state, 9).holds("hot", "cube1")
    assert first_step(act(state, "red-on", "cube1"), "hot", "cube1") == 1


def test_conditional_without_nested_effects_ends_when_it_holds() -> None:
    world = lab(conditional(fact("red", "t"), fx=(fact("hot", "t"),)))
    state = waiting(act(world.initial, "tap", "cube1"), 5)
    assert state.timers
    state = act(state, "red-on", "cube1")
    assert state.holds("hot", "cube1")
    assert not state.timers
    assert act(state, "red-off", "cube1").holds("hot", "cube1")


def test_true_wins_over_false_in_one_action() -> None:
    both = [fact("red", "t", is_true=False), fact("red", "u"), fact("iscube", "u")]
    world = lab(immediate_fx=both, language_description="Tap {t} {u}")
    assert act(world.initial, "tap", "cube1", "cube1").holds("red", "cube1")


def test_predicates_without_arguments() -> None:
    world = lab(delayed(1, fact("alarm")), precons=(fact("alarm", is_true=False),))
    state = act(world.initial, "tap", "cube1")
    assert not state.goal_reached
    state = waiting(state, 1)
    assert state.goal_reached
    assert state.holds("alarm")
    assert "tap" not in [action.name for action in state.actions("bot1")]
    (unmet,) = world.unmet(state, world.action("tap", "cube1"))
    assert (str(unmet), unmet.predicate, unmet.expected) == ("must not be: alarm()", "alarm", False)


def test_deletion_removes_facts_and_effects() -> None:
    kill = {
        "name": "kill",
        "precons": [fact("iscube", "t")],
        "sfx": [DELETION],
        "language_description": "Kill {t}",
    }
    world = lab(delayed(2, fact("red", "t")), more=(kill,))
    state = act(act(world.initial, "tap", "cube1"), "big-on", "cube1")
    state = act(state, "kill", "cube1")
    assert names(state) == ["cube2"]
    assert not [atom for atom in waiting(state, 5).atoms() if "cube1" in atom]
    assert not state.timers
    assert "cube1" not in state.text()
    assert not [a for a in state.actions("bot1") if "cube1" in a.arguments]


def test_deleted_object_gets_no_new_facts_in_the_step() -> None:
    """Neither a later effect of the action nor one that ends in the same step adds facts."""
    world = lab(delayed(1, sfx=(DELETION,)), delayed(1, fact("red", "t"), fact("big", "t")))
    state = waiting(act(world.initial, "tap", "cube1"), 1)
    assert names(state) == ["cube2"]
    assert not [atom for atom in state.atoms() if "cube1" in atom]
    made = creation(fact("near", "t", "new"), fact("near", "new", "new"))
    state = act(lab(conditional(sfx=(DELETION, made))).initial, "tap", "cube1")
    assert [atom for atom in state.atoms() if atom[0] == "near"] == [("near", "chip1", "chip1")]
    world = lab(DELETION, conditional(fx=(fact("hot", "t"),), sfx=(delayed(0, fact("red", "t")),)))
    state = act(world.initial, "tap", "cube1")
    assert not [atom for atom in state.atoms() if "cube1" in atom]
    assert not state.timers


def test_effects_nested_in_a_creation_are_about_the_new_object() -> None:
    """Each nested effect is separate, also for each created object."""
    nested = ({**delayed(0, fact("red", "new")), "param": "new"}, delayed(2, fact("big", "new")))
    world = lab(creation(fact("ischip", "new"), sfx=nested))
    state = act(world.initial, "tap", "cube1")
    assert names(state) == ["cube1", "cube2", "chip1"]
    assert state.holds("red", "chip1")
    assert not state.holds("big", "chip1")
    state = act(state, "tap", "cube2")
    assert state.holds("red", "chip2")
    assert waiting(state, 1).holds("big", "chip1")
    assert not waiting(state, 1).holds("big", "chip2")
    assert waiting(state, 2).holds("big", "chip2")


def test_effects_nested_in_a_deletion_continue() -> None:
    after = delayed(1, fact("alarm"))
    near = (fact("iscube", "u"), fact("near", "t", "u", is_true=False))
    other = {**after, "param": "u"}
    world = lab({**DELETION, "sfx": [other]}, precons=near, language_description="Tap {t} {u}")
    state = act(world.initial, "tap", "cube1", "cube2")
    assert not state.holds("alarm")
    assert waiting(state, 1).holds("alarm")
