"""Problem files as text, laid out like the ones that are written by hand."""

from __future__ import annotations

import json
from typing import Any

from robotouille.domain.schema import ObjectDef

__all__ = ["object_json", "write_problem"]

WIDTH = 100
"""The longest line of a field that need not have a line for each of its entries."""

LISTED = ("station", "item", "container", "meal", "player")
"""The types that have lists of their own (`stations`) unless a file needs `objects`."""


def object_json(definition: ObjectDef, *, levelled: bool) -> dict[str, Any]:
    """An object as JSON values; with its stack level if it has one, or if `levelled`."""
    raw: dict[str, Any] = {"name": definition.name, "x": definition.x, "y": definition.y}
    if levelled or definition.stack_level:
        raw["stack-level"] = definition.stack_level
    if definition.direction is not None:
        raw["direction"] = list(definition.direction)
    if definition.predicates:
        raw["predicates"] = list(definition.predicates)
    if definition.id is not None:
        raw["id"] = definition.id
    return raw


def write_problem(problem: dict[str, Any]) -> str:
    """The text of a problem: an entry of a list in each line, short fields in one."""
    fields = dict(problem)
    objects = fields.get("objects")
    if objects is not None and all(kind in LISTED for kind in objects):
        fields = {}
        for name, value in problem.items():
            lists = {f"{kind}s": things for kind, things in objects.items()}
            fields.update(lists if name == "objects" else {name: value})
    lines = [f"  {_text(name)}: {_field(name, value, '  ')}" for name, value in fields.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _field(name: str, value: Any, indent: str) -> str:
    inner = f"{indent}  "
    if isinstance(value, dict) and (
        name == "objects" or len(indent) + len(name) + len(_text(value)) + 5 > WIDTH
    ):
        rows = [f"{_text(key)}: {_field(key, part, inner)}" for key, part in value.items()]
    elif isinstance(value, list) and value and isinstance(value[0], str | dict):
        rows = [_text(entry) for entry in value]
    else:
        return _text(value)
    brackets = "{}" if isinstance(value, dict) else "[]"
    body = ",\n".join(f"{inner}{row}" for row in rows)
    return f"{brackets[0]}\n{body}\n{indent}{brackets[1]}"


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
