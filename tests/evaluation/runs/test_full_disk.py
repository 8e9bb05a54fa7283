"""Full disk during a run: no truncated files, and the run can be resumed."""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.agents.proposal import Exchange, ExchangeVerdict
from robotouille_evaluation.cli.bot import _transcript
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.models import (
    Completion,
    Message,
    Model,
    ModelRequest,
    ScriptedModel,
    SeededAnswers,
)
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import (
    AgentSpec,
    EpisodeJob,
    JobOptions,
    RunFolder,
    Workers,
    plan_jobs,
    run_jobs,
)
from robotouille_evaluation.runs.journal import append_line
from tests.support.runs import row_of, small_pack, started_run

TASK = "synchronous/01_cheese_sandwich"
MODEL = AgentSpec(name="m", kind="model", strategy="react-none", model="mock")


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Limit the size of files, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def pack() -> Pack:
    return small_pack(TASK)


def created(path: Path, seeds: int = 1) -> tuple[RunFolder, tuple[EpisodeJob, ...]]:
    planned = tuple(plan_jobs(pack(), [MODEL], pack().instances, JobOptions(seeds=range(seeds))))
    return started_run(path, pack(), *planned), planned


class Counting:
    """Mock that counts its requests and repeats its answer to a repeated request."""

    name = "mock"

    def __init__(self) -> None:
        self.asked = 0

    async def complete(self, request: ModelRequest) -> Completion:
        self.asked += 1
        return await ScriptedModel(SeededAnswers(5)).complete(request)


def test_lines_are_written_completely_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    with FileIO(path, "ab") as file:
        append_line(file, b"x" * 999 + b"\n")
        with files_of_at_most(1500), pytest.raises(OSError):
            append_line(file, b"y" * 999 + b"\n")
        assert path.read_bytes() == b"x" * 999 + b"\n"
        append_line(file, b"z\n")
    assert path.read_bytes().splitlines() == [b"x" * 999, b"z"]


def test_paid_calls_are_kept_while_there_is_space(tmp_path: Path) -> None:
    whole = Counting()
    folder, (job,) = created(tmp_path / "whole")
    wanted = row_of(folder, pack(), job, whole)
    folder, (job,) = created(tmp_path / "full")
    model = Counting()
    with files_of_at_most(1500):
        row = row_of(folder, pack(), job, model)
    assert row.outcome.ended_by == "error" and "cannot be written" in str(row.error)
    lines = folder.calls(job, "robot1").read_bytes()
    kept = len(lines.splitlines())
    assert lines.endswith(b"\n") and 0 < kept == model.asked - 1
    again = row_of(folder, pack(), job, model)
    assert again == wanted
    assert model.asked == whole.asked + 1, "only the answer that was not stored is asked for twice"


@pytest.mark.slow
def test_rows_are_not_truncated_and_the_run_resumes(tmp_path: Path) -> None:
    folder, planned = created(tmp_path, seeds=6)
    finished: list[ResultRow] = []

    async def make(job: EpisodeJob) -> Model:
        return ScriptedModel(SeededAnswers(job.seed))

    def go_on() -> None:
        left = [job for job in planned if job.id not in folder.finished()]
        running = run_jobs(
            folder, pack(), left, Workers(calls=1), make, lambda _, row: finished.append(row)
        )
        asyncio.run(running)

    with files_of_at_most(5000), pytest.raises(BaseExceptionGroup) as stopped:
        go_on()
    assert stopped.group_contains(FileError, match=r"rows\.jsonl: .*cannot be written")
    done = len(folder.finished())
    assert 0 < done < 6
    assert (tmp_path / "rows.jsonl").read_bytes().endswith(b"\n")
    go_on()
    assert len(folder.finished()) == len(finished) == 6
    assert all(row.error is None for row in folder.rows()[done:])


def test_damaged_journal_ends_one_episode(tmp_path: Path) -> None:
    folder, (one, other) = created(tmp_path, seeds=2)
    calls = folder.calls(one, "robot1")
    calls.parent.mkdir()
    calls.write_text("what is this?\n")
    rows = [row_of(folder, pack(), job, Counting()) for job in (one, other)]
    assert "not a model call" in str(rows[0].error)
    assert rows[1].error is None


def test_bot_continues_without_transcript(capsys: pytest.CaptureFixture[str]) -> None:
    exchange = Exchange(
        ModelRequest((Message("user", "x"),)), Completion("y"), ExchangeVerdict.ACTION
    )
    with _transcript(Path("/dev/full")) as record:
        record(exchange)
        record(exchange)
    assert capsys.readouterr().err.count("/dev/full: not written") == 2
