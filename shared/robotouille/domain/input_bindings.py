"""Clicks and keys of a domain's actions, from its input file.

Every action must be possible in a window. An action that the input file does not bind gets a key
of its own, which is the same in every window.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from string import ascii_lowercase, digits
from typing import Any

from robotouille.domain.related_files import FileKind, by, each, input_path, read_extending
from robotouille.domain.schema import ActionDef, DomainFile, InputFile
from robotouille.domain.task import Task

INPUT_FILES = FileKind(
    InputFile,
    folder="domains",
    shipped=".input.json",
    beside=".input.json",
    merge=each(mouse_click_actions=by("name"), keyboard_actions=by("name")),
)

WINDOW_KEYS = frozenset("wasdehtm12345")
"""Letters that are not assigned to actions: they walk, use, explain, chat and mute in the window.

An action with such a key would take it away from the window.
"""

LETTERS = ascii_lowercase + digits
SHARED_KEY = "e"
"""Key for all actions at a station if there is no input file, and if no other key is free."""


def bindings_of(task: Task) -> InputFile:
    """Return the bindings of a task's domain, with a click or key for every action."""
    return domain_bindings(task.domain, task.folder)


def domain_bindings(domain: DomainFile, beside: Path | None = None) -> InputFile:
    """Return the bindings of a domain, which is in a folder or shipped."""
    path = input_path(domain, beside)
    if path is None:
        return _made_up(domain)
    return with_all_actions(read_extending(path, INPUT_FILES), domain)


def with_all_actions(inputs: InputFile, domain: DomainFile) -> InputFile:
    """Return an input file completed with a click or key for each action that it does not bind."""
    made_up = made_up_keys(inputs, domain)
    unnamed = _unnamed(inputs, domain)
    if not unnamed:
        return inputs
    clicks = [_click(action) for action in unnamed if action.name not in made_up]
    keys = [_on_key(a, made_up[a.name], domain) for a in unnamed if a.name in made_up]
    more = InputFile.model_validate({"mouse_click_actions": clicks, "keyboard_actions": keys})
    return InputFile(
        mouse_click_actions=inputs.mouse_click_actions + more.mouse_click_actions,
        keyboard_actions=inputs.keyboard_actions + more.keyboard_actions,
    )


def made_up_keys(inputs: InputFile, domain: DomainFile) -> dict[str, str]:
    """Return a key for each action, other than walks, that an input file does not bind.

    It is a free letter of the action's name, or else any free letter or digit.
    """
    taken = {k.input_instructions.key.casefold() for k in inputs.keyboard_actions} | WINDOW_KEYS
    keys: dict[str, str] = {}
    for action in _unnamed(inputs, domain):
        if action.travel is None:
            keys[action.name] = _free((*action.name.casefold(), *LETTERS), taken)
            taken.add(keys[action.name])
    return keys


def _free(choices: Iterable[str], taken: set[str]) -> str:
    return next((c for c in choices if c in LETTERS and c not in taken), SHARED_KEY)


def _unnamed(inputs: InputFile, domain: DomainFile) -> list[ActionDef]:
    named = {click.name for click in inputs.mouse_click_actions}
    named |= {key.name for key in inputs.keyboard_actions}
    return [action for action in domain.action_defs if action.name not in named]


def _made_up(domain: DomainFile) -> InputFile:
    """Bind walks to clicks, other actions at a station to E, and all others to the space bar."""
    walks = [action for action in domain.action_defs if action.travel is not None]
    keys = [
        _on_key(action, SHARED_KEY if _station(action, domain) else "space", domain)
        for action in domain.action_defs
        if action.travel is None
    ]
    clicks = [_click(action) for action in walks]
    return InputFile.model_validate({"mouse_click_actions": clicks, "keyboard_actions": keys})


def _click(walk: ActionDef) -> dict[str, Any]:
    target = walk.travel[1] if walk.travel else None
    return {"name": walk.name, "input_instructions": {"button": "left", "click_on": target}}


def _on_key(action: ActionDef, key: str, domain: DomainFile) -> dict[str, Any]:
    how = {"key": key, "at": _station(action, domain)}
    return {"name": action.name, "input_instructions": how}


def _station(action: ActionDef, domain: DomainFile) -> str | None:
    """Return the parameter for the station where the player is, or None."""
    types = {p.name: p.param_types for p in domain.predicate_defs}
    for condition in action.precons:
        for name, kind in zip(condition.params, types[condition.predicate], strict=True):
            if kind in domain.station_types:
                return name
    return None
