"""A task: a domain, a problem, the number of seats and a timing profile, as one value."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

from robotouille.domain.checks.domain_checks import check_domain
from robotouille.domain.checks.problem_checks import check_problem
from robotouille.domain.extends import FileKind, by, each, read_extending, union
from robotouille.domain.files import is_file, read_model, validate
from robotouille.domain.schema import (
    Delayed,
    DomainFile,
    EffectDef,
    ProblemFile,
    PublishedDefaults,
    Repetitive,
)
from robotouille.domain.shipped_names import instance_names
from robotouille.domain.wildcards import resolve_wildcards
from robotouille.errors import Fault, FileError, did_you_mean
from robotouille.resources import data_folder

__all__ = [
    "DOMAIN_FILES",
    "Task",
    "Timing",
    "TimingProfile",
    "build_task",
    "complete_domain",
    "read_domain",
]


class Timing(StrEnum):
    """The two timing profiles; see `TimingProfile`."""

    BENCHMARK = "benchmark"
    PEOPLE = "people"


@dataclass(frozen=True, slots=True)
class TimingProfile:
    """How steps translate into a kitchen's time.

    `delay_factor` multiplies every delay; `steps_per_tile` is the duration of walking one tile;
    `repeat_steps` is how long one performance of a repeated action (a cut) takes.
    """

    delay_factor: int
    steps_per_tile: int
    repeat_steps: int


PROFILES = {
    Timing.BENCHMARK: TimingProfile(delay_factor=1, steps_per_tile=0, repeat_steps=1),
    Timing.PEOPLE: TimingProfile(delay_factor=5, steps_per_tile=1, repeat_steps=2),
}


@dataclass(frozen=True)
class Task:
    """Everything that determines an episode but the players' actions.

    `digest` is the content hash (32 hex digits) of all that follows: equal digests, equal world.
    """

    name: str
    domain: DomainFile
    problem: ProblemFile
    seats: int
    timing: Timing = Timing.BENCHMARK
    source: str = field(default="", compare=False)

    @property
    def profile(self) -> TimingProfile:
        """What `timing` does to delays, walks and repeated actions."""
        return PROFILES[self.timing]

    @property
    def folder(self) -> Path | None:
        """Where its problem file lies; None for a task that was not read from a file."""
        source = Path(self.source)
        return source.parent if is_file(source) else None

    @property
    def goal_description(self) -> str:
        """The goal in words, as the problem has it."""
        return self.problem.goal_description

    def instances(self) -> tuple[str, ...]:
        """The names of its generated instances, by their seeds; `load_task` loads them.

        There are none of a task that is not shipped.
        """
        return instance_names(self.name)

    @cached_property
    def json(self) -> dict[str, Any]:
        """What `to_json` gives, made once; not to be changed."""
        return self.to_json()

    @cached_property
    def digest(self) -> str:
        """The content hash, 32 hex digits."""
        text = json.dumps(self.json, sort_keys=True, separators=(",", ":"))
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """The task as JSON values; `Task.from_json` reads it back."""
        return {
            "name": self.name,
            "domain": self.domain.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "problem": self.problem.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "seats": self.seats,
            "timing": self.timing.value,
        }

    @staticmethod
    def from_json(raw: Any, source: str = "task") -> Task:
        """A task from `to_json`'s output.

        Args:
            source: What errors call it, and its name where it has none.

        Raises:
            FileError: It is no task; the error lists what is wrong with it.
        """
        if not isinstance(raw, dict) or {"domain", "problem"} - raw.keys():
            raise FileError(source, [Fault("", "expected an object with 'domain' and 'problem'")])
        timings = [t.value for t in Timing]
        if raw.get("timing", Timing.BENCHMARK) not in timings:
            found = raw["timing"]
            raise FileError(
                source, [Fault("timing", f"expected one of {timings}, found {found!r}")]
            )
        return build_task(
            str(raw.get("name", source)),
            validate(raw["domain"], DomainFile, f"{source}: domain"),
            validate(raw["problem"], ProblemFile, f"{source}: problem"),
            seats=raw.get("seats"),
            timing=Timing(raw.get("timing", Timing.BENCHMARK)),
            source=source,
        )


def build_task(
    name: str,
    domain: DomainFile,
    problem: ProblemFile,
    *,
    seats: int | None = None,
    timing: Timing = Timing.BENCHMARK,
    seed: int = 0,
    source: str = "task",
) -> Task:
    """Check the parts against one another and put them together; FileError lists all faults."""
    domain = complete_domain(domain)
    problem = resolve_wildcards(problem, domain, seed)
    faults = _domain_faults(_Same(domain)) or check_problem(problem, domain)
    errors = [fault for fault in faults if fault.severity == "error"]
    if errors:  # What else is not right may be their cause.
        raise FileError(source, [*errors, *(fault for fault in faults if fault not in errors)])
    players = sum(len(problem.objects.get(kind, ())) for kind in domain.player_types)
    allowed = problem.seats or (players,)
    if seats is None:
        seats = allowed[0]
    if seats not in allowed:
        counts = ", ".join(map(str, allowed))
        raise FileError(source, [Fault("seats", f"{seats} seats asked for; possible: {counts}")])
    return Task(name, domain, problem, seats, timing, source)


class _Same:
    """A domain as a key: the same object, which is quicker than an equal one."""

    def __init__(self, domain: DomainFile) -> None:
        self.domain = domain

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.domain is other.domain

    def __hash__(self) -> int:
        return id(self.domain)


@lru_cache(maxsize=4)
def _domain_faults(same: _Same) -> list[Fault]:
    """What is wrong with a domain; hundreds of tasks are built with one. Not to be changed."""
    return check_domain(same.domain)


def complete_domain(domain: DomainFile) -> DomainFile:
    """Fill in what a domain of the published dialect (1.x) leaves unsaid."""
    if domain.layout is not None:
        return domain
    path = data_folder("domains") / "published_defaults.json"
    defaults = read_model(path, PublishedDefaults)
    known = {predicate.name for predicate in domain.predicate_defs}
    layout = []
    for rule in defaults.layout:
        if rule.predicate in known:
            unless = None if rule.unless is None else tuple(n for n in rule.unless if n in known)
            layout.append(rule.model_copy(update={"unless": unless}))
    actions = []
    for action in domain.action_defs:
        key = defaults.delays.get(action.name)
        sfx = tuple(_with_config(e, key.config, key.default) for e in action.sfx) if key else None
        update: dict[str, Any] = {} if sfx is None else {"sfx": sfx}
        if action.name in defaults.travel and action.travel is None:
            update["travel"] = defaults.travel[action.name]
        actions.append(action.model_copy(update=update))
    update = {"layout": tuple(layout), "action_defs": tuple(actions), "kinds": defaults.kinds}
    return domain.model_copy(update=update)


def _with_config(effect: EffectDef, config: str, default: int) -> EffectDef:
    update: dict[str, Any] = {"sfx": tuple(_with_config(e, config, default) for e in effect.sfx)}
    if isinstance(effect, Delayed | Repetitive) and effect.config is None:
        update |= {"config": config, "default": default}
    return effect.model_copy(update=update)


DOMAIN_FILES = FileKind(
    DomainFile,
    folder="domains",
    shipped=".json",
    beside=".json",
    merge=each(
        object_types=union,
        player_types=union,
        station_types=union,
        kinds=each(fields=union),
        predicate_defs=by("name"),
        action_defs=by("name"),
        layout=by("predicate"),
    ),
    keys=(("predicate_defs", "name"), ("action_defs", "name"), ("layout", "predicate")),
    complete=complete_domain,
    check=check_domain,
)


@cache
def _shipped_domain(path: Path) -> DomainFile:
    return read_extending(path, DOMAIN_FILES)


def read_domain(name: str, beside: Path | None = None) -> DomainFile:
    """The domain called `name`: a file beside the problem, a path, or one that is shipped."""
    shipped = data_folder("domains") / f"{name}.json"
    candidates = [Path(name)] if name.endswith(".json") else []
    if beside is not None:
        candidates += [beside / name, beside / f"{name}.json"]
    for path in candidates:
        if is_file(path):
            return read_extending(path, DOMAIN_FILES)
    if is_file(shipped):
        return _shipped_domain(shipped)
    names = [p.stem for p in data_folder("domains").glob("*.json") if "." not in p.stem]
    known = did_you_mean(name, names)
    raise FileError(name, [Fault("domain", f"there is no domain {name!r}{known}")])
