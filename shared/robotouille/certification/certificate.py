"""Certificates: proofs about the shortest plan of one instance that anyone can check.

    certificate = certify(task, solve, Limits(expansions=100_000))
    write_certificate(certificate, certificate_path(Path(task.source), task))
    problems = check(certificate, task)  # replays the plan; empty if valid

Replaying a plan proves its length. A bound needs another search: `prove_again`. See
docs/decisions/0012-certificates.md.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Protocol

from pydantic import BaseModel, Field

from robotouille.domain.json_files import read_model
from robotouille.domain.loading import load_task
from robotouille.domain.schema import Schema
from robotouille.domain.task import Task, Timing
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.writing import whole_file
from robotouille.planning.plan import (
    UNLIMITED,
    Limits,
    Plan,
    Proof,
    SearchResult,
    Watch,
    read_plan,
    replay,
    write_plan,
)
from robotouille.world.world import State, World

Count = Annotated[int, Field(strict=True, ge=0)]
Flag = Annotated[bool, Field(strict=True)]
ContentHash = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]


class Solver(Protocol):
    """A planner such as `robotouille.planning.solve`."""

    def __call__(
        self,
        world: World,
        start: State | None = None,
        *,
        limits: Limits = UNLIMITED,
        watch: Watch | None = None,
    ) -> SearchResult:
        """Return the shortest plan from a state, as far as the limits allow."""
        ...


class Deadline:
    """A `Limits.stop` that is true after some seconds; `struck` records whether it was true."""

    def __init__(self, seconds: float = math.inf) -> None:
        self.seconds = seconds
        self.struck = False
        self._began = time.monotonic()

    def __call__(self) -> bool:
        self.struck = self.struck or time.monotonic() - self._began >= self.seconds
        return self.struck

    def strike(self) -> None:
        """Stop now, and set `seconds` to the time that has passed."""
        self.seconds = min(self.seconds, round(time.monotonic() - self._began, 1))
        self.struck = True


class ExpansionBudget(Schema):
    """Limits of a search: expansions, states in memory and seconds. None means unlimited.

    In a certificate, `seconds` is None unless time ended the search.
    """

    expansions: Count | None = None
    states: Count | None = None
    seconds: Annotated[float, Field(ge=0)] | None = None

    def limits(self) -> Limits:
        """Return the limits of a search that begins now."""
        stop = None if self.seconds is None else Deadline(self.seconds)
        return Limits(self.expansions, self.states, stop)

    def for_seats(self, seats: int) -> ExpansionBudget:
        """Return the budget for a team: each further player divides the expansions by 20."""
        if self.expansions is None:
            return self
        # A step of a team has many more successors, so each expansion takes longer.
        spread: int = 20 ** (seats - 1)
        return self.model_copy(update={"expansions": -(-self.expansions // spread)})

    @classmethod
    def of(cls, limits: Limits) -> ExpansionBudget:
        """Return the budget of a finished search."""
        stop = limits.stop
        seconds = stop.seconds if isinstance(stop, Deadline) and stop.struck else None
        return cls(expansions=limits.expansions, states=limits.states, seconds=seconds)

    def covered_by(self, spent: ExpansionBudget) -> bool:
        """Return whether a past search with the budget `spent` makes this one needless."""
        unlimited = spent.expansions is None
        enough = unlimited or (self.expansions or math.inf) <= (spent.expansions or 0)
        same = enough and self.states == spent.states
        in_time = spent.seconds is None or (self.seconds or math.inf) <= spent.seconds
        return same and in_time


class Certificate(Schema):
    """The best known plan of an instance, and a proven lower bound on the length of every plan.

    `instance` is the content hash of the task. `start` is the digest of the plan's first state, or
    None for the initial state. `plan` has one string per step, as in plan files; it and `length`
    are None without a plan. `digest` is the hash of all other fields.
    """

    format: Literal["robotouille-certificate/1"]
    task: str
    seats: Count
    timing: Timing
    instance: ContentHash
    start: ContentHash | None
    length: Count | None
    bound: Count
    optimal: Flag
    proof: Proof
    unsolvable: Flag
    planner: str
    expansions: Count
    limits: ExpansionBudget
    plan: tuple[str, ...] | None
    digest: ContentHash

    @property
    def gap(self) -> int | None:
        """Steps between the bound and the plan; None without a plan."""
        return None if self.length is None else self.length - self.bound

    @property
    def content(self) -> str:
        """Expected value of `digest`."""
        row = self.model_dump(mode="json", exclude={"digest"})
        return content_hash(json.dumps(row, sort_keys=True).encode())


def content_hash(content: bytes) -> str:
    """Return the hash of some bytes as 32 hex digits."""
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def certify(
    task: Task,
    solver: Solver,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
    start: State | None = None,
    known: Plan | None = None,
) -> Certificate:
    """Run a planner and certify its result after replaying the plan.

    Args:
        watch: Callback of the planner.
        start: A state of the task from which to plan, by default the initial one.
        known: A plan to use if it is shorter than the planner's.

    Raises:
        RobotouilleError: The planner fails, or its result is wrong.
    """
    world = World(task) if start is None else start.world
    result = solver(world, start, limits=limits, watch=watch)
    if known is not None and (result.plan is None or len(known) < len(result.plan)):
        result = replace(result, plan=known)
    certificate = _state(result, world, limits, start)
    if problems := check(certificate, task, start):
        name = f"{task.name}@{task.seats}"
        raise RobotouilleError(f"{name}: wrong result of {result.planner}: {'; '.join(problems)}")
    return certificate


def _state(result: SearchResult, world: World, limits: Limits, start: State | None) -> Certificate:
    task, plan = world.task, result.plan
    draft = Certificate(
        format="robotouille-certificate/1",
        task=task.name,
        seats=task.seats,
        timing=task.timing,
        instance=task.digest,
        start=None if start is None else start.digest,
        length=None if plan is None else len(plan),
        bound=result.bound,
        optimal=result.optimal,
        proof=result.proof,
        unsolvable=result.unsolvable,
        planner=result.planner,
        expansions=result.expansions,
        limits=ExpansionBudget.of(limits),
        plan=None if plan is None else _lines(plan, world),
        digest="0" * 32,
    )
    return draft.model_copy(update={"digest": draft.content})


def _lines(plan: Plan, world: World) -> tuple[str, ...]:
    text = write_plan(plan, world)
    return tuple(line for line in text.splitlines() if not line.startswith("#"))


def check(certificate: Certificate, task: Task, start: State | None = None) -> list[str]:
    """Return the faults of a task's certificate, each with its field; an empty list if valid.

    Args:
        start: The expected first state of the plan; None for the initial state.
    """
    # The task's name is ignored: the same kitchen may have another name elsewhere.
    strange = _identity_faults(certificate, task, start)
    return strange or [*_claim_faults(certificate), *_plan_faults(certificate, task, start)]


def _identity_faults(certificate: Certificate, task: Task, start: State | None) -> list[str]:
    named = replace(task, name=certificate.task)
    wanted = {
        "digest": certificate.content,
        "seats": task.seats,
        "timing": task.timing,
        "instance": named.digest,
        "start": None if start is None else start.digest,
    }
    found = {field: getattr(certificate, field) for field in wanted}
    return [
        f"{field}: expected {_said(value)}, found {_said(found[field])}"
        for field, value in wanted.items()
        if found[field] != value
    ]


def _said(value: object) -> str:
    return "null" if value is None else str(value)


def _claim_faults(certificate: Certificate) -> list[str]:
    plan, length, bound = certificate.plan, certificate.length, certificate.bound
    unproven = certificate.proof is Proof.NONE
    steps = None if plan is None else len(plan)
    faults = []
    if length != steps:
        faults.append(f"length: {_said(length)}, but the plan has {_said(steps)} steps")
    if length is not None and bound > length:
        faults.append(f"bound: {bound} is greater than the length {length}")
    if certificate.optimal != (length == bound):
        faults.append(f"optimal: the length is {_said(length)} and the bound {bound}")
    if unproven and bound > 0:
        faults.append(f"proof: none, but the bound is {bound}")
    if unproven and certificate.unsolvable:
        faults.append("proof: none, but the certificate says unsolvable")
    if certificate.unsolvable and plan is not None:
        faults.append("unsolvable: true, but there is a plan")
    return faults


def _plan_faults(certificate: Certificate, task: Task, start: State | None) -> list[str]:
    if certificate.plan is None:
        return []
    world = World(task) if start is None else start.world
    try:
        plan = read_plan("\n".join(certificate.plan), world, "plan")
    except FileError as error:
        return str(error).splitlines()
    if _lines(plan, world) != certificate.plan:
        return ["plan: expected one string for each step, in the format of plan files"]
    report = replay(plan, world, start)
    return [] if report.ok else [f"plan: {report}"]


def prove_again(
    certificate: Certificate, task: Task, solver: Solver, limits: Limits = UNLIMITED
) -> bool:
    """Return whether a planner proves the certificate's bound again, and an optimal length.

    A greater bound is accepted up to the certificate's length.
    """
    anew = certify(task, solver, limits)
    if certificate.unsolvable:
        return anew.unsolvable
    if certificate.optimal and anew.length != certificate.length:
        return False
    most = math.inf if certificate.length is None else certificate.length
    contradicted = anew.unsolvable and certificate.plan is not None
    return certificate.bound <= anew.bound <= most and not contradicted


# Files


def certificate_path(problem: Path, task: Task) -> Path:
    """Return the path of a certificate next to the task's problem file.

    This is `NAME.certificate.json`, or `NAME@SEATS.certificate.json` for several players or team
    sizes.
    """
    alone = (task.problem.seats or (task.seats,)) == (1,)
    name = problem.stem if alone else f"{problem.stem}@{task.seats}"
    return problem.with_name(f"{name}.certificate.json")


def json_text(model: BaseModel) -> str:
    """Return a model as the text of a JSON file: fields in order, two spaces, a final newline."""
    return json.dumps(model.model_dump(mode="json"), indent=2, ensure_ascii=False) + "\n"


def read_certificate(path: Path) -> Certificate:
    """Return the certificate in a file without checking it.

    Raises:
        FileError: The format is invalid.
    """
    return read_model(path, Certificate)


def load_certificate(task: Task | str) -> Certificate:
    """Return the certificate next to a task's problem file.

    The certificate must be of this task; its plan is not checked (`check` replays it).

    Args:
        task: A task, or a name or path for `load_task`: `multi_agent/01@2` is for two seats.

    Raises:
        UnknownTaskError: The task does not exist.
        FileError: The certificate is missing, damaged, or of another task, timing or domain.
    """
    if not isinstance(task, Task):
        task = load_task(task)
    path = certificate_path(Path(task.source), task)
    certificate = read_certificate(path)
    if faults := _identity_faults(certificate, task, None):
        raise FileError(str(path), [Fault("", fault) for fault in faults])
    return certificate


def write_certificate(certificate: Certificate, path: Path) -> None:
    """Write a certificate atomically.

    Raises:
        FileError: The file cannot be written.
    """
    write_whole(path, json_text(certificate))


def write_whole(path: Path, text: str) -> None:
    """Write a file atomically.

    Raises:
        FileError: The file cannot be written.
    """
    try:
        with whole_file(path) as file:
            file.write(text)
    except OSError as error:
        fault = Fault("", f"cannot be written: {error.strerror or error}")
        raise FileError(str(path), [fault]) from None
