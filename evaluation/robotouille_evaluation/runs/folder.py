"""Folder of a run: its plan, a row for each finished episode, recordings and paid calls.

RUN/run.json                 plan, with the digest of the pack
RUN/rows.jsonl               one row per episode, on the disk before the next episode begins
RUN/recordings/JOB.rbt
RUN/calls/JOB-PLAYER.jsonl   see `journal`
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator

from robotouille.domain.json_files import parse_json, validate
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.drafts import drafted
from robotouille.files.reading import read_text
from robotouille.files.writing import LINK, open_own, replace_file
from robotouille_evaluation.metrics.rows import PackId, ResultRow, read_rows
from robotouille_evaluation.runs.job_list import AgentSpec, EpisodeJob
from robotouille_evaluation.runs.journal import append_line

FORMAT = "robotouille-run/1"
MAX_PLAN_BYTES = 64 << 20
DEAD_PROCESS = "a process died, perhaps for lack of memory: try again with fewer --processes"


class RunPlan(BaseModel):
    """Contents of a run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: str = FORMAT
    name: str
    pack: PackId
    pack_folder: str
    """Folder of the pack. If the run contains the pack, the file has a relative path, so that the
    run can be moved."""
    jobs: tuple[EpisodeJob, ...] = ()
    software: str
    steps_to_go: bool = False
    """Search how far failed episodes were from the goal."""

    @field_validator("jobs")
    @classmethod
    def _check_names(cls, jobs: tuple[EpisodeJob, ...]) -> tuple[EpisodeJob, ...]:
        agents: dict[str, AgentSpec] = {}
        for job in jobs:
            if agents.setdefault(job.agent.name, job.agent) != job.agent:
                raise ValueError(f"two different agents are named {job.agent.name!r}")
        return jobs


class RunFolder:
    """Folder of one run. Methods raise FileError, which names the file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, path: Path, plan: RunPlan) -> RunFolder:
        """Create a run, or raise RobotouilleError if the folder already has one."""
        folder = cls(path)
        written = plan.model_copy(update={"pack_folder": _relative(plan.pack_folder, path)})
        try:
            path.mkdir(parents=True, exist_ok=True)
            # Of two processes that begin at the same time, one fails.
            with drafted(folder._plan_file, replace=False) as draft:
                draft.write_bytes(written.model_dump_json(indent=1).encode())
        except OSError as error:
            folder.require_new()
            raise _unwritable(path, error) from None
        return folder

    def discard(self) -> None:
        """Delete the plan of a run that could not begin."""
        with suppress(OSError):
            self._plan_file.unlink()

    def require_new(self) -> None:
        """Raise RobotouilleError if the folder already has a run."""
        if self._plan_file.exists():
            path = self.path
            raise RobotouilleError(
                f"{path} already has a run; continue it with "
                f"`robotouille benchmark resume {path}`, or choose another folder for a new run"
            )

    @property
    def _plan_file(self) -> Path:
        return self.path / "run.json"

    @property
    def _rows_file(self) -> Path:
        return self.path / "rows.jsonl"

    @property
    def has_plan(self) -> bool:
        """False for the results of an evaluation with Inspect, which plans its episodes itself."""
        return self._plan_file.exists()

    def plan(self) -> RunPlan:
        """Return the plan, with an absolute path of the pack."""
        name = str(self._plan_file)
        try:
            text = read_text(self._plan_file, most=MAX_PLAN_BYTES)
        except FileNotFoundError:
            raise FileError(name, [Fault("", "this folder has no run")]) from None
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(name, [Fault("", f"cannot be read: {error}")]) from None
        plan = validate(parse_json(text, name), RunPlan, name)
        if plan.format != FORMAT:
            raise FileError(name, [Fault("format", f"expected {FORMAT!r}, found {plan.format!r}")])
        where = str(self.path.resolve() / plan.pack_folder)
        return plan.model_copy(update={"pack_folder": where})

    @contextmanager
    def playing(self) -> Iterator[None]:
        """Keep other processes from playing the run, because calls would be paid for twice.

        Windows has no such lock, and neither have results without a plan.

        Raises:
            RobotouilleError: Another process is playing it, or its rows are a link.
        """
        # Before the first episode, because its calls would be paid for in vain.
        if self._rows_file.is_symlink():
            raise FileError(str(self._rows_file), [Fault("", LINK)])
        if sys.platform == "win32" or not self.has_plan:
            yield
            return
        import fcntl

        try:
            # A lock of the kernel ends with the process, so a killed run leaves none.
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

    def finished(self) -> dict[str, ResultRow]:
        """Return the rows of finished episodes by job, without a truncated last row.

        The files stay unchanged, because the run may be in progress.
        """
        if not self._rows_file.exists():
            return {}
        return {row.job: row for row in read_rows(self._rows_file)}

    def rows(self) -> list[ResultRow]:
        """Return the rows of finished episodes."""
        return list(self.finished().values())

    def add(self, row: ResultRow) -> None:
        """Append a row and return when it is on the disk."""
        line = row.model_dump_json().encode() + b"\n"
        try:
            with FileIO(self._rows_file, "ab+", opener=open_own) as file:
                _end_line(file)
                append_line(file, line)
        except OSError as error:
            raise _unwritable(self._rows_file, error) from None

    def write(self, path: Path, content: bytes) -> None:
        """Write a file completely or not at all."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, content)
        except OSError as error:
            raise _unwritable(path, error) from None

    def calls(self, job: EpisodeJob, player: str) -> Path:
        """Return the file for the paid calls of one player of a job."""
        return self.path / "calls" / f"{job.id}-{player}.jsonl"

    def recording(self, job: EpisodeJob, trial: int = 1) -> Path:
        """Return the file for the recording of a trial of a job."""
        suffix = "" if trial == 1 else f"-trial{trial}"
        return self.path / "recordings" / f"{job.id}{suffix}.rbt"


def _end_line(file: FileIO) -> None:
    """Make the next row begin on a line of its own.

    A killed process can leave a last line without a line end. A truncated row is removed; a
    complete one gets its line end.
    """
    size = file.seek(0, os.SEEK_END)
    if size == 0:
        return
    file.seek(size - 1)
    if file.read(1) == b"\n":
        return
    file.seek(0)
    # Reading the whole file is rare: it happens only after a kill.
    content = file.readall()
    last = content.rfind(b"\n") + 1
    try:
        ResultRow.model_validate_json(content[last:])
    except ValidationError:
        file.truncate(last)
    else:
        append_line(file, b"\n")


def _relative(pack_folder: str, run: Path) -> str:
    inside = Path(pack_folder).is_relative_to(run.resolve())
    return Path(pack_folder).relative_to(run.resolve()).as_posix() if inside else pack_folder


def _unreadable(path: Path, error: OSError) -> FileError:
    return FileError(str(path), [Fault("", f"cannot be read: {error.strerror or error}")])


def _unwritable(path: Path, error: OSError) -> FileError:
    return FileError(str(path), [Fault("", f"cannot be written: {error.strerror or error}")])
