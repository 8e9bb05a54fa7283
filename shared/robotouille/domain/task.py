"""Tasks: a domain, a problem, the number of seats and a timing profile."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

from robotouille.domain.domain_checks import check_domain
from robotouille.domain.json_files import read_model, validate
from robotouille.domain.problem_checks import check_kinds, check_problem
from robotouille.domain.related_files import (
    FileKind,
    by,
    check_is_inside,
    each,
    files_within,
    read_extending,
    union,
)
from robotouille.domain.schema import (
    Arrival,
    Arrivals,
    CountedEffect,
    DomainFile,
    EffectDef,
    ObjectDef,
    ProblemFile,
    PublishedDefaults,
)
from robotouille.errors import Fault, FileError, did_you_mean
from robotouille.files.reading import is_file
from robotouille.installation import data_folder, instance_names


def resolve_wildcards(problem: ProblemFile, domain: DomainFile, seed: int) -> ProblemFile:
    """Replace kinds that a problem leaves open by kinds that the seed chooses.

    A kind is open if it is the name of a type for which the domain lists `kinds`.
    """
    generator = random.Random(seed)
    objects = {
        kind: tuple(_resolve(thing, kind, domain, generator) for thing in things)
        for kind, things in problem.objects.items()
    }
    return (
        problem if objects == problem.objects else problem.model_copy(update={"objects": objects})
    )


def _resolve(
    thing: ObjectDef, kind: str, domain: DomainFile, generator: random.Random
) -> ObjectDef:
    kinds = domain.kinds.get(kind)
    if thing.name != kind or not kinds:
        return thing
    return thing.model_copy(update={"name": generator.choice(kinds)})


def draw_orders(problem: ProblemFile, seed: int) -> ProblemFile:
    """Replace random arrivals of a shift by the orders that the seed draws."""
    shift = problem.shift
    if shift is None or not isinstance(shift.arrivals, Arrivals):
        return problem
    generator = random.Random(seed)
    orders: list[Arrival] = []
    at, dishes = shift.arrivals.first, list(shift.menu)
    while at < shift.steps or not orders:
        orders.append(Arrival(at=at, dish=generator.choice(dishes)))
        at += generator.randint(*shift.arrivals.every)
    # The points of planner bots are for the orders of seed 0.
    stale: dict[str, object] = {"planner": {}, "planner_people": {}} if seed else {}
    drawn = shift.model_copy(update={"arrivals": tuple(orders), **stale})
    return problem.model_copy(update={"shift": drawn})


class Timing(StrEnum):
    """The two timing profiles; see `TimingProfile`."""

    BENCHMARK = "benchmark"
    PEOPLE = "people"


@dataclass(frozen=True, slots=True)
class TimingProfile:
    """Durations of a task, in steps.

    Attributes:
        delay_factor: Factor of every delay.
        steps_per_tile: Duration of walking one tile; 0 if every walk takes one step.
        repeat_steps: Duration of one performance of a repeated action, such as a cut.
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
    """Everything that determines an episode except the players' actions.

    `source` is the path of the problem file, or a name for errors. `seeded` is True if the seed has
    chosen kinds of objects or orders; otherwise, the task is the same for all seeds.
    """

    name: str
    domain: DomainFile
    problem: ProblemFile
    seats: int
    timing: Timing = Timing.BENCHMARK
    source: str = field(default="", compare=False)
    seeded: bool = field(default=False, compare=False)

    @property
    def profile(self) -> TimingProfile:
        """The durations of the timing profile."""
        return PROFILES[self.timing]

    @property
    def folder(self) -> Path | None:
        """Folder of the problem file; None for a task that was not read from a file."""
        source = Path(self.source)
        return source.parent if is_file(source) else None

    @property
    def goal_description(self) -> str:
        """The problem's description of the goal."""
        return self.problem.goal_description

    def instances(self) -> tuple[str, ...]:
        """Return the names of the task's generated instances, sorted by seed, for `load_task`.

        Only shipped tasks have instances.
        """
        return instance_names(self.name)

    @cached_property
    def json(self) -> dict[str, Any]:
        """The cached result of `to_json`; do not modify it."""
        return self.to_json()

    @cached_property
    def digest(self) -> str:
        """Hash of the content, 32 hex digits. Tasks with equal digests have equal worlds."""
        text = json.dumps(self.json, sort_keys=True, separators=(",", ":"))
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """Return the task as JSON values for `from_json`."""
        return {
            "name": self.name,
            "domain": self.domain.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "problem": self.problem.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "seats": self.seats,
            "timing": self.timing.value,
        }

    @staticmethod
    def from_json(raw: Any, source: str = "task") -> Task:
        """Build a task from the result of `to_json`.

        Args:
            raw: JSON values from any source; they are checked.
            source: Name of the task in errors, and its name if it has none.

        Raises:
            FileError: The values are invalid; the error lists all faults.
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
    """Check a domain and a problem, also against each other, and build a task.

    Raises:
        FileError: They are invalid; the error lists all faults.
    """
    domain = complete_domain(domain)
    resolved = draw_orders(resolve_wildcards(problem, domain, seed), seed)
    seeded, problem = resolved is not problem, resolved
    faults = _domain_faults(_ByIdentity(domain)) or check_problem(problem, domain)
    errors = [fault for fault in faults if fault.severity == "error"]
    if errors:  # Unknown kinds and warnings follow because they may explain the errors.
        faults = [*(f for f in faults if f not in errors), *check_kinds(problem, domain)]
        raise FileError(source, [*errors, *faults])
    players = sum(len(problem.objects.get(kind, ())) for kind in domain.player_types)
    allowed = problem.seats or (players,)
    if seats is None:
        seats = allowed[0]
    if seats not in allowed:
        counts = ", ".join(map(str, allowed))
        # The file is right and the request wrong, so the error has the task's name, not its path.
        raise FileError(
            name, [Fault("seats", f"the task does not support {seats} seats; possible: {counts}")]
        )
    return Task(name, domain, problem, seats, timing, source, seeded)


class _ByIdentity:
    """Cache key that compares domains by identity, because comparing their contents is slow."""

    def __init__(self, domain: DomainFile) -> None:
        self.domain = domain

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and self.domain is other.domain

    def __hash__(self) -> int:
        return id(self.domain)


@lru_cache(maxsize=4)
def _domain_faults(key: _ByIdentity) -> list[Fault]:
    """Return a domain's faults, cached because one domain is often used for hundreds of tasks."""
    return check_domain(key.domain)


def complete_domain(domain: DomainFile) -> DomainFile:
    """Add layout, delays, walks and kinds to a domain of the published dialect (1.x).

    The published simulator has them in its code; docs/decisions/0003-layout-and-delays-are-data.md.
    """
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
    if isinstance(effect, CountedEffect) and effect.config is None:
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
    """Read a domain by name: a path, a file next to the problem, or a shipped domain.

    Raises:
        FileError: There is no such domain, or it is invalid.
    """
    candidates = [Path(name)] if name.endswith(".json") else []
    if beside is not None:
        candidates += [beside / name, beside / f"{name}.json"]
    return _first_domain(name, filter(is_file, candidates))


def domain_named_in(problem: Path, name: str | None) -> DomainFile:
    """Read the domain that a problem file names: a file in its folder, or a shipped domain.

    Problem files are exchanged, so their names must not lead to other files of the machine.

    Raises:
        FileError: There is no such domain, or it is invalid.
    """
    name = name or "robotouille"
    check_is_inside(name, problem, "domain")
    candidates = [problem.parent / name, problem.parent / f"{name}.json"]
    folders = (problem.parent, data_folder("domains"))
    return _first_domain(name, files_within(candidates, folders))


def _first_domain(name: str, files: Iterable[Path]) -> DomainFile:
    """Read the first file or, without one, the shipped domain."""
    for path in files:
        return read_extending(path, DOMAIN_FILES)
    shipped = data_folder("domains") / f"{name}.json"
    if is_file(shipped):
        return _shipped_domain(shipped)
    names = [p.stem for p in data_folder("domains").glob("*.json") if "." not in p.stem]
    known = did_you_mean(name, names)
    raise FileError(name, [Fault("domain", f"unknown domain {name!r}{known}")])
