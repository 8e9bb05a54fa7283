"""The published evaluation's settings, put together from its YAML files.

An experiment file names a base file for each group (`override /llm: base_llm`) and says what is
different; `${llm.temperature}` stands for another setting. That much of the format is read, and
`${hydra:…}`, a path of the run, stays as it is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from robotouille.domain.files import MAX_FILE_BYTES
from robotouille.errors import Fault, FileError, MissingExtraError
from robotouille_evaluation.packs.pack import Experiment

__all__ = ["read_experiment", "read_yaml"]

GROUPS = ("evaluation", "game", "llm")
REFERENCE = re.compile(r"\$\{(?!hydra:)([\w.]+)\}")
MAX_REFERENCES = 20
"""How often a setting may stand for one that stands for another."""


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file, read without constructing anything but plain values.

    Raises:
        FileError: It cannot be read, or is no mapping.
        MissingExtraError: PyYAML is not installed.
    """
    try:
        import yaml
    except ImportError:
        raise MissingExtraError("reading a published checkout", "bench") from None
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            _fail(path, f"is larger than {MAX_FILE_BYTES:,} bytes")
        value = yaml.safe_load(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        _fail(path, f"cannot be read: {error.strerror or error}")
    except (UnicodeDecodeError, ValueError, RecursionError, yaml.YAMLError) as error:
        _fail(path, f"is not YAML: {' '.join(str(error).split())}")
    if not isinstance(value, dict):
        _fail(path, f"expected settings by name, found {str(value)[:60]!r}")
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
    return Experiment(
        id=path.relative_to(conf / "experiments").with_suffix("").as_posix(),
        agent=str(game.get("agent_name")),
        tasks=tuple(tasks),
        optimal_steps=tuple(optimal),
        seeds=tuple(_list(path, evaluation, "testing_seeds", int)),
        settings=settings,
    )


def _merged(conf: Path, path: Path) -> dict[str, Any]:
    """The base files of all groups, and over them what the experiment says."""
    own = read_yaml(path)
    bases: dict[str, str] = {}
    for entry in (*_defaults(conf / "config.yaml"), *_defaults(path, own)):
        for key, base in entry.items():
            bases[str(key).removeprefix("override ").strip().removeprefix("/")] = str(base)
    settings: dict[str, Any] = {group: {} for group in GROUPS}
    for group, base in bases.items():
        if group in GROUPS:
            settings[group] = read_yaml(conf / group / f"{base}.yaml")
    changes = {key: value for key, value in own.items() if key != "defaults"}
    merged: dict[str, Any] = _over(settings, changes)
    for group in GROUPS:
        if not isinstance(merged[group], dict):
            _fail(path, f"{group}: expected settings by name")
    return merged


def _defaults(path: Path, raw: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    entries = (read_yaml(path) if raw is None else raw).get("defaults", [])
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
    def value(found: Any, depth: int) -> Any:
        if isinstance(found, dict):
            return {str(key): value(part, depth) for key, part in found.items()}
        if isinstance(found, list):
            return [value(part, depth) for part in found]
        if not isinstance(found, str):
            return found if _is_json(found) else str(found)
        whole = REFERENCE.fullmatch(found)
        if whole:
            return looked_up(whole[1], depth)
        return REFERENCE.sub(lambda match: str(looked_up(match[1], depth)), found)

    def looked_up(name: str, depth: int) -> Any:
        if depth >= MAX_REFERENCES:
            _fail(path, f"${{{name}}} stands for itself")
        found: Any = settings
        for part in name.split("."):
            if not isinstance(found, dict) or part not in found:
                _fail(path, f"${{{name}}} is no setting")
            found = found[part]
        return value(found, depth + 1)

    return {key: value(part, 0) for key, part in settings.items()}


def _is_json(found: Any) -> bool:
    """Whether JSON has such a value: dates of YAML are none, and neither is `.nan`."""
    if isinstance(found, float):
        return math.isfinite(found)
    return found is None or isinstance(found, int)


def _list(path: Path, settings: dict[str, Any], name: str, kind: type) -> list[Any]:
    found = settings.get(name, [])
    if not isinstance(found, list) or not all(type(entry) is kind for entry in found):
        _fail(path, f"evaluation.{name}: expected a list of {kind.__name__}, found {found!r}")
    return found


def _fail(path: Path, message: str) -> NoReturn:
    raise FileError(str(path), [Fault("", message)])
