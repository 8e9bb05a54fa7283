"""One row an episode: what was played, how it ended and what it cost, as JSON lines.

A row holds whatever is needed to play the episode again, and every number that the report is made
of: a report needs neither recordings nor the engine.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille.errors import Fault, FileError

__all__ = [
    "MAX_NUMBER",
    "BudgetRow",
    "Category",
    "Counts",
    "EpisodeRow",
    "FailureRow",
    "Measures",
    "Optimum",
    "PackId",
    "Pair",
    "RealTimeRow",
    "Result",
    "Spent",
    "read_rows",
    "write_rows",
]

MAX_NUMBER = 2**53
"""What JSON keeps exactly everywhere, and columns of 64 bits hold."""
Number = Annotated[int, Field(ge=0, le=MAX_NUMBER)]


class Row(BaseModel):
    """Base of all parts of a row: immutable, and unknown fields are faults."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PackId(Row):
    """Which pack the task is from; `digest` is the hash of all that is in it."""

    name: str
    version: str
    digest: str


class BudgetRow(Row):
    """How many steps an episode may take, and by which rule (`published`, `own`)."""

    rule: str
    steps: Number


class Optimum(Row):
    """The fewest steps to the goal: at least `bound`, at most `steps` (None: no plan is known)."""

    steps: Number | None = None
    bound: Number = 0
    proven: bool = False


class RealTimeRow(Row):
    """How the world went on while models thought: steps a second, what a thought was charged
    (`tokens:20`, `declared:1500`), what became of late answers, and who acted meanwhile."""

    step_rate: float = Field(gt=0)
    charge: str
    late: str
    helper: str = "none"
    digest_tokens: int = Field(default=0, ge=0)

    def __str__(self) -> str:
        more = f", digest of {self.digest_tokens} tokens" if self.digest_tokens else ""
        helper = f", helper {self.helper}" if self.helper != "none" else ""
        return f"{self.step_rate:g} steps/s, {self.charge}, {self.late}{helper}{more}"


class Result(Row):
    """How the episode ended: `ended_by` is `goal`, `step-limit`, `error`, …"""

    success: bool
    steps: Number
    ended_by: str


class Counts(Row):
    """Answers that were wrong, and calls of the model; `retries` are of the transport.

    An `invalid` answer names an action of the task that does not apply; a `malformed` one names
    none.
    """

    invalid: Number = 0
    malformed: Number = 0
    calls: Number = 0
    retries: Number = 0


class Spent(Row):
    """Tokens and money of all calls together; `cost` is None where the price is not known."""

    prompt_tokens: Number = 0
    completion_tokens: Number = 0
    cost: float | None = Field(default=None, ge=0)


class Category(StrEnum):
    """Why an episode failed: the part of the decision process of which the agent was uncertain."""

    STATE = "state"
    ACTION = "action"
    TRANSITION = "transition"
    GOAL = "goal"
    OTHER = "other"
    """Nothing of the kind is to be seen: out of steps, or the run broke off."""


class FailureRow(Row):
    """Why an episode failed, by the taxonomy of `failures`, and the steps that show it."""

    category: Category
    subcategory: str
    steps: tuple[Number, ...] = ()


class Measures(Row):
    """Metrics that need the trajectory, worked out when the episode was over.

    None says that a number is not defined for this episode, or was not worked out. The functions
    of the same names define them; see docs/metrics.md.
    """

    to_go_least: float | None = None
    to_go_most: float | None = None
    out_of_reach: bool = False
    asynchronous_first: bool | None = None
    stumbles: Number = 0
    recovered: Number = 0
    repeated_mistakes: Number = 0
    waiting_share: float | None = None
    idle_share: float | None = None
    contributions: dict[str, float] = {}
    blocked: Number = 0
    overlap: float | None = None
    staleness: float | None = None
    late_answers: int = Field(default=0, ge=0)
    held_share: float | None = None
    lost_to_thinking: int | None = None
    failure: FailureRow | None = None


class Pair(NamedTuple):
    """What two agents must share for their results to be compared one by one."""

    pack: str
    dataset: str
    task: str
    instance: str
    kind: str
    seats: int
    seed: int
    variant: str
    timing: str
    clock: str
    budget: str


class EpisodeRow(Row):
    """One episode of a run.

    `job` names it in its run, and is the same when it is played again. `kind` is the kind of
    instance (`free`, `noisy`), `variant` what is changed about it (`stochastic`, `delay-free`;
    nothing if empty), `timing` the timing profile, `real_time` how the world went on by itself
    (None: it waited), `control` how a team was asked (`each` seat had a model of its own; one model
    played all of them in `turns`, or `joint`), `attempts` how often the agent began (Reflexion does
    so anew; the row is of the last time), `seconds` the wall time of the episode, `repetitions` its
    repeated transitions, `recording` the path of its recording beside the rows.
    `error` says why the episode could not be played to its end.
    """

    run: str
    job: str = ""
    pack: PackId
    dataset: str
    task: str
    instance: str
    kind: str = ""
    seed: int = Field(default=0, ge=-MAX_NUMBER, le=MAX_NUMBER)
    agent: str
    strategy: str = ""
    model: str = ""
    variant: str = ""
    timing: str = "benchmark"
    clock: str = "turn"
    real_time: RealTimeRow | None = None
    seats: int = Field(default=1, ge=1, le=MAX_NUMBER)
    control: str = "each"
    attempts: int = Field(default=1, ge=1, le=MAX_NUMBER)
    budget: BudgetRow
    optimum: Optimum = Optimum()
    outcome: Result
    counts: Counts = Counts()
    usage: Spent = Spent()
    seconds: float = Field(default=0.0, ge=0)
    repetitions: Number = 0
    recording: str | None = None
    error: str | None = None
    measures: Measures = Measures()

    @property
    def player(self) -> str:
        """Who played, in words: the agent, and strategy and model where they say more."""
        said = {self.agent, *re.split(r"[ ()]+", self.agent), ""}
        more = dict.fromkeys(p for p in (self.strategy, self.model) if p not in said)
        return " · ".join([self.agent, *more])

    @property
    def pace(self) -> str:
        """How the world went on by itself, in words; nothing if it waited for its players."""
        return f"real time: {self.real_time}" if self.real_time is not None else ""

    @property
    def pair(self) -> Pair:
        """What another agent's row must share to be compared with this one."""
        return Pair(
            pack=f"{self.pack.name} {self.pack.version} ({self.pack.digest[:12]})",
            dataset=self.dataset,
            task=self.task,
            instance=self.instance,
            kind=self.kind,
            seats=self.seats,
            seed=self.seed,
            variant=self.variant,
            timing=self.timing,
            clock=f"{self.clock} {self.pace}".strip(),
            budget=f"{self.budget.rule} ({self.budget.steps} steps)",
        )


def write_rows(rows: Iterable[EpisodeRow]) -> Iterator[str]:
    """Each row as a line of JSON, with its line end."""
    return (f"{row.model_dump_json()}\n" for row in rows)


def read_rows(path: Path) -> list[EpisodeRow]:
    """The rows of a file, one a line. A last line that was cut off by a kill is left out; of a job
    that was played again the last row counts.

    Raises:
        FileError: The file cannot be read, or a line is no row.
    """
    try:
        lines = path.read_bytes().splitlines(keepends=True)
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
        raise FileError(str(path), [fault]) from None
    found: dict[object, EpisodeRow] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            row = EpisodeRow.model_validate_json(line)
        except ValidationError as error:
            if number == len(lines) and not line.endswith(b"\n"):
                break
            first = error.errors(include_url=False)[0]
            field = ".".join(map(str, first["loc"]))
            raise FileError(str(path), [Fault(f"line {number}: {field}", first["msg"])]) from None
        found[(row.run, row.job) if row.job else number] = row
    return list(found.values())
