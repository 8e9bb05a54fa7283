"""One row an episode: what was played, how it ended and what it cost, as JSON lines.

A row holds whatever is needed to play the episode again, and every number that the report is made
of: a report needs neither recordings nor the engine.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille.errors import Fault, FileError

__all__ = [
    "BudgetRow",
    "Counts",
    "EpisodeRow",
    "FailureRow",
    "Measures",
    "Optimum",
    "PackId",
    "RealTimeRow",
    "Result",
    "Spent",
    "read_rows",
    "write_rows",
]


class Row(BaseModel):
    """Base of all parts of a row: immutable, and unknown fields are faults."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PackId(Row):
    """Which pack the task is from; `digest` is the hash of all that is in it."""

    name: str
    version: str
    digest: str


class BudgetRow(Row):
    """How many steps an episode may take, and by which rule (`published`, `1.5 x optimum`)."""

    rule: str
    steps: int = Field(ge=0)


class Optimum(Row):
    """The fewest steps to the goal: at least `bound`, at most `steps` (None: no plan is known)."""

    steps: int | None = Field(default=None, ge=0)
    bound: int = Field(default=0, ge=0)
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
    """How the episode ended: `ended_by` is `goal`, `step_limit`, `error`, …"""

    success: bool
    steps: int = Field(ge=0)
    ended_by: str


class Counts(Row):
    """Answers that were wrong, and calls of the model; `retries` are of the transport.

    An `invalid` answer names an action of the task that does not apply; a `malformed` one names
    none.
    """

    invalid: int = Field(default=0, ge=0)
    malformed: int = Field(default=0, ge=0)
    calls: int = Field(default=0, ge=0)
    retries: int = Field(default=0, ge=0)


class Spent(Row):
    """Tokens and money of all calls together; `cost` is None where the price is not known."""

    prompt_tokens: int = Field(default=0, ge=0)
    completion_tokens: int = Field(default=0, ge=0)
    cost: float | None = Field(default=None, ge=0)


class FailureRow(Row):
    """Why an episode failed, by the taxonomy of `failures`, and the steps that show it."""

    category: str
    subcategory: str
    steps: tuple[int, ...] = ()


class Measures(Row):
    """Metrics that need the trajectory, worked out when the episode was over.

    None says that a number is not defined for this episode, or was not worked out. The functions
    of the same names define them; see docs/metrics.md.
    """

    to_go_least: float | None = None
    to_go_most: float | None = None
    out_of_reach: bool = False
    asynchronous_first: bool | None = None
    stumbles: int = 0
    recovered: int = 0
    repeated_mistakes: int = 0
    waiting_share: float | None = None
    idle_share: float | None = None
    contributions: dict[str, float] = {}
    blocked: int = 0
    overlap: float | None = None
    staleness: float | None = None
    late_answers: int = Field(default=0, ge=0)
    held_share: float | None = None
    lost_to_thinking: int | None = None
    failure: FailureRow | None = None


class EpisodeRow(Row):
    """One episode of a run.

    `job` names it in its run, and is the same when it is played again. `kind` is the kind of
    instance (`free`, `noisy`), `variant` what is changed about it (`stochastic`, `delay-free`;
    nothing if empty), `timing` the timing profile, `real_time` how the world went on by
    itself (None: it waited), `seconds` the wall time of the episode, `repetitions` its repeated
    transitions, `recording` the path of its recording beside the rows.
    `error` says why the episode could not be played to its end.
    """

    run: str
    job: str = ""
    pack: PackId
    dataset: str
    task: str
    instance: str
    kind: str = ""
    seed: int = 0
    agent: str
    strategy: str = ""
    model: str = ""
    variant: str = ""
    timing: str = "benchmark"
    clock: str = "turn"
    real_time: RealTimeRow | None = None
    seats: int = Field(default=1, ge=1)
    trial: int = Field(default=0, ge=0)
    budget: BudgetRow
    optimum: Optimum = Optimum()
    outcome: Result
    counts: Counts = Counts()
    usage: Spent = Spent()
    seconds: float = Field(default=0.0, ge=0)
    repetitions: int = Field(default=0, ge=0)
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
    def pair(self) -> tuple[str, str, str, int, int, str, str]:
        """What two agents must share for their results to be compared one by one."""
        played = self.dataset, self.task, self.instance, self.seed, self.trial
        return *played, self.variant, self.pace


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
