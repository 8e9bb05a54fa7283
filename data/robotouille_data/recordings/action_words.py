"""What a recorded domain says of its actions: no kitchen words here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["occupied_predicates", "player_names", "workless_actions"]


def workless_actions(domain: Mapping[str, Any]) -> frozenset[str]:
    """The names of the actions that change no thing: waiting and walking."""
    return frozenset(
        action["name"]
        for action in domain.get("action_defs", ())
        if action.get("travel")
        or not (action.get("precons") or action.get("immediate_fx") or action.get("sfx"))
    )


def occupied_predicates(domain: Mapping[str, Any]) -> frozenset[str]:
    """The predicates that say that nobody stands at a station, as `vacant` does."""
    rules = domain.get("layout") or ()
    facing = {rule["predicate"] for rule in rules if rule.get("when") == "faces"}
    return frozenset(
        rule["predicate"] for rule in rules if facing.intersection(rule.get("unless") or ())
    )


def player_names(header: Mapping[str, Any]) -> list[str]:
    """The players of a recording, in the order of their seats."""
    types = set(header["task"]["domain"].get("player_types") or ("player",))
    return [name for name, _, type_ in header["tables"]["objects"] if type_ in types]
