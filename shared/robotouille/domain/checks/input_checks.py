"""Cross-references of an input file: what a schema cannot see."""

from __future__ import annotations

from robotouille.domain.checks.derived import parameter_types
from robotouille.domain.checks.faults import unknown
from robotouille.domain.schema import DomainFile, InputFile
from robotouille.errors import Fault

__all__ = ["check_input"]


def check_input(inputs: InputFile, domain: DomainFile) -> list[Fault]:
    """Actions and parameters that the domain does not have."""
    faults = []
    predicates = {p.name: p for p in domain.predicate_defs}
    actions = {a.name: parameter_types(a, predicates) for a in domain.action_defs}
    clicks = [
        (f"mouse_click_actions[{i}]", c.name, "click_on", c.input_instructions.click_on)
        for i, c in enumerate(inputs.mouse_click_actions)
    ]
    keys = [
        (f"keyboard_actions[{i}]", k.name, "at", k.input_instructions.at)
        for i, k in enumerate(inputs.keyboard_actions)
    ]
    for path, name, field, parameter in [*clicks, *keys]:
        if name not in actions:
            faults.append(unknown(f"{path}.name", "action", name, actions))
        elif parameter is not None and parameter not in actions[name]:
            where = f"{path}.input_instructions.{field}"
            faults.append(unknown(where, f"parameter of {name!r}", parameter, actions[name]))
    return faults
