"""Rows of results as JSON lines: what was played, how it ended, and what it cost.

A row contains all that is needed to play the episode again, and every number of a report. Reports
need neither recordings nor the engine.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille.errors import Fault, FileError
from robotouille.files.reading import open_regular

MAX_NUMBER = 2**53
"""Largest integer that all JSON parsers keep exactly."""
Number = Annotated[int, Field(ge=0, le=MAX_NUMBER)]
Measure = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
"""Measured number. Sums and means of larger ones could overflow."""
MAX_NAME = 1000
Name = Annotated[str, Field(max_length=MAX_NAME)]
"""Name in a table or heading of a report. Tables take many times the memory of their texts."""
MAX_ROWS_BYTES, MAX_ROW_BYTES = 1 << 28, 1 << 17
"""Bytes of a file of rows, and of one row."""
MAX_LINES, MAX_COMMAS = 100_000, 10_000_000
"""Lines of a file of rows, and commas in them, an upper bound of their values."""


class RowModel(BaseModel):
    """Base of all parts of a row: immutable, without unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def model_post_init(self, context: object, /) -> None:
        """Forget which fields were given: these sets take half of the memory of a row."""
        object.__setattr__(self, "__pydantic_fields_set__", _NO_FIELDS)


_NO_FIELDS: set[str] = set()


class PackId(RowModel):
    """Pack of the task; `digest` is the hash of its whole content."""

    name: Name
    version: Name
    digest: Name


class BudgetRow(RowModel):
    """Step budget of an episode, and its rule (`published`, `own`, `shift`)."""

    rule: Name
    steps: Number


class Optimum(RowModel):
    """Fewest steps to the goal: at least `bound`, at most `steps` (None without a known plan)."""

    steps: Number | None = None
    bound: Number = 0
    proven: bool = False


class RealTimeRow(RowModel):
    """Real-time settings: step rate, cost of a thought, rule for late answers, and helper.

    A cost is written as `tokens:20` or `declared:1500`.
    """

    step_rate: float = Field(gt=0, le=MAX_NUMBER)
    charge: Name
    late: Name
    helper: Name = "none"
    digest_tokens: Number = 0
    max_age: Number | None = None

    def __str__(self) -> str:
        more = f", digest of {self.digest_tokens} tokens" if self.digest_tokens else ""
        helper = f", helper {self.helper}" if self.helper != "none" else ""
        late = self.late if self.max_age is None else f"{self.late} up to {self.max_age} steps"
        return f"{self.step_rate:g} steps/s, {self.charge}, {late}{helper}{more}"


class Result(RowModel):
    """Outcome of an episode; `ended_by` is the reason, such as `goal` or `step-limit`.

    A shift has a score instead of a success.
    """

    success: bool
    steps: Number
    ended_by: Name


class ScoreRow(RowModel):
    """Result of a shift: points, served and expired orders.

    `planner` are the points of planner bots in the same seats; None if they are unknown.
    """

    points: int = Field(ge=-MAX_NUMBER, le=MAX_NUMBER)
    served: Number
    expired: Number
    planner: int | None = Field(default=None, ge=-MAX_NUMBER, le=MAX_NUMBER)


class Counts(RowModel):
    """Counts of wrong answers, model calls and retried requests.

    An `invalid` answer names an inapplicable action of the task. A `malformed` answer names none.
    """

    invalid: Number = 0
    malformed: Number = 0
    calls: Number = 0
    retries: Number = 0


class TotalUsage(RowModel):
    """Tokens and cost of all calls; `cost` is None if the prices are unknown."""

    prompt_tokens: Number = 0
    completion_tokens: Number = 0
    cost: float | None = Field(default=None, ge=0, le=MAX_NUMBER)


class Category(StrEnum):
    """Cause of a failure: the part of the decision process that the agent was uncertain about."""

    STATE = "state"
    ACTION = "action"
    TRANSITION = "transition"
    GOAL = "goal"
    OTHER = "other"
    """No such uncertainty is visible: out of steps, or the run ended early."""


class FailureRow(RowModel):
    """Cause of a failure in the taxonomy of `failures`, and the steps that show it."""

    category: Category
    subcategory: Name
    steps: tuple[Number, ...] = ()


class EpisodeMeasures(RowModel):
    """Metrics that need the trajectory, computed at the end of the episode.

    None means that a metric is undefined for the episode or was not computed. Functions of the same
    names define the metrics; see docs/metrics.md.
    """

    to_go_least: Measure | None = None
    to_go_most: Measure | None = None
    out_of_reach: bool = False
    asynchronous_first: bool | None = None
    stumbles: Number = 0
    recovered: Number = 0
    repeated_mistakes: Number = 0
    waiting_share: Measure | None = None
    idle_share: Measure | None = None
    contributions: dict[Name, Measure] = {}
    blocked: Number = 0
    overlap: Measure | None = None
    staleness: Measure | None = None
    late_answers: Number = 0
    held_share: Measure | None = None
    lost_to_thinking: int | None = Field(default=None, ge=-MAX_NUMBER, le=MAX_NUMBER)
    failure: FailureRow | None = None


class Pair(NamedTuple):
    """Fields that two agents' rows must share to be compared as a pair."""

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


class ResultRow(RowModel):
    """Result of one episode of a run.

    Attributes:
        job: Identifier in the run, which is the same when the episode is played again.
        kind: Kind of instance (`free`, `noisy`).
        sampling: Parameters of the model's requests, such as `temperature 0.7`; empty for the
            endpoint's own.
        variant: Change of the task (`stochastic`, `delay-free`), if any.
        experiment: Experiment of the pack whose settings apply, if any.
        timing: Timing profile.
        real_time: Real time settings; None if the world waited.
        control: Control of a team: a model for `each` seat, or one model in `turns` or `joint`.
        score: Result of a shift; None for tasks with a goal.
        attempts: Number of trials (Reflexion starts again); the row is about the last one.
        seconds: Wall time of the episode.
        repetitions: Number of repeated transitions.
        recording: Path of the recording, relative to the run.
        error: Reason why the episode could not be played to its end.
    """

    run: Name
    job: str = ""
    pack: PackId
    dataset: Name
    task: Name
    instance: Name
    kind: Name = ""
    seed: int = Field(default=0, ge=-MAX_NUMBER, le=MAX_NUMBER)
    agent: Name
    strategy: Name = ""
    model: Name = ""
    sampling: Name = ""
    variant: Name = ""
    experiment: Name = ""
    timing: Name = "benchmark"
    clock: Name = "turn"
    real_time: RealTimeRow | None = None
    seats: int = Field(default=1, ge=1, le=MAX_NUMBER)
    control: Name = "each"
    attempts: int = Field(default=1, ge=1, le=MAX_NUMBER)
    budget: BudgetRow
    optimum: Optimum = Optimum()
    outcome: Result
    score: ScoreRow | None = None
    counts: Counts = Counts()
    usage: TotalUsage = TotalUsage()
    seconds: float = Field(default=0.0, ge=0, le=MAX_NUMBER)
    repetitions: Number = 0
    recording: str | None = None
    error: str | None = None
    measures: EpisodeMeasures = EpisodeMeasures()

    @property
    def player(self) -> str:
        """Agent, with strategy, model and sampling if the agent's name does not contain them."""
        known = {self.agent, *re.split(r"[ (),]+", self.agent), ""}
        more = list(dict.fromkeys(p for p in (self.strategy, self.model) if p not in known))
        if self.sampling not in self.agent:
            more.append(self.sampling)
        return " · ".join([self.agent, *more])

    @property
    def pace(self) -> str:
        """Real time settings in words; empty if the world waited."""
        return f"real time: {self.real_time}" if self.real_time is not None else ""

    @property
    def is_shift(self) -> bool:
        """True for a shift, even if its episode failed before it had a score."""
        return self.score is not None or self.budget.rule.startswith("shift")

    @property
    def pair(self) -> Pair:
        """Fields that a row of another agent must share to be compared with this one."""
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


def write_rows(rows: Iterable[ResultRow]) -> Iterator[str]:
    """Return an iterator over the rows as lines of JSON."""
    return (f"{row.model_dump_json()}\n" for row in rows)


def read_rows(path: Path) -> list[ResultRow]:
    """Return the rows of a file.

    A last line that a kill truncated is left out. If a job was played again, its last row counts.

    Raises:
        FileError: The file cannot be read, or a line is invalid.
    """
    found: dict[object, ResultRow] = {}
    for number, line in enumerate(_lines(path), start=1):
        if line.isspace():
            continue
        try:
            row = ResultRow.model_validate_json(line)
        except ValidationError as error:
            # Only a kill leaves a last line without a line feed; the run repeats that episode.
            if not line.endswith(b"\n"):
                break
            first = error.errors(include_url=False)[0]
            field = ".".join(map(str, first["loc"]))
            raise _fault(path, f"line {number}: {field}", first["msg"]) from None
        found[(row.run, row.job) if row.job else number] = row
    return list(found.values())


def _lines(path: Path) -> Iterator[bytes]:
    """Yield the lines of a file of rows, which may come from anyone."""
    size = commas = 0
    try:
        with open_regular(path) as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_ROW_BYTES + 1), b""), 1):
                size, commas = size + len(line), commas + line.count(b",")
                if len(line) > MAX_ROW_BYTES:
                    raise _fault(path, f"line {number}", f"is longer than {MAX_ROW_BYTES:,} bytes")
                if size > MAX_ROWS_BYTES:
                    raise _fault(path, "", f"the file is longer than {MAX_ROWS_BYTES:,} bytes")
                if number > MAX_LINES or commas > MAX_COMMAS:
                    most = f"{MAX_LINES:,} lines or {MAX_COMMAS:,} commas"
                    raise _fault(path, "", f"the file has more than {most}")
                yield line
    except OSError as error:
        raise _fault(path, "", f"cannot be read: {error.strerror or error}") from None


def _fault(path: Path, place: str, message: str) -> FileError:
    return FileError(str(path), [Fault(place, message)])
