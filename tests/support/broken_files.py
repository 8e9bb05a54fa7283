"""A small domain and problem, and ways to break them."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import FileError, Task
from robotouille.domain.json_files import validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task

__all__ = [
    "DOMAIN",
    "PROBLEM",
    "build",
    "changed",
    "condition",
    "faults_of",
    "published_domain",
    "write",
]

Json = dict[str, Any]

DOMAIN: Json = {
    "name": "small",
    "version": "2.0",
    "object_types": ["station", "item", "player"],
    "predicate_defs": [
        {"name": "istable", "param_types": ["station"]},
        {"name": "isrobot", "param_types": ["player"]},
        {"name": "iscut", "param_types": ["item"], "language_descriptors": {"0": "{0} is cut"}},
        {"name": "at", "param_types": ["item", "station"]},
        {"name": "loc", "param_types": ["player", "station"]},
    ],
    "layout": [
        {"predicate": "at", "when": "shares_tile"},
        {"predicate": "loc", "when": "faces"},
    ],
    "action_defs": [
        {
            "name": "cut",
            "precons": [
                {"predicate": "loc", "params": ["p", "s"]},
                {"predicate": "at", "params": ["i", "s"]},
            ],
            "immediate_fx": [],
            "sfx": [
                {
                    "type": "repetitive",
                    "param": "i",
                    "config": "cuts",
                    "default": 2,
                    "fx": [{"predicate": "iscut", "params": ["i"]}],
                },
                {
                    "type": "creation",
                    "param": "i",
                    "created_obj": {"name": "peel", "type": "item", "param": "n"},
                    "fx": [{"predicate": "at", "params": ["n", "s"]}],
                },
            ],
            "language_description": "Cut {i} with {p}",
        }
    ],
}

PROBLEM: Json = {
    "width": 3,
    "height": 3,
    "config": {"cuts": {"default": 2}},
    "objects": {
        "station": [{"name": "table", "x": 0, "y": 0}],
        "item": [{"name": "leek", "x": 0, "y": 0, "id": "first"}],
        "player": [{"name": "robot", "x": 0, "y": 1, "direction": [0, -1]}],
    },
    "goal": [{"predicate": "iscut", "args": ["leek"], "ids": [1]}],
}


def changed(value: Json, *path: Any, to: Any) -> Json:
    """Return a copy with one value changed, or removed if `to` is `...`."""
    result = copy.deepcopy(value)
    place = result
    for step in path[:-1]:
        place = place[step]
    if to is ...:
        del place[path[-1]]
    elif isinstance(place, list) and path[-1] == len(place):
        place.append(to)
    else:
        place[path[-1]] = to
    return result


def build(domain: Any = DOMAIN, problem: Any = PROBLEM) -> Task:
    return build_task(
        "small",
        validate(domain, DomainFile, "domain"),
        validate(problem, ProblemFile, "problem"),
        source="small.json",
    )


def faults_of(domain: Any = DOMAIN, problem: Any = PROBLEM) -> list[str]:
    """Return the messages of all faults in a domain and problem."""
    with pytest.raises(FileError) as error:
        build(domain, problem)
    assert str(error.value) == "\n".join(f"{error.value.file}: {f}" for f in error.value.faults)
    return [str(fault) for fault in error.value.faults]


def write(folder: Path, name: str, value: Any) -> str:
    path = folder / name
    path.write_text(json.dumps(value))
    return str(path)


def condition(predicate: str, *params: str, is_true: bool = True) -> dict[str, Any]:
    return {"predicate": predicate, "params": list(params), "is_true": is_true}


def published_domain() -> dict[str, Any]:
    """Return a domain in the published format, without layout, configuration keys and travel."""
    types = {
        "istable": "station", "isstove": "station", "isrobot": "player", "ispatty": "item",
        "iscooked": "item", "vacant": "station", "station_empty": "station", "clear": "item",
        "nothing": "player",
    }  # fmt: skip
    pairs = {
        "loc": ["player", "station"],
        "item_on": ["item", "station"],
        "item_at": ["item", "station"],
        "has_item": ["player", "item"],
        "atop": ["item", "item"],
    }
    return {
        "version": "1.0.0",
        "name": "published",
        "input_json": "input.json",
        "object_types": ["station", "item", "player", "container", "meal"],
        "predicate_defs": [
            *(
                {"name": n, "param_types": [k], "language_descriptors": {}}
                for n, k in types.items()
            ),
            *({"name": n, "param_types": k, "language_descriptors": {}} for n, k in pairs.items()),
        ],
        "action_defs": [
            {
                "name": "move",
                "precons": [condition("loc", "p1", "s1"), condition("vacant", "s2")],
                "immediate_fx": [
                    condition("loc", "p1", "s2"),
                    condition("loc", "p1", "s1", is_true=False),
                    condition("vacant", "s1"),
                    condition("vacant", "s2", is_true=False),
                ],
                "sfx": [],
                "language_description": "Move {p1} from {s1} to {s2}",
            },
            {
                "name": "cook",
                "precons": [condition("loc", "p1", "s1"), condition("item_on", "i1", "s1")],
                "immediate_fx": [],
                "sfx": [
                    {
                        "type": "delayed",
                        "param": "i1",
                        "fx": [condition("iscooked", "i1")],
                        "sfx": [],
                    }
                ],
                "language_description": "Cook {i1} on {s1} using {p1}",
            },
        ],
    }
