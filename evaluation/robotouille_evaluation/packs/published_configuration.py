"""Files of a checkout: examples, and the settings of experiments in YAML.

An experiment file names a base file for each group (`override /llm: base_llm`) and the differences
from it. `${llm.temperature}` refers to another setting. This part of the Hydra format is supported.
`${hydra:…}` refers to a path of the run and stays unchanged.

A checkout may come from anyone. Files outside it are never read, and sizes are limited.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

from robotouille.errors import Fault, FileError, MissingExtraError
from robotouille.files import reading
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.experiment_settings import setting_faults
from robotouille_evaluation.packs.pack import ExampleEpisode, ExampleStep


def read_text(path: Path, root: Path) -> str:
    """Return the text of a file below `root`.

    Raises:
        FileError: The path leads outside, or the file is too large, unreadable or not UTF-8.
    """
    require_inside(path, root)
    try:
        return reading.read_text(path)
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
        raise FileError(str(path), [fault]) from None
    except UnicodeDecodeError as error:
        raise FileError(str(path), [Fault("", f"is not UTF-8 text: {error.reason}")]) from None


def is_encodable(text: str) -> bool:
    """Return whether UTF-8 can encode a text, which YAML and file names do not guarantee."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def require_inside(path: Path, root: Path) -> None:
    """Raise FileError if a path leads outside `root`, following links."""
    try:
        inside = path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError, ValueError):  # circular links, or a NUL in the name
        inside = False
    if not inside:
        raise FileError(str(path), [Fault("", f"leads outside {root}")])


HEADING = re.compile(r"^Interaction \d+\n-+\n", re.MULTILINE)
OBSERVATION, REASONING = "Observation:", "\nReasoning:"
PLANS = ("\nPlan:", "\nAction:")


def parse_episode(text: str, name: str, source: str = "example") -> ExampleEpisode:
    """Return the exchanges of an example, or raise FileError if one is incomplete."""
    parts = HEADING.split(text)[1:]
    if not parts:
        raise FileError(source, [Fault("", "not an example: it has no interaction")])
    steps = []
    for number, part in enumerate(parts, start=1):
        step = _step(part)
        if step is None:
            fault = Fault(f"interaction {number}", "no observation with an answer")
            raise FileError(source, [fault])
        steps.append(step)
    return ExampleEpisode(name, tuple(steps))


def _step(part: str) -> ExampleStep | None:
    """Return an observation and its answer, or None if one is missing."""
    before, found, rest = part.partition(OBSERVATION)
    if not found:
        return None
    after = len(before) + len(OBSERVATION)
    begin = len(part) - len(rest.lstrip())
    # As in the published pattern, an answer after a blank observation counts only if no later
    # answer exists.
    end = part.find(REASONING, begin)
    if end < 0:
        end = part.find(REASONING, after)
    if end >= 0:
        return ExampleStep(part[begin:end], part[end + 1 :].rstrip())
    ends = [end for word in PLANS if (end := part.find(word, begin - 1)) >= 0]
    if not ends:
        return None
    return ExampleStep(part[begin : min(ends) + 1], part[min(ends) + 1 :].rstrip())


GROUPS = ("evaluation", "game", "llm")
REFERENCE = re.compile(r"\$\{(?!hydra:)([\w.]+)\}")
MAX_REFERENCES = 20
"""Longest chain of references."""

MAX_CHARACTERS = 1_000_000
"""Maximum number of characters of an experiment's settings with references resolved."""

MAX_DEPTH = 50
"""Deepest nesting of lists and mappings."""

MAX_EVENTS = 10_000
"""Maximum number of values, lists and mappings in a YAML file. PyYAML parses some thousand a
second."""

SEXAGESIMAL = re.compile(r"[-+]?[\d_.]*:[\d_.:]*")
MAX_NUMBER = 100
"""Maximum number of characters of a number such as `1:30:00`, whose digits PyYAML sums up one by
one."""

MAX_INTEGER = 2**63 - 1
MAX_QUOTED = 100
"""Maximum number of characters of a value in an error."""


def read_yaml(path: Path, root: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file below `root`, which may contain plain values only.

    Raises:
        FileError: The file cannot be read, leads outside, is not a mapping, is too long, or has
            aliases. A few lines of aliases can expand to more than memory can hold.
        MissingExtraError: PyYAML is not installed.
    """
    return _parsed(path, read_text(path, root))


@lru_cache(maxsize=100)
def _parsed(path: Path, text: str) -> dict[str, Any]:
    # Cached, because all experiments share a few base files. Callers must not change the result.
    try:
        import yaml
    except ImportError:
        raise MissingExtraError("reading a published checkout", "bench") from None
    try:
        depth = 0
        for number, event in enumerate(yaml.parse(text, Loader=yaml.SafeLoader)):
            if number > MAX_EVENTS:
                _fail(path, f"contains more than {MAX_EVENTS:,} values")
            if isinstance(event, yaml.ScalarEvent) and _is_endless(event.value):
                _fail(
                    path,
                    f"{_place(event.start_mark)}a number has more than {MAX_NUMBER} characters",
                )
            if isinstance(event, yaml.ScalarEvent) and not is_encodable(event.value):
                _fail(path, f"{_place(event.start_mark)}a text has a lone surrogate")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if isinstance(event, yaml.AliasEvent):
                _fail(path, f"{_place(event.start_mark)}aliases (*name) are not supported")
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


def _is_endless(text: str) -> bool:
    return len(text) > MAX_NUMBER and SEXAGESIMAL.fullmatch(text) is not None


def read_experiment(conf: Path, path: Path) -> Experiment | None:
    """Return the experiment in a file of the folder `conf`; None if it evaluates nothing.

    Raises:
        FileError: A file is missing or invalid.
    """
    settings = _resolved(_merged(conf, path), path)
    evaluation, game = settings["evaluation"], settings["game"]
    tasks = _list(path, evaluation, "environment_names", str)
    if not evaluation.get("evaluate") or not tasks:
        return None
    optimal = _list(path, evaluation, "optimal_steps", int)
    agent = str(game.get("agent_name"))
    if faults := setting_faults(agent, settings):
        raise FileError(str(path), [Fault("", fault) for fault in faults])
    try:
        return Experiment(
            id=path.relative_to(conf / "experiments").with_suffix("").as_posix(),
            agent=agent,
            tasks=tuple(tasks),
            optimal_steps=tuple(optimal),
            seeds=tuple(_list(path, evaluation, "testing_seeds", int)),
            settings=settings,
        )
    except ValueError as error:
        _fail(path, str(error))


def _merged(conf: Path, path: Path) -> dict[str, Any]:
    """Return the base settings of all groups, overridden by the experiment's."""
    own = read_yaml(path, conf)
    bases: dict[str, str] = {}
    # Later entries win, as in Hydra.
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
    """Return settings overridden by others, recursively; lists are replaced."""
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
    """Resolver of references, with a limit on the total size.

    Each setting of a chain can refer to the next one several times, so sizes can grow
    exponentially.
    """

    def __init__(self, settings: dict[str, Any], path: Path) -> None:
        self._settings = settings
        self._path = path
        self._left = MAX_CHARACTERS

    def value(self, found: Any, references: int = 0, level: int = 0) -> Any:
        """Return a part of the settings with its references resolved, or raise FileError.

        Args:
            references: Number of references followed so far.
            level: Depth in the settings.
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
        return REFERENCE.sub(lambda match: self._inserted(match[1], references, level), found)

    def _inserted(self, name: str, references: int, level: int) -> str:
        """Return what replaces a reference within a text."""
        # Python doubles the backslashes of texts in a list, so nested ones grow with each level.
        text = str(self._looked_up(name, references, level))
        self._spend(len(text))
        return text

    def _looked_up(self, name: str, references: int, level: int) -> Any:
        if references >= MAX_REFERENCES:
            _fail(self._path, f"${{{name}}} refers to itself")
        found: Any = self._settings
        for part in name.split("."):
            if not isinstance(found, dict) or part not in found:
                _fail(self._path, f"unknown setting ${{{name}}}")
            found = found[part]
        return self.value(found, references + 1, level)

    def _text(self, found: object) -> str:
        if isinstance(found, int) and abs(found) > MAX_INTEGER:
            _fail(self._path, "contains an integer of more than 64 bits")
        text = str(found)
        self._spend(len(text) + 1)
        return text

    def _spend(self, characters: int) -> None:
        self._left -= characters
        if self._left < 0:
            _fail(self._path, f"its settings are longer than {MAX_CHARACTERS:,} characters")


def _is_json(found: Any) -> bool:
    """Return whether JSON has such a scalar, unlike YAML's dates and `.nan`."""
    if isinstance(found, float):
        return math.isfinite(found)
    return found is None or (isinstance(found, int) and abs(found) <= MAX_INTEGER)


def _list(path: Path, settings: dict[str, Any], name: str, kind: type) -> list[Any]:
    found = settings.get(name, [])
    if not isinstance(found, list) or not all(type(entry) is kind for entry in found):
        _fail(path, f"evaluation.{name}: expected a list of {kind.__name__}, found {_short(found)}")
    return found


def _place(mark: Any) -> str:
    """Return the line number of a PyYAML mark, which may be missing. Never show the line's text."""
    return "" if mark is None else f"line {mark.line + 1}: "


def _short(found: object) -> str:
    text = repr(found)
    return text if len(text) <= MAX_QUOTED else f"{text[:MAX_QUOTED]}…"


def _fail(path: Path, message: str) -> NoReturn:
    raise FileError(str(path), [Fault("", message)])
