"""The nightly run in a few seconds: it runs seeds until its time is up and reports failures."""

from __future__ import annotations

import re
import sys

import pytest

from tests.programs.simulation import runs
from tests.programs.simulation.__main__ import main
from tests.programs.simulation.simulation import Report, run_seed
from tests.support.deliberate_faults import publish_despite_failed_writes

SECONDS = 0.3
FIRST = 12
"""First seed; the seeds that follow are short and soon find the fault."""
HOURS = ["--hours", f"{SECONDS / 3600:.6f}", "--seeds", f"{FIRST}:", "--jobs", "1"]


def faulty_block(first: int, last: int) -> list[Report]:
    """Run seeds of a faulty server in a child process and return their reports."""
    with pytest.MonkeyPatch.context() as patch:
        publish_despite_failed_writes(patch)
        return [run_seed(seed) for seed in range(first, last)]


def run_main(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """Run the command and return its exit status."""
    monkeypatch.setattr(sys, "argv", ["tests.programs.simulation", *arguments])
    return main()


@pytest.mark.process
@pytest.mark.slow
def test_failing_seed_is_reported_and_fails_alone(
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
    assert run_main(monkeypatch, *arguments.split()) == 0, "the seed fails without the fault"
    assert f"seed {seed}: ok" in capsys.readouterr().out
    publish_despite_failed_writes(monkeypatch)
    assert run_main(monkeypatch, *arguments.split()) == 1
    alone = capsys.readouterr().out
    assert f"seed {seed}: FAILED" in alone
    (first_fault,) = re.findall(rf"^seed {seed} FAILED.*\n    (.*)$", said, re.M)
    assert first_fault in alone
