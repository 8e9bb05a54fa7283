"""A run on the disk: its plan, a row for each episode that is over, recordings, paid calls.

RUN/run.json            the plan, and the pack by its digest
RUN/rows.jsonl          a row an episode, on the disk before the next one is begun
RUN/recordings/JOB.rbt
RUN/calls/JOB-PLAYER.jsonl   see `journal`
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille.domain.files import whole_file
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
    """Where the pack lies. On the disk it is relative to the run, if the pack is in its folder:
    a run may be moved."""
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
            written = plan.model_copy(update={"pack_folder": _relative(plan.pack_folder, path)})
            beside.write_text(written.model_dump_json(indent=1), encoding="utf-8")
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
        """What the run consists of; the folder of its pack is absolute."""
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
        where = str(self.path.resolve() / plan.pack_folder)
        return plan.model_copy(update={"pack_folder": where})

    @contextmanager
    def playing(self) -> Iterator[None]:
        """While this process plays the run, no other one does: calls would be paid for twice. (On
        Windows nobody is kept out.)

        Raises:
            RobotouilleError: Another process is playing it.
        """
        if sys.platform == "win32":
            yield
            return
        import fcntl

        try:
            descriptor = os.open(self._plan_file, os.O_RDONLY)
        except OSError as error:
            raise _unreadable(self._plan_file, error) from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError:
            raise RobotouilleError(f"{self.path} is being played by another process") from None
        finally:
            os.close(descriptor)

    def finished(self) -> dict[str, EpisodeRow]:
        """The rows of the episodes that are over, by job, without one that was torn. Nothing on
        the disk is changed: the run may be going on."""
        if not self._rows_file.exists():
            return {}
        return {row.job: row for row in read_rows(self._rows_file)}

    def rows(self) -> list[EpisodeRow]:
        """The rows of the episodes that are over."""
        return list(self.finished().values())

    def add(self, row: EpisodeRow) -> None:
        """One more is over; it is on the disk when this returns."""
        line = row.model_dump_json().encode() + b"\n"
        try:
            with FileIO(self._rows_file, "ab+") as file:
                _end_line(file)
                append_line(file, line)
        except OSError as error:
            raise _unwritable(self._rows_file, error) from None

    def write(self, path: Path, content: bytes) -> None:
        """A whole file, or none."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(path, text=False) as file:
                file.write(content)
        except OSError as error:
            raise _unwritable(path, error) from None

    def calls(self, job: Job, player: str) -> Path:
        """The file of the paid calls of one player of a job."""
        return self.path / "calls" / f"{job.id}-{player}.jsonl"

    def recording(self, job: Job, trial: int = 1) -> Path:
        """The file of a job's recording; of the last trial, where there are several."""
        suffix = "" if trial == 1 else f"-trial{trial}"
        return self.path / "recordings" / f"{job.id}{suffix}.rbt"


def _end_line(file: FileIO) -> None:
    """The next row begins on a line of its own: a torn one is cut off, a whole one is ended."""
    size = file.seek(0, os.SEEK_END)
    if size == 0:
        return
    file.seek(size - 1)
    if file.read(1) == b"\n":
        return
    file.seek(0)
    content = file.readall()
    last = content.rfind(b"\n") + 1
    try:
        EpisodeRow.model_validate_json(content[last:])
    except ValidationError:
        file.truncate(last)
    else:
        append_line(file, b"\n")


def _relative(pack_folder: str, run: Path) -> str:
    """The folder of a pack, relative to the run's if it is in it."""
    inside = Path(pack_folder).is_relative_to(run.resolve())
    return Path(pack_folder).relative_to(run.resolve()).as_posix() if inside else pack_folder


def _unreadable(path: Path, error: OSError) -> FileError:
    return FileError(str(path), [Fault("", f"cannot be read: {error.strerror or error}")])


def _unwritable(path: Path, error: OSError) -> FileError:
    return FileError(str(path), [Fault("", f"cannot be written: {error.strerror or error}")])
