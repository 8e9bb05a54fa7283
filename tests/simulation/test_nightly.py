"""The nightly run in a few seconds: seed after seed until the time is up, and what it says."""

from __future__ import annotations

import re
import sys
import time

import pytest

from tests.programs.simulation import runs
from tests.programs.simulation.__main__ import main
from tests.programs.simulation.runs import Progress, run_many
from tests.programs.simulation.simulation import Report, run_seed
from tests.support.sabotage import told_though_not_written

SECONDS = 0.3
FIRST = 12
"""From here on the seeds that are run are short, and the fault is soon found."""
HOURS = ["--hours", f"{SECONDS / 3600:.6f}", "--seeds", f"{FIRST}:", "--jobs", "1"]


def faulty_block(first: int, last: int) -> list[Report]:
    """The reports of some seeds of a server with a fault; it is run in other processes."""
    with pytest.MonkeyPatch.context() as patch:
        told_though_not_written(patch)
        return [run_seed(seed) for seed in range(first, last)]


def run_main(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """The exit status of the command."""
    monkeypatch.setattr(sys, "argv", ["tests.programs.simulation", *arguments])
    return main()


@pytest.mark.process
@pytest.mark.slow
def test_the_command_ends_after_its_hours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(runs, "BLOCK", 3)
    assert run_main(monkeypatch, *HOURS) == 0
    said = capsys.readouterr().out
    found = re.search(r"^(\d+) seeds, 0 failed", said, re.MULTILINE)
    assert found is not None and int(found[1]) >= 2 * runs.BLOCK, said


@pytest.mark.process
@pytest.mark.slow
def test_each_seed_is_run_once_until_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "BLOCK", 3)
    seeds: list[int] = []
    count = Progress._count

    def noted(progress: Progress, report: Report) -> None:
        seeds.append(report.seed)
        count(progress, report)

    monkeypatch.setattr(Progress, "_count", noted)
    began = time.monotonic()
    progress = run_many(FIRST, None, 1, SECONDS)
    assert time.monotonic() - began >= SECONDS
    assert sorted(seeds) == list(range(FIRST, FIRST + progress.seeds))
    assert progress.seeds >= 6
    assert progress.finish() == 0


@pytest.mark.process
@pytest.mark.slow
def test_a_seed_that_fails_is_named_and_fails_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(runs, "BLOCK", 3)
    monkeypatch.setattr(runs, "run_block", faulty_block)
    assert run_main(monkeypatch, *HOURS) == 1
    said = capsys.readouterr().out
    failed = re.findall(
        r"^seed (\d+) FAILED: python -m tests\.programs\.simulation (.+)$", said, re.M
    )
    assert failed, said
    assert f"failed: {' '.join(sorted((seed for seed, _ in failed), key=int))}\n" in said
    seed, arguments = failed[0]
    assert run_main(monkeypatch, *arguments.split()) == 0, "it fails without the fault, too"
    assert f"seed {seed}: ok" in capsys.readouterr().out
    told_though_not_written(monkeypatch)
    assert run_main(monkeypatch, *arguments.split()) == 1
    alone = capsys.readouterr().out
    assert f"seed {seed}: FAILED" in alone
    (first_fault,) = re.findall(rf"^seed {seed} FAILED.*\n    (.*)$", said, re.M)
    assert first_fault in alone
