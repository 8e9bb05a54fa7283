"""A run on the disk: its plan, a row for each episode that is over, recordings, paid calls.

RUN/run.json            the plan, and the pack by its digest
RUN/rows.jsonl          a row an episode, on the disk before the next one is begun
RUN/recordings/JOB.rbt
RUN/calls/JOB-PLAYER.jsonl   see `journal`
"""

from __future__ import annotations

from io import FileIO
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille_evaluation.metrics.rows import EpisodeRow, PackId, read_rows
from robotouille_evaluation.runs.appending import append_line
from robotouille_evaluation.runs.jobs import Job

__all__ = ["RunFolder", "RunPlan"]

FORMAT = "robotouille-run/1"


class RunPlan(BaseModel):
    """What a run consists of."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: str = FORMAT
    name: str
    pack: PackId
    pack_folder: str
    jobs: tuple[Job, ...] = ()
    software: str
    steps_to_go: bool = False
    """Whether it is measured how far failed episodes were from the goal."""


class RunFolder:
    """The folder of one run. Errors are FileError, and name the file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, path: Path, plan: RunPlan) -> RunFolder:
        """A new run; RobotouilleError if there is another in the folder."""
        folder = cls(path)
        folder.require_new()
        try:
            path.mkdir(parents=True, exist_ok=True)
            beside = folder._plan_file.with_suffix(".new")
            beside.write_text(plan.model_dump_json(indent=1), encoding="utf-8")
            beside.replace(folder._plan_file)
        except OSError as error:
            raise _unwritable(path, error) from None
        return folder

    def require_new(self) -> None:
        """Raises RobotouilleError if there is a run in the folder."""
        if self._plan_file.exists():
            path = self.path
            raise RobotouilleError(
                f"{path} has a run already; `robotouille benchmark resume {path}` goes on with it"
            )

    @property
    def _plan_file(self) -> Path:
        return self.path / "run.json"

    @property
    def _rows_file(self) -> Path:
        return self.path / "rows.jsonl"

    def plan(self) -> RunPlan:
        """What the run consists of."""
        name = str(self._plan_file)
        try:
            text = self._plan_file.read_text(encoding="utf-8")
            plan = RunPlan.model_validate_json(text)
        except FileNotFoundError:
            raise FileError(name, [Fault("", "there is no run in this folder")]) from None
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(name, [Fault("", f"cannot be read: {error}")]) from None
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"]))
            raise FileError(name, [Fault(place, first["msg"])]) from None
        if plan.format != FORMAT:
            raise FileError(name, [Fault("format", f"is {plan.format}, this reads {FORMAT}")])
        return plan

    def finished(self) -> dict[str, EpisodeRow]:
        """The rows of the episodes that are over, by job. A row that was torn is dropped."""
        path = self._rows_file
        try:
            _drop_torn_line(path)
        except FileNotFoundError:
            return {}
        except OSError as error:
            raise FileError(str(path), [Fault("", f"cannot be read: {error.strerror}")]) from None
        return {row.job: row for row in read_rows(path)}

    def rows(self) -> list[EpisodeRow]:
        """The rows of the episodes that are over."""
        return list(self.finished().values())

    def add(self, row: EpisodeRow) -> None:
        """One more is over; it is on the disk when this returns."""
        line = row.model_dump_json().encode() + b"\n"
        try:
            with FileIO(self._rows_file, "ab") as file:
                append_line(file, line)
        except OSError as error:
            raise _unwritable(self._rows_file, error) from None

    def write(self, path: Path, content: bytes) -> None:
        """A whole file, or none."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            beside = path.with_suffix(".new")
            beside.write_bytes(content)
            beside.replace(path)
        except OSError as error:
            raise _unwritable(path, error) from None

    def calls(self, job: Job, player: str) -> Path:
        """The file of the paid calls of one player of a job."""
        return self.path / "calls" / f"{job.id}-{player}.jsonl"

    def recording(self, job: Job, trial: int = 1) -> Path:
        """The file of a job's recording; of the last trial, where there are several."""
        suffix = "" if trial == 1 else f"-trial{trial}"
        return self.path / "recordings" / f"{job.id}{suffix}.rbt"


def _drop_torn_line(path: Path) -> None:
    """A row is whole, or is not there: the next one begins on a line of its own."""
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole != len(content):
        with path.open("r+b") as file:
            file.truncate(whole)


def _unwritable(path: Path, error: OSError) -> FileError:
    return FileError(str(path), [Fault("", f"cannot be written: {error.strerror or error}")])
