"""Random small domains and problems, with all kinds of effects nested in each other.

Actions speak of an agent `a`, a spot `s`, and things `t` and `u`; created things are `n0`, `n1`, …
"""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from robotouille import Task, Timing
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task

__all__ = ["tasks"]

Json = dict[str, Any]

TYPES = {"a": "agent", "s": "spot", "t": "thing", "u": "thing"}
PREDICATES = {
    "isbot": ["agent"],
    "ispeg": ["spot"],
    "iscube": ["thing"],
    "ischip": ["thing"],
    "at": ["agent", "spot"],
    "on": ["thing", "spot"],
    "bare": ["spot"],
    "idle": ["agent"],
    "red": ["thing"],
    "big": ["thing"],
    "near": ["thing", "thing"],
    "alarm": [],
}


@st.composite
def conditions(draw: st.DrawFn, scope: dict[str, str], most: int = 3, least: int = 0) -> list[Json]:
    """Draw predicates over the parameters in scope, each true or false."""
    usable = {
        name: types
        for name, types in PREDICATES.items()
        if all(kind in scope.values() for kind in types)
    }
    found = []
    for _ in range(draw(st.integers(least, most))):
        name = draw(st.sampled_from(sorted(usable)))
        pools = [[p for p, k in scope.items() if k == kind] for kind in usable[name]]
        found.append(
            {
                "predicate": name,
                "params": [draw(st.sampled_from(pool)) for pool in pools],
                "is_true": draw(st.booleans()),
            }
        )
    return found


@st.composite
def effects(draw: st.DrawFn, scope: dict[str, str], depth: int, names: list[str]) -> list[Json]:
    """Draw up to two effects, nested up to a depth."""
    if not depth or not scope:
        return []
    found = []
    for _ in range(draw(st.integers(0, 2))):
        kind = draw(
            st.sampled_from(["conditional", "delayed", "repetitive", "creation", "deletion"])
        )
        effect: Json = {"type": kind, "param": draw(st.sampled_from(sorted(scope)))}
        inner = scope
        if kind == "creation":
            name = names.pop(0)
            made = draw(st.sampled_from(["chip", "cube"]))
            effect["created_obj"] = {"name": made, "type": "thing", "param": name}
            inner = {**scope, name: "thing"}
        if kind == "conditional":
            effect["conditions"] = draw(conditions(scope))
        if kind in ("delayed", "repetitive"):
            effect["default"] = draw(st.integers(1 if kind == "repetitive" else 0, 2))
            if draw(st.booleans()):
                effect["config"] = f"{kind}_time"
        effect["fx"] = draw(conditions(inner, 2))
        effect["sfx"] = draw(effects(inner, depth - 1, names))
        found.append(effect)
    return found


@st.composite
def actions(draw: st.DrawFn, name: str) -> Json:
    scope = {p: TYPES[p] for p in draw(st.sets(st.sampled_from(sorted(TYPES)), min_size=0))}
    precons = draw(conditions(scope, 3, 1))
    mentioned = {p: TYPES[p] for c in precons for p in c["params"]}
    fresh = [f"n{i}" for i in range(20)]
    return {
        "name": name,
        "precons": precons,
        "immediate_fx": draw(conditions(mentioned)),
        "sfx": draw(effects(mentioned, 3, fresh)),
        "language_description": " ".join([name, *(f"{{{p}}}" for p in sorted(mentioned))]),
    }


@st.composite
def goals(draw: st.DrawFn) -> list[Json]:
    names = {"agent": ["bot", "agent"], "spot": ["peg", "spot"], "thing": ["cube", "thing", "chip"]}
    ids: dict[int, str] = {}
    terms = []
    for _ in range(draw(st.integers(1, 3))):
        predicate = draw(st.sampled_from(sorted(PREDICATES)))
        chosen = []
        for kind in PREDICATES[predicate]:
            number = draw(st.integers(1, 2)) + 10 * sorted(names).index(kind)
            ids.setdefault(number, draw(st.sampled_from(names[kind])))
            chosen.append(number)
        args = [ids[number] for number in chosen]
        terms.append({"predicate": predicate, "args": args, "ids": chosen})
    return terms


@st.composite
def tasks(draw: st.DrawFn) -> Task:
    """Draw a task with two agents, three spots and two things."""
    domain = {
        "name": "random",
        "version": "2.0",
        "object_types": ["agent", "spot", "thing"],
        "player_types": ["agent"],
        "station_types": ["spot"],
        "predicate_defs": [{"name": n, "param_types": t} for n, t in PREDICATES.items()],
        "layout": [
            {"predicate": "on", "when": "shares_tile"},
            {"predicate": "at", "when": "faces"},
            {"predicate": "bare", "unless": ["on"]},
            {"predicate": "idle", "unless": []},
        ],
        "action_defs": [draw(actions(f"act{i}")) for i in range(draw(st.integers(1, 4)))],
    }
    used = repr(domain["action_defs"])
    problem = {
        "width": 5,
        "height": 5,
        "config": {
            key: {draw(st.sampled_from(["default", "cube", "chip1", "cube2"])): 3}
            for key in ("delayed_time", "repetitive_time")
            if key in used
        },
        "objects": {
            "agent": [
                {"name": "bot", "x": 1, "y": 2, "direction": [-1, 0]},
                {"name": "bot", "x": 2, "y": 1, "direction": [0, -1]},
            ],
            "spot": [{"name": "peg", "x": x, "y": y} for x, y in [(0, 2), (2, 0), (4, 2)]],
            "thing": [
                {"name": "cube", "x": 0, "y": 2, "predicates": draw(marks())},
                {"name": "cube", "x": 2, "y": 0, "predicates": draw(marks())},
            ],
        },
        "goal": draw(goals()),
    }
    return build_task(
        "random",
        DomainFile.model_validate(domain),
        ProblemFile.model_validate(problem),
        timing=draw(st.sampled_from(list(Timing))),
    )


def marks() -> st.SearchStrategy[list[str]]:
    return st.lists(st.sampled_from(["red", "big"]), unique=True)
