"""The published evaluation's settings, put together from its YAML files.

An experiment file names a base file for each group (`override /llm: base_llm`) and says what is
different; `${llm.temperature}` stands for another setting. That much of the format is read, and
`${hydra:…}`, a path of the run, stays as it is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

from robotouille.errors import Fault, FileError, MissingExtraError
from robotouille_evaluation.packs.pack import Experiment
from robotouille_evaluation.packs.published.experiment_settings import setting_faults
from robotouille_evaluation.packs.published.files import read_text

__all__ = ["read_experiment", "read_yaml"]

GROUPS = ("evaluation", "game", "llm")
REFERENCE = re.compile(r"\$\{(?!hydra:)([\w.]+)\}")
MAX_REFERENCES = 20
"""How often a setting may stand for one that stands for another."""

MAX_CHARACTERS = 1_000_000
"""Of all settings of an experiment, what their references stand for included."""

MAX_DEPTH = 50
"""Levels of lists and mappings in a file."""

MAX_INTEGER = 2**63 - 1
MAX_QUOTED = 100
"""Characters of a value that an error shows."""


def read_yaml(path: Path, root: Path) -> dict[str, Any]:
    """The mapping in a YAML file below `root`, read without constructing anything but plain values.

    Raises:
        FileError: It cannot be read, leads outside, is no mapping, or has aliases: a few lines of
            them stand for more than any memory holds.
        MissingExtraError: PyYAML is not installed.
    """
    return _parsed(path, read_text(path, root))


@lru_cache(maxsize=100)
def _parsed(path: Path, text: str) -> dict[str, Any]:
    """The mapping in a text; all experiments have the same few files below theirs, which are read
    once. Not to be changed."""
    try:
        import yaml
    except ImportError:
        raise MissingExtraError("reading a published checkout", "bench") from None
    try:
        depth = 0
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if isinstance(event, yaml.AliasEvent):
                _fail(path, f"{_place(event.start_mark)}aliases (*name) are not read")
            if depth > MAX_DEPTH:
                _fail(path, f"is nested more than {MAX_DEPTH} levels deep")
        value = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        problem = " ".join(str(error.problem).split())[:MAX_QUOTED]
        _fail(path, f"{_place(error.problem_mark)}is not YAML: {problem}")
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        _fail(path, f"is not YAML: {' '.join(str(error).split())[:MAX_QUOTED]}")
    if not isinstance(value, dict):
        _fail(path, f"expected settings by name, found {type(value).__name__}")
    return value


def read_experiment(conf: Path, path: Path) -> Experiment | None:
    """The experiment in a file of the folder `conf`; None if it evaluates nothing.

    Raises:
        FileError: A file is missing or wrong.
    """
    settings = _resolved(_merged(conf, path), path)
    evaluation, game = settings["evaluation"], settings["game"]
    tasks = _list(path, evaluation, "environment_names", str)
    if not evaluation.get("evaluate") or not tasks:
        return None
    optimal = _list(path, evaluation, "optimal_steps", int)
    if len(optimal) != len(tasks):
        _fail(path, f"evaluation: {len(tasks)} tasks, but {len(optimal)} optimal_steps")
    agent = str(game.get("agent_name"))
    if faults := setting_faults(agent, settings):
        raise FileError(str(path), [Fault("", fault) for fault in faults])
    return Experiment(
        id=path.relative_to(conf / "experiments").with_suffix("").as_posix(),
        agent=agent,
        tasks=tuple(tasks),
        optimal_steps=tuple(optimal),
        seeds=tuple(_list(path, evaluation, "testing_seeds", int)),
        settings=settings,
    )


def _merged(conf: Path, path: Path) -> dict[str, Any]:
    """The base files of all groups, and over them what the experiment says."""
    own = read_yaml(path, conf)
    bases: dict[str, str] = {}
    for entry in (*_defaults(conf / "config.yaml", conf), *_defaults(path, conf, own)):
        for key, base in entry.items():
            bases[str(key).removeprefix("override ").strip().removeprefix("/")] = str(base)
    settings: dict[str, Any] = {group: {} for group in GROUPS}
    for group, base in bases.items():
        if group in GROUPS:
            settings[group] = read_yaml(conf / group / f"{base}.yaml", conf)
    changes = {key: value for key, value in own.items() if key != "defaults"}
    merged: dict[str, Any] = _over(settings, changes)
    for group in GROUPS:
        if not isinstance(merged[group], dict):
            _fail(path, f"{group}: expected settings by name")
    return merged


def _defaults(path: Path, conf: Path, raw: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    entries = (read_yaml(path, conf) if raw is None else raw).get("defaults", [])
    if not isinstance(entries, list):
        _fail(path, "defaults: expected a list")
    return [entry for entry in entries if isinstance(entry, dict)]


def _over(below: Any, above: Any) -> Any:
    """Settings with others over them, name by name; lists are replaced."""
    if not isinstance(below, dict) or not isinstance(above, dict):
        return above
    return {
        key: _over(below[key], above[key])
        if key in below and key in above
        else above.get(key, below.get(key))
        for key in {**below, **above}
    }


def _resolved(settings: dict[str, Any], path: Path) -> dict[str, Any]:
    resolver = _Resolver(settings, path)
    return {key: resolver.value(part) for key, part in settings.items()}


class _Resolver:
    """Puts in what references stand for; gives up where that is too much: each of a chain may stand
    for the next one several times."""

    def __init__(self, settings: dict[str, Any], path: Path) -> None:
        self._settings = settings
        self._path = path
        self._left = MAX_CHARACTERS

    def value(self, found: Any, references: int = 0, level: int = 0) -> Any:
        """A part of the settings, resolved; FileError if a reference leads nowhere.

        Args:
            references: How many were followed to it.
            level: How deep in the settings it is.
        """
        if level > MAX_DEPTH:
            _fail(self._path, f"is nested more than {MAX_DEPTH} levels deep")
        if isinstance(found, dict):
            return {
                self._text(key): self.value(part, references, level + 1)
                for key, part in found.items()
            }
        if isinstance(found, list):
            self._spend(len(found))
            return [self.value(part, references, level + 1) for part in found]
        if not isinstance(found, str):
            return found if _is_json(found) else self._text(found)
        self._spend(len(found))
        whole = REFERENCE.fullmatch(found)
        if whole:
            return self._looked_up(whole[1], references, level)
        return REFERENCE.sub(lambda match: str(self._looked_up(match[1], references, level)), found)

    def _looked_up(self, name: str, references: int, level: int) -> Any:
        if references >= MAX_REFERENCES:
            _fail(self._path, f"${{{name}}} stands for itself")
        found: Any = self._settings
        for part in name.split("."):
            if not isinstance(found, dict) or part not in found:
                _fail(self._path, f"${{{name}}} is no setting")
            found = found[part]
        return self.value(found, references + 1, level)

    def _text(self, found: object) -> str:
        if isinstance(found, int) and abs(found) > MAX_INTEGER:
            _fail(self._path, "has a whole number of more than 64 bits")
        text = str(found)
        self._spend(len(text) + 1)
        return text

    def _spend(self, characters: int) -> None:
        self._left -= characters
        if self._left < 0:
            _fail(self._path, f"its settings are longer than {MAX_CHARACTERS:,} characters")


def _is_json(found: Any) -> bool:
    """Whether JSON has such a value: dates of YAML are none, and neither is `.nan`."""
    if isinstance(found, float):
        return math.isfinite(found)
    return found is None or (isinstance(found, int) and abs(found) <= MAX_INTEGER)


def _list(path: Path, settings: dict[str, Any], name: str, kind: type) -> list[Any]:
    found = settings.get(name, [])
    if not isinstance(found, list) or not all(type(entry) is kind for entry in found):
        _fail(path, f"evaluation.{name}: expected a list of {kind.__name__}, found {_short(found)}")
    return found


def _place(mark: Any) -> str:
    """The line of a mark of PyYAML, which can lack it; never the line's text."""
    return "" if mark is None else f"line {mark.line + 1}: "


def _short(found: object) -> str:
    text = repr(found)
    return text if len(text) <= MAX_QUOTED else f"{text[:MAX_QUOTED]}…"


def _fail(path: Path, message: str) -> NoReturn:
    raise FileError(str(path), [Fault("", message)])
