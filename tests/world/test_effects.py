"""Effects in one another, creation and deletion, in a domain made up for each test."""

import pickle
from typing import Any

from robotouille import State, World
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task
from tests.world.kitchens import act, waiting

Json = dict[str, Any]

TAP = {"name": "tap", "precons": [{"predicate": "iscube", "params": ["t"]}]}


def fact(predicate: str, *params: str, is_true: bool = True) -> Json:
    return {"predicate": predicate, "params": list(params), "is_true": is_true}


def lab(
    *sfx: Json, more: tuple[Json, ...] = (), precons: tuple[Json, ...] = (), **fields: Any
) -> World:
    """Two cubes, and an action `tap` with these effects that speak of a cube `t`."""
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


def test_a_delay_within_a_delay_begins_when_the_first_is_over() -> None:
    world = lab(delayed(2, fact("red", "t"), sfx=(delayed(3, fact("big", "t")),)))
    state = act(world.initial, "tap", "cube1")
    assert first_step(state, "red", "cube1") == 2
    assert first_step(state, "big", "cube1") == 2 + 3
    assert not waiting(state, 6).timers


def test_repetitions_within_a_delay_count_only_once_it_is_over() -> None:
    cuts = {"type": "repetitive", "param": "t", "default": 2, "fx": [fact("big", "t")]}
    world = lab(delayed(1, sfx=(cuts,)))
    state = world.initial
    for _ in range(3):
        state = act(state, "tap", "cube1")
        assert not state.holds("big", "cube1")
    assert act(state, "tap", "cube1").holds("big", "cube1")


def test_a_paused_condition_pauses_everything_in_it() -> None:
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


def test_a_condition_without_nested_effects_ends_the_first_time_it_holds() -> None:
    world = lab(conditional(fact("red", "t"), fx=(fact("hot", "t"),)))
    state = waiting(act(world.initial, "tap", "cube1"), 5)
    assert state.timers
    state = act(state, "red-on", "cube1")
    assert state.holds("hot", "cube1")
    assert not state.timers
    assert act(state, "red-off", "cube1").holds("hot", "cube1")


def test_contradictory_conditions_of_an_effect_never_hold() -> None:
    """Also where one object stands for two parameters."""
    two = (fact("near", "t", "u", is_true=False), fact("iscube", "u"))
    never = conditional(fact("red", "t"), fact("red", "u", is_true=False), fx=(fact("hot", "t"),))
    world = lab(never, precons=two, language_description="Tap {t} {u}")
    red = act(world.initial, "red-on", "cube1")
    assert not waiting(act(red, "tap", "cube1", "cube1"), 3).holds("hot", "cube1")
    assert act(red, "tap", "cube1", "cube2").holds("hot", "cube1")


def test_contradictory_preconditions_of_one_object_never_hold() -> None:
    two = (fact("red", "t"), fact("red", "u", is_true=False), fact("iscube", "u"))
    world = lab(precons=two, language_description="Tap {t} {u}")
    red = act(world.initial, "red-on", "cube1")
    same = world.action("tap", "cube1", "cube1")
    assert not world.applicable(red, same)
    assert not red.step(same).attempts[0].applied
    assert [a.sentence for a in red.actions("bot1") if a.name == "tap"] == ["Tap cube1 cube2"]


def test_true_wins_where_an_action_says_both() -> None:
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


def test_a_deleted_object_is_gone_with_its_facts_and_effects() -> None:
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


def test_nothing_becomes_true_of_an_object_deleted_in_the_same_step() -> None:
    """Neither by a later effect of the action nor by one that ends in the same step."""
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


def test_facts_that_never_change_end_with_their_object_within_one_update() -> None:
    for is_true in (True, False):
        condition = fact("iscube", "t", is_true=is_true)
        world = lab(delayed(0, sfx=(DELETION, conditional(condition, fx=(fact("alarm"),)))))
        state = act(world.initial, "tap", "cube1")
        assert names(state) == ["cube2"]
        assert state.holds("alarm") != is_true


def test_deletion_by_a_parameter_that_only_effects_mention() -> None:
    world = lab(conditional(fact("red", "u"), sfx=({"type": "deletion", "param": "u"},)))
    state = act(act(world.initial, "red-on", "cube2"), "tap", "cube1", "cube2")
    assert names(state) == ["cube1"]


def test_effects_nested_in_a_creation_are_about_the_new_object() -> None:
    """Each is an effect of its own, and each of two is another one."""
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


def test_effects_nested_in_a_creation_survive_the_journey_to_another_world() -> None:
    world = lab(creation(sfx=(delayed(2, fact("big", "new")),)))
    state = act(world.initial, "tap", "cube1")
    twin = World(world.task).restore(state.facts, state.timer_rows())
    assert twin.digest == state.digest
    assert waiting(twin, 2).holds("big", "chip1")
    assert pickle.loads(pickle.dumps(state)) == state


def test_effects_nested_in_a_deletion_go_on_without_the_object() -> None:
    after = delayed(1, fact("alarm"))
    near = (fact("iscube", "u"), fact("near", "t", "u", is_true=False))
    other = {**after, "param": "u"}
    world = lab({**DELETION, "sfx": [other]}, precons=near, language_description="Tap {t} {u}")
    state = act(world.initial, "tap", "cube1", "cube2")
    assert not state.holds("alarm")
    assert waiting(state, 1).holds("alarm")
