"""Reader of `docker-compose.yml` that substitutes variables like Compose."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import yaml

from tests.support.sources import ROOT

__all__ = ["COMPOSE", "compose"]

COMPOSE = ROOT / "docker-compose.yml"
_VARIABLE = re.compile(r"\$(?:\$|\{(\w+):-([^}]*)\})")


def compose(variables: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return the file's content; missing or empty variables take their defaults."""
    given = variables or {}

    def value(found: re.Match[str]) -> str:
        return "$" if found[0] == "$$" else given.get(found[1]) or found[2]

    content: dict[str, Any] = _filled(yaml.safe_load(COMPOSE.read_text(encoding="utf-8")), value)
    return content


def _filled(node: Any, value: Any) -> Any:
    if isinstance(node, dict):
        return {key: _filled(each, value) for key, each in node.items()}
    if isinstance(node, list):
        return [_filled(each, value) for each in node]
    if isinstance(node, str):
        filled = _VARIABLE.sub(value, node)
        assert "${" not in filled, f"a variable without a default: {node}"
        return filled
    return node
